//! Commands that never arrived and readings that stayed, found row by row in what a fit leaves.
//!
//! A command that is lost leaves the drive where it was: a pulse whose height the log tells and whose echo in the displacement the plant
//! tells. A reading that is lost leaves the number where it was, or at that of some rows before, or at a mean of them, be the noise a new
//! one: the same with the predicted displacement and without an echo. So whether a stretch of rows was lost is a comparison of two
//! predictions without any free number. Stretches are taken greedily, the most certain first; what they leave shows the next. Delays,
//! slews and jitter leave such pulses at no height or at every height, and at every row, so that their shares don't crowd at one.

use super::bench::{Bench, Record};
use super::judge::Course;
use super::search::Search;
use crate::residual::median_magnitude;
use plant_sim::chain::{Chain, Held, Simulator};
use plant_sim::log::{Hold, Log};

/// Most commands that are lost in a row.
const IN_A_ROW: usize = 16;
/// A stretch counts if the prediction with it is better by this chi-square: eight sigma, because there are many rows.
const CERTAIN: f64 = 64.0;
/// A pulse's echo ends where it stays below this share of its peak, or after so many rows.
const ECHO_ENDS: f64 = 0.02;
const LONGEST_ECHO: usize = 256;
/// Rows that are searched together.
const BLOCK: usize = 4096;
/// Passes over a log: what was found lowers the scatter that the rest is judged by.
const PASSES: usize = 3;
/// From the median of a normal's magnitude to its sigma.
const TO_SIGMA: f64 = 1.4826;
/// The rows that were lost are any of those whose loss would show: their mean rank among these is a half, this much or so many sigma of it more or less.
const RANK_WITHIN: f64 = 0.12;
const RANK_SIGMAS: f64 = 3.0;
/// Fewer stretches than this are chance, ..
const LEAST: usize = 4;
/// .. unless these are as many, all at one, and leave no more than this share of the power.
const FEW: usize = 2;
const FEW_LEAVE: f64 = 0.1;
/// Of the stretches, this share must have between these parts of their height ..
const CROWDED: f64 = 0.7;
const AT_ONE: [f64; 2] = [0.75, 1.25];
/// .. they must be no more than this share of the rows that could have shown one ..
const MOST_SHARE: f64 = 0.35;
/// .. and leave no more than this share of the power.
const LEAVES: f64 = 0.5;

/// Rows from which a reading that stayed is told: as many to either side are its slow part.
const READING_ROWS: usize = 8;

/// How far back what a lost reading shows instead may lie, in rows.
const FARTHEST: usize = 8;

/// What a row shows instead.
#[derive(Clone, Copy, Debug)]
enum Instead {
    /// What the last one showed that was not lost.
    Last,
    /// What was there so many rows ago.
    Older(usize),
    /// The mean of so many rows before.
    Mean(usize),
}

impl Instead {
    /// Rows that must lie before.
    fn rows(self) -> usize {
        match self {
            Instead::Last => 1,
            Instead::Older(rows) | Instead::Mean(rows) => rows,
        }
    }
}

/// What was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lost {
    /// Commands.
    Commands,
    /// Readings.
    Readings,
}

/// The rows that were lost.
pub(super) struct Losses {
    /// Which way.
    pub lost: Lost,
    /// What acted in each row of each log: commands in volts, or readings in metres.
    held: Vec<Vec<f64>>,
    /// Which rows of each log.
    pub is_lost: Vec<Vec<bool>>,
    /// Share of all rows that was lost.
    pub share: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// Mean square that the losses make, metres squared.
    pub power_m2: f64,
    /// Mean square beyond the noise that stays.
    stays_m2: f64,
}

impl Losses {
    /// These and `more`, which were found once these were known.
    pub fn and(self, more: Losses) -> Losses {
        match self.lost {
            // What arrived the first time was what was looked at then.
            Lost::Commands => Losses {
                share: self.share + more.share,
                sigma: self.sigma.hypot(more.sigma),
                power_m2: self.power_m2 + more.power_m2,
                ..more
            },
            // Readings that are known to have stayed are found again.
            Lost::Readings => more,
        }
    }

