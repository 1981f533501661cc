//! Screening: how much of the residual each form could explain, by a score test.
//!
//! A form's direction is the difference that it makes to the prediction at a start value of its shape; what the nominal numbers,
//! starts and effects already found can imitate is projected out. Amplitudes are then solved for linearly, so that the whole registry
//! costs one simulation for each direction.

use super::bench::{Bench, Record, add_priors, factor, pin_idle};
use super::cycles;
use super::descend::{Found, noise_weights};
use super::hypothesis::{Axis, Hypothesis};
use super::lines::{lines, resonances};
use super::normal::{Beside, CHUNK, Lockstep, Sensitivities, Sums, at};
use super::plants::carry;
use super::refine::refine;
use super::search::Remainder;
use super::symmetry::symmetric;
use nalgebra::{DMatrix, DVector};
use plant_sim::effects::{Effect, Form, Kind, REGISTRY};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Largest amplitude that a lead may start a fit from, in typical sizes: beyond, the linear estimate means nothing.
const MOST: f64 = 30.0;
/// Least amplitude a fit starts from, in typical sizes: at zero an effect has no gradient for its shape.
const LEAST: f64 = 0.02;

/// A form with more starts than this is looked at where most shows first; so many of them, or this part of them all, are looked at everywhere,
/// if they promise this share of what the best one does.
const FEW_STARTS: usize = 3;
const NOT_MUCH_LESS: f64 = 0.5;

/// A line with more parameters than this has many harmonics.
const MANY_HARMONICS: usize = 6;

/// Places from which forms of free frequency or period start: where what a plant leaves has lines, peaks and cycles.
pub struct Starts {
    /// Lines of the remainder in Hz, strongest first.
    pub line_hz: Vec<f64>,
    /// Peaks of its spectrum in Hz.
    pub resonance_hz: Vec<f64>,
    /// Its periods over the displacement in metres.
    pub period_m: Vec<f64>,
    /// Its periods over the command in volts.
    pub period_v: Vec<f64>,
}

impl Starts {
    /// Starts in what a plant leaves of each log.
    pub fn of(bench: &Bench<'_>, remainders: &[Remainder]) -> Self {
        Self {
            line_hz: lines(bench, remainders),
            resonance_hz: resonances(bench, remainders),
            period_m: cycles::over_displacement(bench, remainders),
            period_v: cycles::over_command(bench, remainders),
        }
    }
}

/// The frequency of a second mode: starts at the peaks after the highest.
const SECOND_MODE: &str = "second_natural_hz";
/// The first of modes whose frequencies hang together.
const FIRST_OF_MANY: &str = "first_natural_hz";

/// A form at a start value, and what it could explain.
#[derive(Clone)]
pub struct Lead {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// The form.
    pub form: &'static Form,
    /// Values of the parameters from which a fit may start.
    pub values: Vec<f64>,
    /// Chi-square that it takes from the residual, at the noise.
    pub gain: f64,
    /// The same as a share of the residual's chi-square beyond the noise.
    pub share: f64,
}

impl Lead {
    /// The share in per cent, which a linear estimate may put beyond all of it.
    pub fn share_percent(&self) -> f64 {
        (100.0 * self.share).clamp(0.0, 100.0)
    }
}

/// One combination of shapes of one form: its columns are its amplitudes, or the form itself if it has none.
#[derive(Clone)]
pub(super) struct Block {
    effect: &'static dyn Effect,
    form: &'static Form,
    /// Start values; amplitudes at a size at which their direction is taken, the typical one at first.
    values: Vec<f64>,
    /// Indices of the amplitudes among the values; empty for a form without one.
    amplitudes: Vec<usize>,
    per_log: bool,
    hypothesis: Hypothesis,
}

/// A block and what it could explain.
pub(super) struct Scored {
    pub block: Block,
    /// Values of the parameters from which a fit may start.
    pub values: Vec<f64>,
    /// Chi-square that it takes from the residual; a form without amplitudes may take it in part.
    pub gain: f64,
    /// The same of the form as it stands.
    pub whole: f64,
}

