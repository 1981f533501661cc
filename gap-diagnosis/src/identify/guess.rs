//! A first guess of the plant from the logs alone: static gain, loop width, and the resonance if the logs show one.

use crate::spectra::{frf, segment_samples};
use nalgebra::{DMatrix, DVector};
use plant_sim::chain::Chain;
use plant_sim::log::Log;
use plant_sim::metrics::rms;
use plant_sim::model::{ActuatorSection, HysteronSection, Kind, Model, StructureSection};
use plant_sim::param::{ASSUMED_MASS_SIGMA, Param};
use plant_sim::replay::{Start, predict};

/// Rows that the scan for a resonance simulates.
const SCAN_ROWS: usize = 4000;
/// Undamped frequencies and damping ratios of the scan.
const SCAN_HZ: [f64; 9] = [50.0, 100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0, 6400.0, 12800.0];
const SCAN_DAMPING: [f64; 2] = [0.05, 0.4];
/// Where the logs don't show a resonance: that of the thesis' bender, or the sampling rate if that is lower, critically damped.
/// Ringing that nobody saw would open and close dead zones between samples.
const UNSEEN_HZ: f64 = 783.0;
const UNSEEN_DAMPING: f64 = 1.0;

/// Correlation of displacement and command from which on the line through them says enough.
const STRAIGHT: f64 = 0.7;
/// Coherence of a line that says something, and how many of the slowest say which way the plant goes.
const COHERENT: f64 = 0.8;
const SLOWEST: usize = 3;

/// What the records look like before anything is fitted.
pub struct Looks {
    /// Slope of displacement over command, m/V.
    pub gain_m_per_v: f64,
    /// Offset of that line in metres.
    pub offset_m: f64,
    /// Rms distance from the line in volts: the loop's width.
    pub width_v: f64,
    /// Largest minus smallest command in volts.
    pub span_v: f64,
}

/// The line through displacement over command.
pub fn looks(log: &Log, run_in: usize) -> Looks {
    let (u, y) = (&log.command_v[run_in..], &log.displacement_m[run_in..]);
    let pairs = || u.iter().zip(y);
    let n = y.len() as f64;
    let (mean_u, mean_y) = (u.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let suu: f64 = u.iter().map(|u| (u - mean_u).powi(2)).sum();
    let suy: f64 = pairs().map(|(u, y)| (u - mean_u) * (y - mean_y)).sum();
    let syy: f64 = y.iter().map(|y| (y - mean_y).powi(2)).sum();
    let line_m_per_v = suy / suu;
    // Above its resonance a plant moves against the command: then the slowest part says which way it goes.
    let slow_m_per_v = if suy < STRAIGHT * (suu * syy).sqrt() { slow_gain_m_per_v(u, y, log.dt_s) } else { None };
    let gain_m_per_v = slow_m_per_v.unwrap_or(line_m_per_v);
    let rms_m = ((syy - line_m_per_v * suy).max(0.0) / n).sqrt();
    let (low, high) = u.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    Looks {
        gain_m_per_v,
        offset_m: mean_y - gain_m_per_v * mean_u,
        width_v: rms_m / gain_m_per_v.abs(),
        span_v: high - low,
    }
}

/// The same, of the whole log where the command stands still after the run-in: a step in it or at its end is all that tells.
pub fn looks_at_all(log: &Log, run_in: usize) -> Looks {
    let looks = looks(log, run_in);
    if looks.gain_m_per_v.is_finite() { looks } else { self::looks(log, 0) }
}

/// Periods of the structure's resonance whose mean tells slow motions: of what is faster than a fifth of it less than [`SLOW_SHARE`] stays.
const SLOW_PERIODS: f64 = 4.0;
/// Least share of the motion that is slow where its sign is told, and least blocks of it.
const SLOW_SHARE: f64 = 0.25;
const LEAST_BLOCKS: usize = 4;

/// Whether the slow motions of a log go against those of `chain`. Near and above a resonance, which need not be where `chain` has it, a plant may go
/// either way, so that a log of fast motions alone is never inverted.
pub fn is_inverted(log: &Log, run_in: usize, chain: &Chain) -> bool {
    if chain.parts.linear.is_some() {
        return false; // What it is made of has no stiffness and mass to tell what is slow.
    }
    let turning_per_s = (chain.plant.stiffness_n_per_m / chain.plant.mass_kg).sqrt();
    let slow_s = if chain.parts.is_massless { 0.0 } else { SLOW_PERIODS * std::f64::consts::TAU / turning_per_s };
    let block = ((slow_s / log.dt_s).round() as usize).max(1);
    let predicted_m = predict(chain, log, &Start::relaxed(chain), log.len());
    let slow = |rows: &[f64]| -> Vec<f64> {
        let blocks: Vec<f64> = rows.chunks_exact(block).map(|rows| rows.iter().sum::<f64>() / block as f64).collect();
        from_mean(&blocks)
    };
    let (predicted_m, measured_m) = (&predicted_m[run_in..], &log.displacement_m[run_in..]);
    let (p, y) = (slow(predicted_m), slow(measured_m));
    if p.len() < LEAST_BLOCKS || rms(p.iter().copied()) < SLOW_SHARE * rms(from_mean(predicted_m)) {
        return false;
    }
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    product(&p, &y) < -STRAIGHT * (product(&p, &p) * product(&y, &y)).sqrt()
}

fn from_mean(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|value| value - mean).collect()
}

