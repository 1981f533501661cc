//! What makes a diagnosis impossible, and what it must be warned of: judged from the logs before anything is fitted.

use super::bench::Bench;
use super::hypothesis::{Freedom, Hypothesis};
use super::normal::reader;
use crate::identify::RunIn;
use plant_sim::log::{self, Log};
use rayon::prelude::*;

/// Fewest rows that a log must have after its run-in: each stretch that is held out needs some.
const LEAST_ROWS: usize = 200;
/// Gains of two logs that differ by more than this are in different units: no effect does that, and a prefix of the SI is 1000.
const OTHER_UNIT: f64 = 30.0;
/// A log's response counts as one if it correlates with the prediction by this much.
const CORRELATED: f64 = 0.5;
/// Rows that a check looks at: so many say it as well as all.
const LOOKED_AT: usize = 200_000;
/// Share of a prediction's squares that is rounding.
const ROUNDING: f64 = 1e-12;
/// Rates that differ by more than this are different.
const SAME_RATE: f64 = 1e-3;

/// Why there is no diagnosis.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DiagnoseError {
    /// No log.
    #[error("no log to diagnose from: name at least one")]
    NoLog,
    /// An entry that the registry lacks was to be struck out.
    #[error("{id:?} is no entry of the registry: did you mean {nearest:?}? `hysteron effects` lists all")]
    NoSuchEntry {
        /// As given.
        id: String,
        /// What it resembles.
        nearest: &'static str,
    },
    /// The loop whose error was to be predicted can't run.
    #[error("the loop to predict: {reason}")]
    ClosedLoop {
        /// What is wrong and what would do.
        reason: String,
        /// Whether a file that the reference names is at fault, and not the call.
        in_file: bool,
    },
    /// Too little left after the run-in.
    #[error(
        "{log}: {rows} rows are left after {run_in}; at least {LEAST_ROWS} are needed: {} or record longer",
        run_in.how_to_shorten()
    )]
    TooFewRows {
        /// The log.
        log: String,
        /// Rows left.
        rows: usize,
        /// The run-in.
        run_in: RunIn,
    },
    /// No command moves.
    #[error("{logs}: the command never changes, so nothing shows what the plant does: drive it with steps or sines")]
    NoExcitation {
        /// The logs.
        logs: String,
    },
    /// The displacement doesn't move although the command does.
    #[error("{log}: the displacement never changes while the command does: check the sensor and its column")]
    NoResponse {
        /// The log.
        log: String,
    },
    /// Logs that can't be of one bench in one unit.
    #[error(
        "{log} moves {ratio} times as far as {other} for the same volts: the logs disagree in units or sign; convert the odd one, or name its unit in its column's name"
    )]
    UnitsDisagree {
        /// The log that stands out.
        log: String,
        /// One of the others.
        other: String,
        /// Ratio of the gains.
        ratio: String,
    },
    /// All logs respond far more, or far less, than the plant.
    #[error(
        "{log} moves {ratio} times as far as the plant for the same volts: check the units of the logs (--scale) and of the plant's file"
    )]
    OtherUnits {
        /// The log in the middle.
        log: String,
        /// Ratio of the gains.
        ratio: String,
    },
    /// The nominal plant is farther from the logs than standing still would be.
    #[error(
        "the plant does not belong to these logs: its gap is {percent:.0} % of the displacement's rms ({log} {log_percent:.0} %), more than no motion at all would leave{hint}"
    )]
    OtherPlant {
        /// Gap over displacement, all logs.
        percent: f64,
        /// The worst log.
        log: String,
        /// .. and its gap.
        log_percent: f64,
        /// What might have happened.
        hint: &'static str,
    },
    /// The prediction is not finite.
    #[error("{log}: the plant's prediction is not finite: check the units in the plant's file")]
    Diverges {
        /// The log.
        log: String,
    },
}

