//! Is a readable log also a believable one? Plain lines for a person; nothing is refused here.

use super::Log;

/// No piezo stage moves further, metres. Ten times the longest levered stages (1 mm).
const MAX_SPAN_M: f64 = 10e-3;

/// No actuator moves less, metres per volt. A bare shear plate moves some 100 pm per volt.
const MIN_SENSITIVITY_M_PER_V: f64 = 1e-12;

/// No piezo driver commands more, volts.
const MAX_COMMAND_V: f64 = 2e3;

/// Fewest equal samples at an extreme that are called clipping.
const MIN_CLIPPED_SAMPLES: usize = 8;

/// Share of the command's span that has to pass while the displacement stands still at an extreme. The crest of a
/// sine seen by an 8-bit converter stays in one step for 0.4 % of the span.
const MIN_CLIPPED_COMMAND: f64 = 0.05;

/// What looks wrong with a log: wrong units, no excitation, a dead or clipped sensor, lost records. Each one a line.
pub fn warnings(log: &Log) -> Vec<String> {
    lines(log, true)
}

/// The same of the first rows of a log that is longer, without what only all of its rows could say.
pub fn warnings_of_head(head: &Log) -> Vec<String> {
    lines(head, false)
}

fn lines(log: &Log, is_whole: bool) -> Vec<String> {
    let mut lines = Vec::new();
    let mut warn = |line: String| lines.push(format!("{}: {line}", log.name));
    let (low_m, high_m) = extremes(&log.displacement_m);
    let (low_v, high_v) = extremes(&log.command_v);
    let span_m = high_m - low_m;
    let span_v = high_v - low_v;

    if is_whole && span_v == 0.0 {
        warn(format!("the command is {low_v} V throughout: nothing is excited, so nothing can be identified"));
    }
    if is_whole && span_m == 0.0 {
        warn(format!(
            "the displacement is {} um throughout: is the sensor connected, is it the right column?",
            low_m * 1e6
        ));
    }
    if span_m > MAX_SPAN_M {
        warn(format!(
            "the displacement spans {:.4} mm, more than a piezo moves: is the file in another unit than um? give --scale displacement=1e-9 for nm",
            span_m * 1e3
        ));
    } else if span_m > 0.0 && span_m < MIN_SENSITIVITY_M_PER_V * span_v {
        warn(format!(
            "the displacement spans {:.4} pm for {span_v} V, less than a piezo moves: is the file in another unit than um? give --scale displacement=1 for m or 1e-3 for mm",
            span_m * 1e12
        ));
    }
    let length_s = log.len() as f64 * log.dt_s;
    if is_whole && log.meta.latency_s >= length_s {
        warn(format!(
            "its latency, latency_us of {} us, is as long as the log of {length_s:.4} s or longer: no command of it acts",
            log.meta.latency_s * 1e6
        ));
    }
    let peak_v = low_v.abs().max(high_v.abs());
    if peak_v > MAX_COMMAND_V {
        warn(format!(
            "the command reaches {peak_v} V, more than a piezo driver gives: is the file in mV? give --scale command=1e-3"
        ));
    }
    for (word, extreme_m) in [("highest", high_m), ("lowest", low_m)] {
        if span_m == 0.0 || span_v == 0.0 {
            continue;
        }
        if let Some((row, n, moved_v)) = clipped(log, extreme_m, span_v) {
            warn(format!(
                "the displacement stands at its {word} value for {n} samples from row {row} while the command moves by {moved_v:.3} V: the sensor is clipped or the stage at its stop"
            ));
        }
    }
    if let Some(rate_hz) = log.meta.rate_hz {
        let off = rate_hz * log.dt_s - 1.0;
        // The reader takes the stated rate where the times agree with it, so any difference is a disagreement.
        if off.abs() > 1e-9 {
            warn(format!(
                "rate_hz says {rate_hz} Hz, the times say {:.9} Hz ({:+.1} ppm): the times are used",
                log.dt_s.recip(),
                -1e6 * off
            ));
        }
    }
    if let Some(seq) = &log.seq {
        let jump = |pair: &[f64]| pair[1] - pair[0] != 1.0 && pair[1] > pair[0];
        let n_jumps = seq.windows(2).filter(|pair| jump(pair)).count();
        if let Some(row) = seq.windows(2).position(jump) {
            warn(format!(
                "the sequence number jumps {n_jumps} times, first after row {row}: records were lost although the times do not show it"
            ));
        }
    }
    lines
}

/// The longest stretch at an extreme during which the command moved on: first row, samples, volts.
fn clipped(log: &Log, extreme_m: f64, span_v: f64) -> Option<(usize, usize, f64)> {
    let mut longest: Option<(usize, usize, f64)> = None;
    let mut from = 0;
    while from < log.displacement_m.len() {
        let n = log.displacement_m[from..].iter().take_while(|&&value| value == extreme_m).count();
        if n >= MIN_CLIPPED_SAMPLES {
            let (low_v, high_v) = extremes(log.command_v.get(from..from + n).unwrap_or_default());
            let moved_v = high_v - low_v;
            if moved_v > MIN_CLIPPED_COMMAND * span_v && longest.is_none_or(|(_, most, _)| n > most) {
                longest = Some((from, n, moved_v));
            }
        }
        from += n.max(1);
    }
    longest
}

fn extremes(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &value| (low.min(value), high.max(value)))
}