/// In-phase part of the response at the lowest frequencies that the log shows, if it shows any.
fn slow_gain_m_per_v(command_v: &[f64], displacement_m: &[f64], dt_s: f64) -> Option<f64> {
    let response = frf(command_v, displacement_m, dt_s, segment_samples(command_v.len()))?;
    let coherent = (0..response.coherence.len()).filter(|&k| response.coherence[k] > COHERENT);
    let slowest: Vec<f64> =
        coherent.take(SLOWEST).map(|k| response.gain_m_per_v[k] * response.phase_rad[k].cos()).collect();
    (!slowest.is_empty()).then(|| slowest.iter().sum::<f64>() / slowest.len() as f64)
}

/// Row from which the command moves: a log may begin with seconds of rest, which show nothing.
pub fn moves_from(log: &Log, run_in: usize) -> usize {
    let rest = log.command_v[run_in..].windows(2).take_while(|pair| pair[0] == pair[1]).count();
    if run_in + rest + 1 < log.len() { run_in + rest } else { run_in }
}

/// A plant with `hysterons` hysterons that has the first log's gain and loop width, and whether a log shows a resonance at all. Beside each log the
/// rows of its run-in.
pub fn guess(logs: &[(&Log, usize)], looks: &Looks, hysterons: usize, mass_kg: f64) -> (Model, bool) {
    let assumed = |value: f64| Param { source: "guessed from the log".into(), ..Param::assumed(value) };
    let plant = |hz: f64, damping_ratio: f64, hysterons: usize| {
        let turning = std::f64::consts::TAU * hz;
        let stiffness = mass_kg * turning * turning;
        let alpha = stiffness * looks.gain_m_per_v.abs();
        let section = |i: usize| {
            // The rising and falling branches of the loop lie sum(d/2) volts off the line; thresholds spread over the travel.
            let edge_v = 1.2 * looks.width_v / hysterons as f64;
            let travel_m = looks.gain_m_per_v.abs() * looks.span_v * (i + 1) as f64 / (hysterons + 1) as f64;
            let capacitance = travel_m * alpha / (2.0 * edge_v);
            let time_s = if i == 0 { 1e-5 } else { 5e-3 };
            HysteronSection {
                capacitance_f: assumed(capacitance),
                slope_s: assumed(capacitance / time_s),
                dead_zone_v: assumed(2.0 * edge_v),
            }
        };
        Model {
            actuator: ActuatorSection {
                transduction_c_per_m: assumed(alpha),
                hysterons: (0..hysterons).map(section).collect(),
            },
            structure: StructureSection {
                mass_kg: Param::new(mass_kg, ASSUMED_MASS_SIGMA, "stated by the caller or assumed; never fitted"),
                damping_n_s_per_m: assumed(2.0 * damping_ratio * mass_kg * turning),
                stiffness_n_per_m: assumed(stiffness),
            },
            ..Model::empty(&format!("identified from {}", logs[0].0.name))
        }
    };
    let seen = logs.iter().filter_map(|(log, run_in)| resonance(log, *run_in, looks, &|hz, d| plant(hz, d, 0).chain()));
    match seen.min_by(|a, b| a.misfit.total_cmp(&b.misfit)) {
        Some(seen) => (plant(seen.hz, seen.damping, hysterons), true),
        None => (plant(UNSEEN_HZ.min(1.0 / logs[0].0.dt_s), UNSEEN_DAMPING, hysterons), false),
    }
}