impl Block {
    /// How far the search for each parameter's best value goes first, in coordinates: half the way to the next start; nothing for amplitudes,
    /// and for what was read off the residual.
    pub fn steps(&self) -> Vec<f64> {
        let Some(installed) = self.hypothesis.installed.last() else { return Vec::new() };
        let step = |(axis, value): (&Axis, &f64)| {
            let starts = axis.starts();
            if axis.is_amplitude() || !starts.contains(value) {
                return 0.0;
            }
            let here = axis.coordinate(*value);
            let others = starts.iter().map(|start| (axis.coordinate(*start) - here).abs()).filter(|d| *d > 0.0);
            0.5 * others.min_by(f64::total_cmp).unwrap_or(1.0)
        };
        installed.axes.iter().zip(&self.values).map(step).collect()
    }

    /// The block with parameter `i` moved by so many coordinates from where it stands in `values`, unless a bound keeps it there.
    pub fn moved(&self, values: &[f64], i: usize, by: f64) -> Option<Self> {
        let axis = self.hypothesis.installed.last()?.axes.get(i)?;
        let to = axis.value(axis.coordinate(values[i]) + by);
        let mut moved = Self { values: values.to_vec(), ..self.clone() };
        moved.values[i] = to;
        (to != values[i]).then_some(moved)
    }

    /// The effect's identifier and the form's name.
    fn form(&self) -> (&'static str, &'static str) {
        (self.effect.id(), self.form.name)
    }

    fn columns(&self) -> usize {
        self.amplitudes.len().max(1)
    }

    /// Values for column `column`: its own amplitude at its typical size, the others at nothing.
    fn values_of(&self, column: usize) -> Vec<f64> {
        let mut values = self.values.clone();
        for (i, &at) in self.amplitudes.iter().enumerate() {
            if i != column {
                values[at] = 0.0;
            }
        }
        values
    }
}

/// Leads of all forms, the best of each form, most promising first; forms whose frequency or period is free start at `starts`.
pub fn screen(
    bench: &Bench<'_>,
    base: &Hypothesis,
    found: &Found,
    starts: &Starts,
    without: &[&str],
    simulations: &AtomicUsize,
) -> Vec<Lead> {
    let first = first_look(bench, found);
    let all: Vec<usize> = (0..bench.records.len()).collect();
    let score = |blocks: Vec<Block>, logs: &[usize]| score(bench, base, found, blocks, logs, simulations);
    let mut best: BTreeMap<(&str, &str), Scored> = BTreeMap::new();
    let blocks = blocks(bench, base, starts, without);
    let worth = if first.len() < all.len() { worth(blocks, |blocks| score(blocks, &first)) } else { blocks };
    for scored in score(worth, &all).into_iter().flatten() {
        let form = scored.block.form();
        if best.get(&form).is_none_or(|known| scored.gain > known.gain) {
            best.insert(form, scored);
        }
    }
    let mut best: Vec<Scored> = best.into_values().collect();
    let promise = |a: &Scored, b: &Scored| b.gain.total_cmp(&a.gain);
    best.sort_by(promise);
    refine(&mut best, |blocks| score(blocks, &all));
    best.sort_by(promise);
    let excess = (found.normal.misfit(&noise_weights(bench)) - found.normal.rows() as f64).max(1.0);
    let lead = |Scored { block, values, gain, .. }| {
        let Block { effect, form, .. } = block;
        Lead { effect, form, values, gain, share: gain / excess }
    };
    best.into_iter().map(lead).collect()
}

/// The logs that show most of what is left in the least time, half of it together: where every start of a form is looked at.
fn first_look(bench: &Bench<'_>, found: &Found) -> Vec<usize> {
    let excess = |(record, (sums, weight)): (&Record<'_>, (&Sums, &f64))| {
        let excess = (weight * sums.misfit_m2() - sums.rows as f64).max(0.0);
        (excess, excess / record.log.len().max(1) as f64)
    };
    let weights = noise_weights(bench);
    let of_logs: Vec<(f64, f64)> =
        bench.records.iter().zip(found.normal.logs.iter().zip(&weights)).map(excess).collect();
    let mut order: Vec<usize> = (0..of_logs.len()).collect();
    order.sort_by(|&a, &b| of_logs[b].1.total_cmp(&of_logs[a].1));
    let half = 0.5 * of_logs.iter().map(|(excess, _)| excess).sum::<f64>();
    let mut shown = 0.0;
    let enough = order.iter().position(|&log| {
        shown += of_logs[log].0;
        shown >= half
    });
    order.truncate(enough.map_or(order.len(), |last| last + 1));
    order
}