    /// What a diagnosis reads of `logs`, with the commands that arrived, which are given away.
    pub fn logs(&mut self, logs: &[Log]) -> Vec<Log> {
        let one = |(log, command_v): (&Log, Vec<f64>)| Log {
            name: log.name.clone(),
            time_start_s: log.time_start_s,
            dt_s: log.dt_s,
            command_v,
            displacement_m: log.displacement_m.clone(),
            force_n: log.force_n.clone(),
            meta: log.meta.clone(),
            ..Log::default()
        };
        logs.iter().zip(std::mem::take(&mut self.held)).map(one).collect()
    }
}

/// What was lost of each log, if commands or readings were, by what the best fit of `course` leaves; of both what takes more.
pub(super) fn losses(search: &Search<'_>, course: &Course) -> Option<Losses> {
    let fits = course.explanations.iter().map(|explanation| &explanation.candidate);
    let best = fits.fold(&course.refit, |best, fit| if fit.chi < best.chi { fit } else { best });
    let bench = search.bench;
    let left_m: Vec<Vec<f64>> = search.play(best).into_iter().map(|left| left.residual_m).collect();
    let of_commands = |(index, left_m): (usize, &Vec<f64>)| {
        let chain = bench.chain_at(&best.hypothesis, &best.found.z, index);
        Walk::of_commands(bench, index, &chain, left_m).map(Walk::searched)
    };
    let readings = |instead: Instead| -> Vec<Walked> {
        let of_log = |(index, left_m): (usize, &Vec<f64>)| Walk::of_readings(bench, index, left_m, instead).searched();
        left_m.iter().enumerate().map(of_log).collect()
    };
    // One after the other: what the walks of ten minutes hold is let go before the next begin.
    let commands: Option<Vec<Walked>> = left_m.iter().enumerate().map(of_commands).collect();
    let commands = commands.and_then(|walks| judged(Lost::Commands, walks));
    let readings = closest(insteads().filter_map(|instead| judged(Lost::Readings, readings(instead))));
    [commands, readings].into_iter().flatten().max_by(|a, b| a.power_m2.total_cmp(&b.power_m2))
}

/// All that a lost reading may show.
fn insteads() -> impl Iterator<Item = Instead> {
    let far = (2..=FARTHEST).flat_map(|rows| [Instead::Older(rows), Instead::Mean(rows)]);
    std::iter::once(Instead::Last).chain(far)
}

/// The losses that leave the least.
fn closest(found: impl Iterator<Item = Losses>) -> Option<Losses> {
    found.min_by(|a, b| a.stays_m2.total_cmp(&b.stays_m2))
}

/// What the walks found, if it can be nothing but losses.
fn judged(lost: Lost, walks: Vec<Walked>) -> Option<Losses> {
    let shares: Vec<f64> = walks.iter().flat_map(|walk| walk.shares.iter().copied()).collect();
    let crowded = shares.iter().filter(|share| (AT_ONE[0]..AT_ONE[1]).contains(*share)).count();
    let (mut rows, mut count, mut visible, mut taken_m2) = (0, 0, 0, 0.0);
    let mut power_m2 = [0.0; 2];
    for walk in &walks {
        rows += walk.is_lost.len();
        count += walk.is_lost.iter().filter(|is_lost| **is_lost).count();
        visible += walk.visible.len();
        taken_m2 += walk.taken_m2;
        power_m2 = [power_m2[0] + walk.power_m2[0], power_m2[1] + walk.power_m2[1]];
    }
    let are_few_enough = shares.len() >= FEW && crowded == shares.len() && power_m2[1] <= FEW_LEAVE * power_m2[0];
    let is_found = (shares.len() >= LEAST || are_few_enough)
        && crowded as f64 >= CROWDED * shares.len() as f64
        && shares.len() as f64 <= MOST_SHARE * visible as f64
        && power_m2[1] <= LEAVES * power_m2[0];
    let is_found = is_found && is_anywhere(&walks);
    let (held, is_lost) = walks.into_iter().map(|walk| (walk.held, walk.is_lost)).unzip();
    is_found.then(|| Losses {
        lost,
        held,
        is_lost,
        // Of the rows whose loss shows, and as likely of the others.
        share: count as f64 / visible as f64,
        sigma: (count as f64).sqrt() / visible as f64,
        power_m2: taken_m2 / rows as f64,
        stays_m2: power_m2[1] / rows as f64,
    })
}