/// Time constants of linear hysterons, spread evenly in logarithm: from a fifth of a millisecond to a tenth of a second.
const SPREAD_S: [f64; 2] = [2e-4, 0.1];

/// Turns hysterons into linear creep elements whose time constants are spread.
pub fn without_dead_zones(model: &mut Model) {
    let count = model.actuator.hysterons.len();
    for (i, hysteron) in model.actuator.hysterons.iter_mut().enumerate() {
        let along = (i as f64 + 0.5) / count as f64;
        let time_s = SPREAD_S[0] * (SPREAD_S[1] / SPREAD_S[0]).powf(along);
        hysteron.dead_zone_v.value = 0.0;
        hysteron.slope_s.value = hysteron.capacitance_f.value / time_s;
    }
}

/// A Bouc-Wen actuator with the logs' gain and resonance: Table 2.2 stretched to the logs' volts, its loop a fifth of its force.
pub fn bouc_wen(logs: &[(&Log, usize)], looks: &Looks, mass_kg: Option<f64>) -> Model {
    let (base, _) = guess(logs, looks, 0, mass_kg.unwrap_or(1e-3));
    let of = |value: f64| Some(Param { source: "guessed from the log".into(), ..Param::assumed(value) });
    let per_span = 1.0 / looks.span_v.max(1e-3);
    let mut model = base.clone();
    model.hysteresis.amplitude_per_v = of(1.05 * per_span);
    model.hysteresis.beta_per_v = of(0.76 * per_span);
    model.hysteresis.gamma_per_v = of(1.74 * per_span);
    // With these numbers h rises by 0.6 over the span.
    let excess = 0.25;
    match mass_kg {
        Some(_) => {
            model.kind = Kind::BoucWen;
            let alpha = base.actuator.transduction_c_per_m.value;
            model.actuator.transduction_c_per_m.value = (1.0 + excess) * alpha;
            model.hysteresis.force_n = of(excess * alpha * looks.span_v / 0.6);
        }
        None => {
            model.kind = Kind::BoucWenStatic;
            model.actuator = ActuatorSection::default();
            model.structure = StructureSection::default();
            let gain_um = looks.gain_m_per_v.abs() * 1e6;
            model.hysteresis.gain_um_per_v = of((1.0 + excess) * gain_um);
            model.hysteresis.depth_um = of(excess * gain_um * looks.span_v / 0.6);
        }
    }
    model
}

/// Plays of a guess, cells of a row, and levels of the kernels.
const PLAYS: usize = 8;
const ROWS: usize = 6;
/// Share of the static gain that an operator makes which is the motion itself; the rest is straight.
const SHARE: f64 = 0.4;