/// The blocks without the starts of a form that promise too much less than its best one: of forms with several starts the first few as `score`
/// ranks them, of the others all.
fn worth(blocks: Vec<Block>, score: impl Fn(Vec<Block>) -> Vec<Option<Scored>>) -> Vec<Block> {
    let mut starts: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    blocks.iter().for_each(|block| *starts.entry(block.form()).or_default() += 1);
    let (many, mut worth): (Vec<Block>, Vec<Block>) =
        blocks.into_iter().partition(|block| starts[&block.form()] > FEW_STARTS);
    let mut scored: Vec<Scored> = score(many).into_iter().flatten().collect();
    scored.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let mut taken: BTreeMap<(&str, &str), (usize, f64)> = BTreeMap::new();
    for Scored { block, gain, .. } in scored {
        let (count, best) = taken.entry(block.form()).or_insert((0, gain));
        if *count < FEW_STARTS.max(starts[&block.form()] / FEW_STARTS) && gain >= NOT_MUCH_LESS * *best {
            *count += 1;
            worth.push(block);
        }
    }
    worth
}

/// What each block could explain of what the fit `found` of `base` leaves of `logs`; nothing of what can't be told from the fit's own numbers.
fn score(
    bench: &Bench<'_>,
    base: &Hypothesis,
    found: &Found,
    blocks: Vec<Block>,
    logs: &[usize],
    simulations: &AtomicUsize,
) -> Vec<Option<Scored>> {
    let weights = noise_weights(bench);
    let size = found.z.len();
    let offsets: Vec<usize> = blocks
        .iter()
        .scan(0, |at, block| {
            let here = *at;
            *at += block.columns();
            Some(here)
        })
        .collect();
    let total: usize = blocks.iter().map(Block::columns).sum();

    // The nuisances' sums, from the same sensitivities as what is projected on them: a fit ends with others, of more rows or carried on, and two that
    // differ by a part in a hundred make something of what is imitated.
    let mut information = DMatrix::zeros(size, size);
    let mut gradient = DVector::zeros(size);
    // For every log: the cross products of its columns with the nuisances' sensitivities, the columns' own products (block by
    // block) and their products with the residual.
    let mut crosses = Vec::new();
    let mut own = Vec::new();
    let mut with_residual = Vec::new();
    for &index in logs {
        let record = &bench.records[index];
        let places = bench.coordinates_of(base, index);
        let mut nuisance = Lockstep::new(bench, base, &found.z, index, Sensitivities::Thinned);
        let thinned = bench.thinned[index].as_ref().map_or(record.log, |thinned| &thinned.log);
        let here = at(bench, base, &found.z, index);
        let mut directions: Vec<Beside<'_>> = blocks
            .iter()
            .flat_map(|block| (0..block.columns()).map(move |column| (block, column)))
            .map(|(block, column)| {
                let mut z = carry(bench, base, &found.z, bench, &block.hypothesis, true);
                bench.set_last(&block.hypothesis, &mut z, &block.values_of(column));
                Beside::new(bench, (&block.hypothesis, &z), index, thinned, &here)
            })
            .collect();
        simulations.fetch_add(1 + places.len() + directions.len(), Ordering::Relaxed);
        let mut nuisances = DMatrix::<f64>::zeros(places.len(), places.len());
        let mut of_nuisances = DVector::<f64>::zeros(places.len());
        let mut cross = DMatrix::<f64>::zeros(places.len(), total);
        let mut products: Vec<DMatrix<f64>> =
            blocks.iter().map(|block| DMatrix::zeros(block.columns(), block.columns())).collect();
        let mut towards = DVector::<f64>::zeros(total);
        let n = record.log.len();
        for from in (0..n).step_by(CHUNK) {
            let rows = CHUNK.min(n - from);
            let chunk = nuisance.next(from, rows);
            let thin = nuisance.thin();
            let columns: Vec<Vec<f64>> = directions
                .par_iter_mut()
                .map(|plant| {
                    let moved = plant.predict(record, &chunk.base, &chunk.seen);
                    chunk.places.iter().map(|&at| moved[at] - chunk.base[at]).collect()
                })
                .collect();
            if chunk.places.is_empty() {
                continue;
            }
            let stands_for = thin as f64;
            let columns = DMatrix::from_vec(chunk.places.len(), total, columns.concat());
            let (sensitivities, residuals_m) = (chunk.matrix(), DVector::from_vec(chunk.residuals_m));
            nuisances.gemm_tr(stands_for, &sensitivities, &sensitivities, 1.0);
            of_nuisances.gemv_tr(1.0, &sensitivities, &residuals_m, 1.0);
            cross.gemm_tr(stands_for, &sensitivities, &columns, 1.0);
            towards.gemv_tr(1.0, &columns, &residuals_m, 1.0);
            for ((block, &at), products) in blocks.iter().zip(&offsets).zip(&mut products) {
                let own = columns.columns(at, block.columns());
                products.gemm_tr(stands_for, &own, &own, 1.0);
            }
        }
        let weight = weights[index];
        let mut placed = DMatrix::zeros(size, total);
        for (i, &to) in places.iter().enumerate() {
            for column in 0..total {
                placed[(to, column)] = weight * cross[(i, column)];
            }
            for (k, &beside) in places.iter().enumerate() {
                information[(to, beside)] += weight * nuisances[(i, k)];
            }
            gradient[to] += weight * of_nuisances[i];
        }
        crosses.push(placed);
        own.push(products.into_iter().map(|p| p * weight).collect::<Vec<_>>());
        with_residual.push(towards * weight);
    }
    add_priors(&bench.rules(base), &found.z, &mut information, &mut gradient);
    pin_idle(&mut information);
    let Some(nuisance) = factor(information) else { return Vec::new() };
    let settled = nuisance.solve(&gradient);

    let scored = |(number, (block, at)): (usize, (Block, usize))| {
        let count = block.columns();
        let logs = crosses.len();
        // Columns that belong to a log are columns of their own for every log; the rest are summed over the logs.
        let wide = if block.per_log { count * logs } else { count };
        let mut cross = DMatrix::zeros(size, wide);
        let mut products = DMatrix::zeros(wide, wide);
        let mut towards = DVector::zeros(wide);
        for log in 0..logs {
            let to = if block.per_log { log * count } else { 0 };
            let mut part = cross.columns_mut(to, count);
            part += crosses[log].columns(at, count);
            let mut part = products.view_mut((to, to), (count, count));
            part += &own[log][number];
            let mut part = towards.rows_mut(to, count);
            part += with_residual[log].rows(at, count);
        }
        let raw: Vec<f64> = (0..wide).map(|i| products[(i, i)]).collect();
        products -= cross.tr_mul(&nuisance.solve(&cross));
        towards -= cross.tr_mul(&settled);
        for i in 0..wide {
            // What the nuisances imitate to rounding can't be told from them.
            products[(i, i)] += 1e-9 * raw[i] + 1e-300;
        }
        let Solved { amplitudes, gain, whole } = solve(&block, products, towards)?;
        let mut values = block.values.clone();
        for (i, &place) in block.amplitudes.iter().enumerate() {
            // A fit starts every log alike; per-log amplitudes settle in its first step.
            let of_logs: Vec<f64> = (0..wide / count).map(|log| amplitudes[log * count + i]).collect();
            let mean = of_logs.iter().sum::<f64>() / of_logs.len() as f64;
            let size = if mean == 0.0 { LEAST } else { mean.abs().clamp(LEAST, MOST).copysign(mean) };
            values[place] *= size;
        }
        Some(Scored { block, values, gain, whole })
    };
    blocks.into_iter().zip(offsets).enumerate().map(scored).collect()
}