/// Whether the rows that begin a stretch are any rows of those whose loss would show: by how much they step, by where the plant is driven to, and by
/// how far from the middle that is. What sticks stays where steps are small, and what lets go where the drive pulls.
fn is_anywhere(walks: &[Walked]) -> bool {
    let measures: [fn(&Visible) -> f32; 3] = [|row| row.step, |row| row.level, |row| row.level.abs()];
    measures.into_iter().all(|measure| {
        let mut visible: Vec<f32> = walks.iter().flat_map(|walk| walk.visible.iter().map(measure)).collect();
        visible.sort_by(f32::total_cmp);
        let begins = |walk: &Walked, row: usize| walk.is_lost[row] && !walk.is_lost[row - 1];
        let lost =
            walks.iter().flat_map(|walk| walk.visible.iter().filter(|visible| begins(walk, visible.row as usize)));
        // Of equals the one in the middle: levels of stairs are few.
        let rank = |value: f32| {
            let [below, upto] =
                [visible.partition_point(|other| *other < value), visible.partition_point(|other| *other <= value)];
            0.5 * (below + upto) as f64 / visible.len() as f64
        };
        let ranks: Vec<f64> = lost.map(|row| rank(measure(row))).collect();
        let mean = ranks.iter().sum::<f64>() / ranks.len().max(1) as f64;
        let sigma = (12.0 * ranks.len().max(1) as f64).sqrt().recip();
        (mean - 0.5).abs() < RANK_WITHIN.max(RANK_SIGMAS * sigma)
    })
}

/// A row whose loss would have shown, as small as it may be: most of ten minutes' twelve million rows may be some.
struct Visible {
    row: u32,
    /// How far what it should have is from that of the row before.
    step: f32,
    /// What it should have, from the log's mean on.
    level: f32,
}

/// A search of one log.
struct Walk {
    /// What every row should have: its command in volts, or its reading in metres.
    given: Vec<f64>,
    /// What it had.
    held: Vec<f64>,
    /// What it has if it was lost.
    instead: Instead,
    is_lost: Vec<bool>,
    /// What is left, slow parts taken off.
    left_m: Vec<f64>,
    /// Echo of a unit over one sample, slow parts taken off, from `ahead` rows before the sample on, in metres; its products with itself.
    echo_m: Vec<f64>,
    ahead: usize,
    products_m2: Vec<f64>,
    /// First row in which a loss counts.
    first: usize,
    noise2: f64,
    /// What was found.
    taken: Vec<Stretch>,
    /// Rows whose loss would have shown.
    visible: Vec<Visible>,
}

/// What a search of one log found.
struct Walked {
    held: Vec<f64>,
    is_lost: Vec<bool>,
    /// Sums of squares beyond the noise, before and after.
    power_m2: [f64; 2],
    /// Height of each stretch that was found, as a share of what it would be.
    shares: Vec<f64>,
    /// See [`Walk`].
    visible: Vec<Visible>,
    /// Sum of what the stretches gain, metres squared.
    taken_m2: f64,
}

/// A stretch of rows whose commands may be lost.
#[derive(Clone, Copy)]
struct Stretch {
    from: usize,
    rows: usize,
    /// By how much less is left, metres squared; in units of the scatter it is a chi-square.
    gain_m2: f64,
    /// Square of what it makes, metres squared.
    square_m2: f64,
}

impl Walk {
    /// `None` for logs whose command isn't held, or whose drive was seen, and for a plant whose play lets no pulse through.
    fn of_commands(bench: &Bench<'_>, index: usize, chain: &Chain, residual_m: &[f64]) -> Option<Self> {
        let log = bench.records[index].log;
        if log.meta.hold != Hold::Zoh || log.drive_v.is_some() {
            return None;
        }
        let pulse_m = pulse(chain, log.dt_s, log.meta.latency_s)?;
        Some(Self::new(&bench.records[index], log.command_v.clone(), Instead::Last, &pulse_m, residual_m))
    }

    /// Readings: what was predicted is what they should have been, and a row's echo is itself.
    fn of_readings(bench: &Bench<'_>, index: usize, residual_m: &[f64], instead: Instead) -> Self {
        let record = &bench.records[index];
        let predicted_m = record.log.displacement_m.iter().zip(residual_m).map(|(y, r)| y - r).collect();
        let mut pulse = [0.0; READING_ROWS];
        pulse[0] = 1.0;
        Self::new(record, predicted_m, instead, &pulse, residual_m)
    }