/// An actuator with the logs' gain and resonance and an operator of `kind`, which makes a loop of a fifth of its force.
pub fn operator(kind: Kind, logs: &[(&Log, usize)], looks: &Looks, mass_kg: f64) -> Model {
    let (mut model, _) = guess(logs, looks, 0, mass_kg);
    model.kind = kind;
    let alpha = model.actuator.transduction_c_per_m.value;
    let param = |value: f64| Param { source: "guessed from the log".into(), ..Param::assumed(value) };
    let given = |value: f64| Param::absolute(value, 0.0, "chosen, not fitted");
    let (log, run_in) = logs[0];
    let [low_v, high_v] = log.command_v[run_in..]
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)]);
    let span_v = looks.span_v.max(1e-3);
    let hysteresis = &mut model.hysteresis;
    // What saturates is taken off a larger force; what moves is added to a smaller one.
    let straight = match kind {
        Kind::Dahl | Kind::MaxwellSlip => 1.25,
        _ => 1.0 - SHARE,
    };
    match kind {
        Kind::Dahl => {
            hysteresis.rate_per_v = Some(param(2.0 / span_v));
            hysteresis.force_n = Some(param(0.25 * alpha * span_v / 2.0));
        }
        Kind::Duhem => {
            hysteresis.force_n = Some(given(alpha));
            hysteresis.rate_per_v = Some(param(4.0 / span_v));
            hysteresis.slope_per_v = Some(param(SHARE));
            hysteresis.inner_slope_per_v = Some(param(0.6 * SHARE));
        }
        Kind::MaxwellSlip | Kind::PrandtlIshlinskii => {
            let share = if kind == Kind::MaxwellSlip { 0.25 } else { SHARE };
            hysteresis.force_n = Some(given(alpha));
            // A play wider than half the span is never taken along.
            let at = |i: usize| 0.5 * span_v * (i as f64 + 0.5) / PLAYS as f64;
            hysteresis.threshold_v = (0..PLAYS).map(|i| given(at(i))).collect();
            hysteresis.weight_per_v = (0..PLAYS).map(|_| param(share / PLAYS as f64)).collect();
        }
        _ => {
            let is_preisach = kind == Kind::Preisach;
            let edges = if is_preisach { ROWS + 1 } else { ROWS };
            let step_v = span_v / ROWS as f64;
            hysteresis.force_n = Some(given(alpha * span_v));
            hysteresis.level_v = (0..edges).map(|i| given(low_v + (high_v - low_v) * i as f64 / ROWS as f64)).collect();
            if !is_preisach {
                hysteresis.ramp_v = Some(given(step_v));
            }
            // Evenly over the triangle: a rise over the span adds twice the sum.
            let whole = 0.5 * SHARE;
            let cells =
                (0..ROWS).flat_map(|up| (0..=up).map(move |down| if is_preisach && up == down { 0.5 } else { 1.0 }));
            let cells: Vec<f64> = cells.collect();
            let sum: f64 = cells.iter().sum();
            hysteresis.weight = cells.into_iter().map(|cell| param(whole * cell / sum)).collect();
        }
    }
    model.actuator.transduction_c_per_m.value = straight * alpha;
    model
}

/// A resonance that a log shows.
struct Resonance {
    /// Undamped frequency.
    hz: f64,
    /// Damping ratio.
    damping: f64,
    /// What a linear plant with it misses the log by, over what one misses that shows none.
    misfit: f64,
}