/// Amplitudes of a block, and what [`Scored`] says of them.
struct Solved {
    amplitudes: DVector<f64>,
    gain: f64,
    whole: f64,
}

/// Amplitudes and the chi-square they take; those of one sign only are held to it.
fn solve(block: &Block, products: DMatrix<f64>, towards: DVector<f64>) -> Option<Solved> {
    let gain = |a: &DVector<f64>| 2.0 * a.dot(&towards) - a.dot(&(&products * a));
    let single = products.nrows() == 1;
    let mut amplitudes = products.clone().cholesky()?.solve(&towards);
    if block.amplitudes.is_empty() {
        amplitudes[0] = amplitudes[0].clamp(0.0, 1.0);
    } else if single {
        let one_sided = block.hypothesis.installed.last().is_some_and(|installed| {
            let axis = &installed.axes[block.amplitudes[0]];
            axis.parameter.bounds[0] >= 0.0
        });
        if one_sided {
            amplitudes[0] = amplitudes[0].max(0.0);
        }
    }
    let taken = gain(&amplitudes);
    let whole = if block.amplitudes.is_empty() { gain(&DVector::from_element(1, 1.0)) } else { taken };
    taken.is_finite().then_some(Solved { amplitudes, gain: taken.max(0.0), whole })
}

fn blocks(bench: &Bench<'_>, base: &Hypothesis, from: &Starts, without: &[&str]) -> Vec<Block> {
    let imitated = symmetric(bench);
    let scales = bench.scales();
    let mut blocks = Vec::new();
    let taken = base.ids();
    // Beside another effect every simulation costs more, and a mode that matters there stands out of the residual's spectrum.
    let is_beside = !taken.is_empty();
    for &effect in REGISTRY.iter().filter(|e| !taken.contains(&e.id()) && !without.contains(&e.id())) {
        // What the nominal numbers imitate has no direction of its own; only its first form is that.
        let first = usize::from(imitated.contains(&effect.id()));
        for form in effect.forms().iter().skip(first).filter(|form| form.kind == Kind::Predictable) {
            let hypothesis = base.with(effect, form, &scales);
            let Some(installed) = hypothesis.installed.last() else { continue };
            let parameters: Vec<_> = installed.axes.iter().map(|axis| &axis.parameter).collect();
            let amplitudes: Vec<usize> = (0..parameters.len()).filter(|&i| installed.axes[i].is_amplitude()).collect();
            let per_log = amplitudes.iter().any(|&i| parameters[i].is_of_each_log());
            let starts: Vec<Vec<f64>> = installed
                .axes
                .iter()
                .map(|axis| {
                    let Starts { line_hz, resonance_hz, period_m, period_v } = from;
                    let (is_line, is_second) =
                        (axis.parameter.name == "line_hz", axis.parameter.name == "second_line_hz");
                    let beside = parameters.iter().any(|other| other.name == "second_line_hz");
                    let is_rich = parameters.len() > MANY_HARMONICS;
                    let [low, high] = axis.parameter.bounds;
                    let within = |all: &[f64]| -> Vec<f64> {
                        all.iter().copied().filter(|hz| (low..=high).contains(hz)).collect()
                    };
                    // A resonance narrower than the spacing of the starts shows as a line under a broad excitation.
                    let is_resonance = axis.parameter.name == "natural_hz" && effect.id() == "vibration_mode";
                    // The strongest line need not be the fundamental.
                    let first = line_hz.first().map_or(Vec::new(), |hz| vec![*hz, hz / 2.0]);
                    let with = |found: &[f64]| axis.starts().into_iter().chain(within(found)).collect();
                    if is_second {
                        within(line_hz.get(1..2).unwrap_or_default())
                    } else if is_line && (beside || is_rich) {
                        within(&first[..first.len().min(1 + usize::from(is_rich))])
                    } else if is_line {
                        within(line_hz)
                    } else if is_resonance && parameters.iter().any(|other| other.name == SECOND_MODE) {
                        within(resonance_hz.get(..1).unwrap_or_default())
                    } else if axis.parameter.name == FIRST_OF_MANY {
                        within(resonance_hz.get(..2).unwrap_or_default())
                    } else if axis.parameter.name == SECOND_MODE {
                        within(resonance_hz.get(1..4).unwrap_or_default())
                    } else if is_resonance && (amplitudes.len() > 1 || is_beside) {
                        within(resonance_hz)
                    } else if is_resonance {
                        with(resonance_hz)
                    } else if ["period_m", "quantum_m"].contains(&axis.parameter.name) {
                        with(period_m)
                    } else if axis.parameter.name == "quantum_v" {
                        with(period_v)
                    } else {
                        axis.starts()
                    }
                })
                .collect();
            let mut grid = vec![Vec::new()];
            for starts in starts {
                grid = grid
                    .into_iter()
                    .flat_map(|left: Vec<f64>| starts.iter().map(move |s| left.iter().copied().chain([*s]).collect()))
                    .collect();
            }
            for values in grid {
                let (amplitudes, hypothesis) = (amplitudes.clone(), hypothesis.clone());
                blocks.push(Block { effect, form, values, amplitudes, per_log, hypothesis });
            }
        }
    }
    blocks
}