    fn new(record: &Record<'_>, given: Vec<f64>, instead: Instead, pulse_m: &[f64], residual_m: &[f64]) -> Self {
        let ahead = pulse_m.len();
        // Nothing for so long before and after that every mean is over as many rows as those of a log.
        let mut alone_m = vec![0.0; 5 * ahead];
        alone_m[2 * ahead..3 * ahead].copy_from_slice(pulse_m);
        let echo_m = without_slow(&alone_m, ahead)[ahead..4 * ahead].to_vec();
        let shifted = |by: usize| echo_m.iter().skip(by).zip(&echo_m).map(|(a, b)| a * b).sum::<f64>();
        let products_m2 = (0..IN_A_ROW).map(shifted).collect();
        let mut left_m = without_slow(residual_m, ahead);
        left_m[..record.run_in].fill(0.0);
        Self {
            held: given.clone(),
            is_lost: vec![false; given.len()],
            given,
            instead,
            left_m,
            echo_m,
            ahead,
            products_m2,
            first: record.run_in.max(instead.rows()),
            noise2: record.noise_m.powi(2),
            taken: Vec::new(),
            visible: Vec::new(),
        }
    }

    /// Sum of squares beyond the noise.
    fn power_m2(&self) -> f64 {
        (self.left_m.iter().map(|v| v * v).sum::<f64>() - self.noise2 * (self.given.len() - self.first) as f64).max(0.0)
    }

    fn searched(mut self) -> Walked {
        let rows = self.given.len();
        let before_m2 = self.power_m2();
        let mean = self.given.iter().sum::<f64>() / rows.max(1) as f64;
        for _ in 0..PASSES {
            let found = self.taken.len();
            self.visible = Vec::new();
            let scatter_m = TO_SIGMA * median_magnitude(self.left_m.clone());
            let unit2 = self.noise2.max(scatter_m * scatter_m);
            for from in (self.first..rows).step_by(BLOCK) {
                self.search_block(from..(from + BLOCK).min(rows), unit2);
            }
            let alone = |k: usize| (self.shown(k, k) - self.given[k]).powi(2) * self.products_m2[0];
            let visible = |row: usize| Visible {
                row: row as u32,
                step: (self.given[row] - self.given[row - 1]).abs() as f32,
                level: (self.given[row] - mean) as f32,
            };
            self.visible = (self.first..rows).filter(|&k| alone(k) > CERTAIN * unit2).map(visible).collect();
            if self.taken.len() == found {
                break;
            }
        }
        Walked {
            power_m2: [before_m2, self.power_m2()],
            shares: self.taken.iter().map(|stretch| self.share(stretch)).collect(),
            held: self.held,
            is_lost: self.is_lost,
            visible: self.visible,
            taken_m2: self.taken.iter().map(|stretch| stretch.gain_m2).sum(),
        }
    }

    fn search_block(&mut self, block: std::ops::Range<usize>, unit2: f64) {
        // How far a stretch that was taken changes what others gain.
        let reach = self.echo_m.len() + IN_A_ROW;
        let mut matched: Vec<f64> = block.clone().map(|k| self.matched(k)).collect();
        let of = |walk: &Self, matched: &[f64], k: usize| walk.best(matched, block.start, k, unit2);
        let mut best: Vec<Option<Stretch>> = block.clone().map(|k| of(self, &matched, k)).collect();
        while let Some(stretch) = best.iter().flatten().copied().max_by(|a, b| a.gain_m2.total_cmp(&b.gain_m2)) {
            self.take(stretch);
            let near = stretch.from.saturating_sub(reach).max(block.start)..(stretch.from + reach).min(block.end);
            for k in near.clone() {
                matched[k - block.start] = self.matched(k);
            }
            for k in near {
                best[k - block.start] = of(self, &matched, k);
            }
        }
    }

    /// What is left around row `k` along the echo of a pulse there.
    fn matched(&self, k: usize) -> f64 {
        let first = k as isize - self.ahead as isize;
        let skipped = first.min(0).unsigned_abs();
        let from = first.max(0) as usize;
        self.left_m[from..].iter().zip(&self.echo_m[skipped..]).map(|(r, h)| r * h).sum()
    }