/// A log's response against the nominal prediction.
struct Response {
    /// Measured per predicted, means taken out.
    slope: f64,
    correlation: f64,
    gap_m2: f64,
    displacement_m2: f64,
}

/// Refuses logs that hold nothing to go by, rows of `run_in` left out.
pub(super) fn check_rows(logs: &[Log], run_in: &dyn Fn(&Log) -> usize) -> Result<(), DiagnoseError> {
    for log in logs {
        let run_in = run_in(log);
        let rows = log.len().saturating_sub(run_in);
        if rows < LEAST_ROWS {
            return Err(DiagnoseError::TooFewRows { log: log.name.clone(), rows, run_in: RunIn::new(log, run_in) });
        }
        if is_constant(&log.displacement_m[run_in..]) && !is_constant(&log.command_v[run_in..]) {
            return Err(DiagnoseError::NoResponse { log: log.name.clone() });
        }
    }
    Ok(())
}

fn is_constant(values: &[f64]) -> bool {
    values.iter().all(|v| *v == values[0])
}

/// Refuses logs without excitation, logs that disagree among themselves, and a plant that is not theirs.
///
/// Held-out logs may lack excitation: they are only scored.
pub(super) fn check_plant(bench: &Bench<'_>, needs_excitation: bool) -> Result<(), DiagnoseError> {
    let moving: Vec<usize> =
        (0..bench.records.len()).filter(|&i| !is_constant(&bench.records[i].log.command_v)).collect();
    if moving.is_empty() && !needs_excitation {
        return Ok(());
    }
    if moving.is_empty() {
        let names: Vec<&str> = bench.records.iter().map(|r| r.log.name.as_str()).collect();
        return Err(DiagnoseError::NoExcitation { logs: names.join(", ") });
    }
    let name = |index: usize| bench.records[index].log.name.clone();
    let responses =
        // In order, so that which log an error names does not hang on the number of threads.
        moving.par_iter().map(|&index| respond(bench, index)).collect::<Vec<_>>();
    let responses: Vec<(usize, Response)> =
        moving.iter().zip(responses).map(|(&index, one)| one.map(|r| (index, r))).collect::<Result<_, _>>()?;
    let clear: Vec<&(usize, Response)> = responses.iter().filter(|(_, r)| r.correlation.abs() > CORRELATED).collect();
    // The middle log is the unit of all; what is far from it stands out.
    let mut sorted: Vec<&(usize, Response)> = clear.clone();
    sorted.sort_by(|a, b| a.1.slope.abs().total_cmp(&b.1.slope.abs()));
    if let Some((usual, middle)) = sorted.get(sorted.len() / 2) {
        let in_words = |ratio: f64| if ratio.abs() < 1.0 { format!("{ratio:.1e}") } else { format!("{ratio:.0}") };
        for (index, response) in &clear {
            let ratio = response.slope / middle.slope;
            if index != usual && !(1.0 / OTHER_UNIT..OTHER_UNIT).contains(&ratio) {
                let (log, other) = (name(*index), name(*usual));
                return Err(DiagnoseError::UnitsDisagree { log, other, ratio: in_words(ratio) });
            }
        }
        if !(1.0 / OTHER_UNIT..OTHER_UNIT).contains(&middle.slope.abs()) {
            return Err(DiagnoseError::OtherUnits { log: name(*usual), ratio: in_words(middle.slope) });
        }
    }
    let percent = |gap_m2: f64, displacement_m2: f64| 100.0 * (gap_m2 / displacement_m2.max(f64::MIN_POSITIVE)).sqrt();
    let sum = |of: fn(&Response) -> f64| responses.iter().map(|(_, r)| of(r)).sum::<f64>();
    let all = percent(sum(|r| r.gap_m2), sum(|r| r.displacement_m2));
    if all > 100.0 {
        let (worst, response) =
            responses.iter().max_by(|a, b| a.1.gap_m2.total_cmp(&b.1.gap_m2)).unwrap_or(&responses[0]);
        let slope = clear.first().map_or(1.0, |(_, r)| r.slope);
        let hint = if slope < 0.0 {
            "; they move the other way: turn their sign with --scale displacement=-1e-6"
        } else {
            "; name the plant that was measured, or identify one"
        };
        return Err(DiagnoseError::OtherPlant {
            percent: all,
            log: name(*worst),
            log_percent: percent(response.gap_m2, response.displacement_m2),
            hint,
        });
    }
    Ok(())
}