/// The resonance of the linear plant that replays the log best, if that makes a difference.
fn resonance(log: &Log, run_in: usize, looks: &Looks, plant: &dyn Fn(f64, f64) -> Chain) -> Option<Resonance> {
    let run_in = moves_from(log, run_in);
    let rows = log.command_v.len().min(run_in + SCAN_ROWS);
    let misfit = |hz: f64, damping: f64| {
        let chain = plant(hz, damping);
        let start = Start::at_rest(&chain, log.command_v[0], Vec::new());
        let predicted = predict(&chain, log, &start, rows);
        // Hysteresis lags as well; so the prediction may be scaled, moved in time a little, and offset before it is compared.
        let regressors = DMatrix::from_fn(rows - run_in, 3, |row, column| {
            let k = row + run_in;
            let (before, after) = (predicted[k.saturating_sub(1)], predicted[(k + 1).min(rows - 1)]);
            match column {
                0 => predicted[k],
                1 => after - before,
                _ => looks.gain_m_per_v * looks.span_v,
            }
        });
        let measured = DVector::from_column_slice(&log.displacement_m[run_in..rows]);
        match (regressors.tr_mul(&regressors)).cholesky() {
            Some(normal) => (&measured - &regressors * normal.solve(&regressors.tr_mul(&measured))).norm(),
            None => f64::INFINITY,
        }
    };
    // A resonance that dies out within a few samples can't be seen: every candidate above the sampling rate looks alike.
    let candidates: Vec<(f64, f64, f64)> = SCAN_HZ
        .iter()
        .filter(|&&hz| hz * log.dt_s < 2.0)
        .flat_map(|&hz| SCAN_DAMPING.map(|damping| (hz, damping, misfit(hz, damping))))
        .collect();
    let unseen = misfit(UNSEEN_HZ.min(1.0 / log.dt_s), UNSEEN_DAMPING);
    candidates.iter().min_by(|a, b| a.2.total_cmp(&b.2)).filter(|best| best.2 < 0.97 * unseen).map(|best| Resonance {
        hz: best.0,
        damping: best.1,
        misfit: best.2 / unseen,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_at_the_end_of_the_run_in_has_a_gain() {
        let command_v: Vec<f64> = (0..100).map(|k| if k < 50 { 0.0 } else { 20.0 }).collect();
        let displacement_m = command_v.iter().map(|v| 1e-6 * v).collect();
        let log = Log { dt_s: 1e-3, displacement_m, command_v, ..Log::default() };
        assert!(looks(&log, 50).gain_m_per_v.is_nan());
        assert!((looks_at_all(&log, 50).gain_m_per_v - 1e-6).abs() < 1e-12);
    }

    #[test]
    fn a_log_moves_from_where_its_command_does() {
        let log = |command_v: &[f64]| Log { command_v: command_v.to_vec(), ..Log::default() };
        assert_eq!(moves_from(&log(&[0.0, 0.0, 0.0, 1.0, 1.0]), 0), 2);
        assert_eq!(moves_from(&log(&[0.0, 1.0, 2.0]), 0), 0);
        assert_eq!(moves_from(&log(&[0.0, 5.0, 5.0, 5.0, 6.0]), 1), 3);
        assert_eq!(moves_from(&log(&[0.0, 5.0, 5.0, 5.0]), 1), 1);
    }

    /// The thesis' plant, 783 Hz, is asked of motions that are slow and of such as would be upside down to a line.
    #[test]
    fn a_log_is_inverted_by_its_slow_motions_alone() {
        let chain = crate::reproduce::Thesis::default().phs.chain();
        let made = |hz: f64, sign: f64| {
            let dt_s = 5e-5;
            let command_v: Vec<f64> =
                (0..4000).map(|k| 40.0 * (std::f64::consts::TAU * hz * f64::from(k) * dt_s).sin()).collect();
            let zeros = vec![0.0; command_v.len()];
            let log = Log { dt_s, displacement_m: zeros, command_v, ..Log::default() };
            let predicted_m = predict(&chain, &log, &Start::relaxed(&chain), log.len());
            Log { displacement_m: predicted_m.iter().map(|y| sign * y).collect(), ..log }
        };
        for hz in [5.0, 50.0, 120.0] {
            assert!(is_inverted(&made(hz, -1.0), 100, &chain) && !is_inverted(&made(hz, 1.0), 100, &chain), "{hz} Hz");
        }
        // A resonance that is not where the plant has it turns these.
        for hz in [400.0, 790.0, 1500.0] {
            assert!(!is_inverted(&made(hz, -1.0), 100, &chain), "{hz} Hz");
        }
    }

    /// Above its resonance at 30 Hz a plant moves against most of this command, and yet it goes the command's way.
    #[test]
    fn a_log_above_the_resonance_is_not_upside_down() {
        let (dt_s, turning) = (1e-3, std::f64::consts::TAU * 30.0);
        let command_v: Vec<f64> = (0..8000)
            .map(|k| {
                let t = f64::from(k) * dt_s;
                [(5.0, 1.0), (50.0, 3.0), (70.0, 3.0), (90.0, 3.0)]
                    .iter()
                    .map(|(hz, volts)| volts * (std::f64::consts::TAU * hz * t).sin())
                    .sum()
            })
            .collect();
        let (mut q, mut w) = (0.0, 0.0);
        let displacement_m: Vec<f64> = command_v
            .iter()
            .map(|u| {
                let seen = q;
                w += dt_s * (turning * turning * (1e-6 * u - q) - 0.2 * turning * w);
                q += dt_s * w;
                seen
            })
            .collect();
        let log =
            |displacement_m: Vec<f64>| Log { dt_s, command_v: command_v.clone(), displacement_m, ..Log::default() };
        let upright = looks(&log(displacement_m.clone()), 0).gain_m_per_v;
        assert!((0.7e-6..1.4e-6).contains(&upright), "{upright:e}");
        assert!(looks(&log(displacement_m.iter().map(|q| -q).collect()), 0).gain_m_per_v < 0.0);
    }
}