    /// What `row` of a stretch that begins at row `from` shows.
    fn shown(&self, from: usize, row: usize) -> f64 {
        match self.instead {
            Instead::Last => self.held[from - 1],
            Instead::Older(rows) => self.given[row - rows],
            Instead::Mean(rows) => self.given[row - rows..row].iter().sum::<f64>() / rows as f64,
        }
    }

    /// The stretch from row `k` on that gains most, if one is certain.
    fn best(&self, matched: &[f64], start: usize, k: usize, unit2: f64) -> Option<Stretch> {
        let (mut along, mut square) = (0.0, 0.0);
        let mut heights: [f64; IN_A_ROW] = [0.0; IN_A_ROW];
        let mut best: Option<Stretch> = None;
        for i in 0..IN_A_ROW {
            let row = k + i;
            if row - start >= matched.len() || self.is_lost[row] {
                break;
            }
            let height = self.shown(k, row) - self.given[row];
            heights[i] = height;
            along += height * matched[row - start];
            let crossed: f64 = (0..i).map(|j| heights[j] * self.products_m2[i - j]).sum();
            square += height * (height * self.products_m2[0] + 2.0 * crossed);
            let gain_m2 = 2.0 * along - square;
            if gain_m2 > CERTAIN * unit2 && best.is_none_or(|best| gain_m2 > best.gain_m2) {
                best = Some(Stretch { from: k, rows: i + 1, gain_m2, square_m2: square });
            }
        }
        best
    }

    fn take(&mut self, stretch: Stretch) {
        for row in stretch.from..stretch.from + stretch.rows {
            let shown = self.shown(stretch.from, row);
            let height = shown - self.given[row];
            let first = row as isize - self.ahead as isize;
            for (k, h) in self.echo_m.iter().enumerate() {
                if let Ok(at) = usize::try_from(first + k as isize)
                    && let Some(left_m) = self.left_m.get_mut(at)
                {
                    *left_m -= height * h;
                }
            }
            self.held[row] = shown;
            self.is_lost[row] = true;
        }
        self.taken.push(stretch);
    }

    /// Height that is seen of a stretch that was taken, over the height that it would have: what is left now, with all others taken as well, adds to the
    /// whole of it. When it was taken the echoes of its neighbours were there still.
    fn share(&self, stretch: &Stretch) -> f64 {
        let rows = stretch.from..stretch.from + stretch.rows;
        let along: f64 = rows.map(|row| (self.held[row] - self.given[row]) * self.matched(row)).sum();
        1.0 + along / stretch.square_m2
    }
}

/// What one volt over one sample makes of the displacement from that row on, until it has died away; metres per volt.
/// `None` where nothing comes through.
pub(super) fn pulse(chain: &Chain, sample_s: f64, latency_s: f64) -> Option<Vec<f64>> {
    let play = |volts: f64| {
        let mut simulator = Simulator::new(chain, sample_s, latency_s);
        let reading = |k: usize| {
            let reading_m = simulator.reading_m();
            simulator.advance(Held::zero_order(if k == 0 { volts } else { 0.0 }), 0.0);
            reading_m
        };
        (0..LONGEST_ECHO).map(reading).collect::<Vec<f64>>()
    };
    let mut pulse_m: Vec<f64> = play(1.0).iter().zip(play(0.0)).map(|(with, without)| with - without).collect();
    let peak_m = pulse_m.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    let last = pulse_m.iter().rposition(|v| v.abs() > ECHO_ENDS * peak_m)?;
    pulse_m.truncate(last + 1);
    Some(pulse_m)
}