fn respond(bench: &Bench<'_>, index: usize) -> Result<Response, DiagnoseError> {
    let record = &bench.records[index];
    let hypothesis = Hypothesis::nominal(Freedom::Relaxed);
    let z = bench.origin(&hypothesis);
    let mut reader = reader(bench, &hypothesis, &z, index);
    let rows = record.log.len().min(record.run_in + LOOKED_AT);
    let (mut n, mut y, mut p, mut yy, mut pp, mut yp) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (k, &measured) in record.log.displacement_m[..rows].iter().enumerate() {
        let predicted = reader.next_m();
        if k >= record.run_in {
            n += 1.0;
            y += measured;
            p += predicted;
            yy += measured * measured;
            pp += predicted * predicted;
            yp += measured * predicted;
        }
    }
    if !(p.is_finite() && pp.is_finite()) {
        return Err(DiagnoseError::Diverges { log: record.log.name.clone() });
    }
    // What is left of a prediction that never moves is rounding.
    let moves = pp - p * p / n > ROUNDING * pp;
    let (yy, pp, yp) = (yy - y * y / n, pp - p * p / n, yp - y * p / n);
    Ok(Response {
        slope: if moves { yp / pp } else { 0.0 },
        correlation: if moves { yp / (yy * pp).sqrt().max(f64::MIN_POSITIVE) } else { 0.0 },
        gap_m2: if moves { (yy - 2.0 * yp + pp).max(0.0) } else { yy },
        displacement_m2: yy,
    })
}

/// What looks wrong without making a diagnosis impossible.
pub(super) fn warnings(logs: &[Log], held_out: &[Log]) -> Vec<String> {
    let all = || logs.iter().chain(held_out);
    let mut lines: Vec<String> = all().flat_map(log::warnings).collect();
    if let Some(first) = logs.first()
        && let Some(other) = all().find(|log| (log.dt_s / first.dt_s - 1.0).abs() > SAME_RATE)
    {
        lines.push(format!(
            "{} is sampled at {:.6} Hz and {} at {:.6} Hz: each is followed at its own rate, but a slow log says little of fast effects",
            first.name,
            first.dt_s.recip(),
            other.name,
            other.dt_s.recip()
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;

    /// A log whose only step lies in its run-in responds to nothing; what its sums are off by is rounding.
    #[test]
    fn a_prediction_that_does_not_move_is_no_response() {
        let model = thesis();
        for volts in (1..20).map(|n| 3.1 * f64::from(n)) {
            let mut log = Log { dt_s: 5e-5, displacement_m: vec![0.0; 9000], ..Log::default() };
            log.command_v = (0..9000).map(|k| if k < 100 { 0.0 } else { volts }).collect();
            log.displacement_m.iter_mut().enumerate().for_each(|(k, y)| *y = 1e-6 * volts + 1e-8 * (k % 7) as f64);
            let bench = Bench::new(&model, vec![record(&log, &model.chain(), Some(0.4))]);
            let Response { slope, correlation, gap_m2, displacement_m2 } = respond(&bench, 0).expect("a response");
            assert_eq!(gap_m2, displacement_m2, "{volts} V: a log that is all gap would be refused by rounding");
            assert!(
                correlation.abs() < CORRELATED && slope.abs() < OTHER_UNIT,
                "{volts} V: {slope:e}, {correlation:e}"
            );
        }
    }
}