/// `values` less their mean over `half` rows to either side.
fn without_slow(values: &[f64], half: usize) -> Vec<f64> {
    let mut sums = vec![0.0];
    for value in values {
        sums.push(sums[sums.len() - 1] + value);
    }
    let mean = |k: usize| {
        let (from, to) = (k.saturating_sub(half), (k + half + 1).min(values.len()));
        (sums[to] - sums[from]) / (to - from) as f64
    };
    values.iter().enumerate().map(|(k, value)| value - mean(k)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::model::Model;
    use plant_sim::replay::{Start, predict};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// A log of the thesis' plant whose drive followed what `acting` makes of the commands, with 20 nm of noise.
    fn log(acting: impl Fn(&[f64]) -> Vec<f64>) -> (Model, Log) {
        let model = thesis();
        let mut random = Pcg64::seed_from_u64(5);
        let command_v: Vec<f64> =
            (0..6000).map(|k| 25.0 * (0.02 * f64::from(k)).sin() + 12.0 * (0.11 * f64::from(k)).sin()).collect();
        let mut log = Log { dt_s: 5e-5, displacement_m: vec![0.0; 6000], ..Log::default() };
        log.meta.hold = Hold::Zoh;
        log.command_v = acting(&command_v);
        let chain = model.chain();
        log.displacement_m = predict(&chain, &log, &Start::relaxed(&chain), log.len());
        log.displacement_m.iter_mut().for_each(|y| *y += 20e-9 * random.random_range(-1.7..1.7));
        log.command_v = command_v;
        (model, log)
    }

    #[test]
    fn a_play_that_swallows_a_pulse_says_nothing_of_losses() {
        let (model, log) = log(<[f64]>::to_vec);
        let mut chain = model.chain();
        chain.sensor.play_m = 2e-6;
        assert_eq!(pulse(&chain, log.dt_s, log.meta.latency_s), None);
        let bench = Bench::new(&model, vec![record(&log, &chain, None)]);
        assert!(Walk::of_commands(&bench, 0, &chain, &vec![0.0; log.len()]).is_none());
    }

    fn found(model: &Model, log: &Log) -> (Vec<bool>, Option<Losses>) {
        let chain = model.chain();
        let bench = Bench::new(model, vec![record(log, &chain, None)]);
        let predicted_m = predict(&chain, log, &Start::relaxed(&chain), log.len());
        let residual_m: Vec<f64> = log.displacement_m.iter().zip(predicted_m).map(|(y, p)| y - p).collect();
        let walk = Walk::of_commands(&bench, 0, &chain, &residual_m).expect("held commands").searched();
        (walk.is_lost.clone(), judged(Lost::Commands, vec![walk]))
    }

    #[test]
    fn commands_that_never_arrived_are_found_row_by_row() {
        // Where the commands step by half a volt and more: less would not show.
        let lost = [300, 301, 910, 1777, 1778, 1779, 2500, 3600, 3620, 4800];
        let hold = |command_v: &[f64]| {
            let mut acting = command_v.to_vec();
            lost.iter().for_each(|&k| acting[k] = acting[k - 1]);
            acting
        };
        let (model, log) = log(hold);
        let (is_lost, applied) = found(&model, &log);
        let rows: Vec<usize> = (0..is_lost.len()).filter(|&k| is_lost[k]).collect();
        assert_eq!(rows, lost);
        let mut applied = applied.expect("losses");
        assert!((applied.share * 6000.0 / 10.0 - 1.0).abs() < 0.5, "{}", applied.share);
        assert_eq!(applied.logs(std::slice::from_ref(&log))[0].command_v, hold(&log.command_v));
    }

    /// One command of twelve: each echo has two others in it.
    #[test]
    fn commands_whose_echoes_overlap_are_found() {
        let mut random = Pcg64::seed_from_u64(3);
        let is_lost: Vec<bool> = (0..6000).map(|k| k > 200 && random.random_range(0.0..1.0) < 0.08).collect();
        let hold = |command_v: &[f64]| {
            let mut acting = command_v.to_vec();
            (1..acting.len()).filter(|&k| is_lost[k]).for_each(|k| acting[k] = acting[k - 1]);
            acting
        };
        let (model, log) = log(hold);
        let (_, applied) = found(&model, &log);
        let applied = applied.expect("losses");
        assert!((applied.share / 0.08 - 1.0).abs() < 0.25, "{}", applied.share);
    }

    /// The log of [`log`] with readings as `reading` makes them of the plant's displacement, before the noise.
    fn stayed(reading: impl Fn(&[f64]) -> Vec<f64>) -> (Vec<bool>, bool) {
        let (model, mut log) = log(<[f64]>::to_vec);
        let chain = model.chain();
        let predicted_m = predict(&chain, &log, &Start::relaxed(&chain), log.len());
        let noise_m: Vec<f64> = log.displacement_m.iter().zip(&predicted_m).map(|(y, p)| y - p).collect();
        let read_m = reading(&predicted_m);
        log.displacement_m = read_m.iter().zip(&noise_m).map(|(y, noise)| y + noise).collect();
        let residual_m: Vec<f64> = log.displacement_m.iter().zip(&predicted_m).map(|(y, p)| y - p).collect();
        let bench = Bench::new(&model, vec![record(&log, &chain, None)]);
        let found = insteads().filter_map(|instead| {
            judged(Lost::Readings, vec![Walk::of_readings(&bench, 0, &residual_m, instead).searched()])
        });
        closest(found).map_or((vec![false; log.len()], false), |mut losses| (losses.is_lost.remove(0), true))
    }

    #[test]
    fn readings_that_stayed_are_found_though_each_has_noise_of_its_own() {
        let lost = [300, 301, 910, 1777, 1778, 1779, 2510, 3600, 3620, 4810];
        let hold = |y: &[f64]| {
            let mut read = y.to_vec();
            lost.iter().for_each(|&k| read[k] = read[k - 1]);
            read
        };
        let (is_lost, is_found) = stayed(hold);
        assert_eq!((0..is_lost.len()).filter(|&k| is_lost[k]).collect::<Vec<_>>(), lost);
        assert!(is_found);
    }

    #[test]
    fn rows_that_show_an_older_reading_or_the_mean_of_some_are_found() {
        let lost = [300, 911, 1777, 2510, 3620, 4810, 5204];
        let older = |y: &[f64]| {
            let mut read = y.to_vec();
            lost.iter().for_each(|&k| read[k] = y[k - 4]);
            read
        };
        let filled = |y: &[f64]| {
            let (mut read, mut mean) = (y.to_vec(), 0.0);
            for k in 0..y.len() {
                if lost.contains(&k) {
                    read[k] = mean;
                }
                mean += (y[k] - mean) / 3.6;
            }
            read
        };
        for (is_lost, is_found) in [stayed(older), stayed(filled)] {
            assert!(is_found);
            assert_eq!((0..is_lost.len()).filter(|&k| is_lost[k]).collect::<Vec<_>>(), lost);
        }
    }

    #[test]
    fn readings_that_are_late_jittery_or_stick_stayed_nowhere() {
        let mut random = Pcg64::seed_from_u64(6);
        let shifts: Vec<f64> = (0..6000).map(|_| random.random_range(-0.6..0.6)).collect();
        let jittery = |y: &[f64]| -> Vec<f64> {
            (0..y.len()).map(|k| y[k] + shifts[k] * (y[k.saturating_sub(1)] - y[k])).collect()
        };
        let late = |y: &[f64]| -> Vec<f64> { (0..y.len()).map(|k| y[k.saturating_sub(1)]).collect() };
        // A reading that sticks until the displacement is a micrometre away.
        let sticking = |y: &[f64]| -> Vec<f64> {
            let mut at_m = 0.0;
            y.iter()
                .map(|y| {
                    if (y - at_m).abs() > 1e-6 {
                        at_m = *y;
                    }
                    at_m
                })
                .collect()
        };
        assert!(!stayed(jittery).1, "jitter");
        assert!(!stayed(late).1, "late");
        assert!(!stayed(sticking).1, "sticking");
    }

    #[test]
    fn what_is_late_slow_or_whole_lost_nothing() {
        let late = |by: f64| {
            move |command_v: &[f64]| -> Vec<f64> {
                (0..command_v.len())
                    .map(|k| command_v[k] + by * (command_v[k.saturating_sub(1)] - command_v[k]))
                    .collect()
            }
        };
        let slow = |command_v: &[f64]| {
            let mut at_v = 0.0;
            let step = |v: &f64| {
                at_v += (v - at_v).clamp(-0.9, 0.9);
                at_v
            };
            command_v.iter().map(step).collect()
        };
        let (model, whole) = log(<[f64]>::to_vec);
        assert!(found(&model, &whole).0.iter().all(|is_lost| !is_lost));
        for (model, log) in [log(late(0.3)), log(late(1.0)), log(slow)] {
            assert!(found(&model, &log).1.is_none());
        }
    }
}
