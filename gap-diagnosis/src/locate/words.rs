//! One plain sentence: where the gap lives.

use super::Where;

/// A part is named when it holds this much of the reducible power, ..
const MOST_PERCENT: f64 = 60.0;
/// .. and this many times what its share of the time (or of the logs) would give it anyway.
const STANDS_OUT: f64 = 1.3;

/// Where the gap lives, strongest first: `62 % between 5 and 50 Hz, mostly while the drive falls, in log steps`.
///
/// A part is mentioned only where it holds most of the reducible power and more than its share of the time explains.
pub fn strongest(found: &Where) -> String {
    if found.total.share_percent == 0.0 {
        return "nothing stands out of the noise".to_owned();
    }
    let mut phrases = vec![band(found)];
    let when: Vec<String> = [motion(found), amplitude(found)].into_iter().flatten().collect();
    if !when.is_empty() {
        phrases.push(format!("mostly {}", when.join(" and ")));
    }
    phrases.extend(log(found));
    phrases.extend(growth(found));
    phrases.join(", ")
}

/// The fewest neighbouring bands with most of the power.
fn band(found: &Where) -> String {
    let shares: Vec<f64> = found.bands.iter().map(|band| band.power.share_percent).collect();
    for width in 1..=shares.len() {
        let sums = shares.windows(width).map(|window| window.iter().sum::<f64>()).enumerate();
        let Some((first, share_percent)) = sums.max_by(|a, b| a.1.total_cmp(&b.1)) else {
            break;
        };
        if share_percent >= MOST_PERCENT {
            let (from_hz, to_hz) = (found.bands[first].from_hz, found.bands[first + width - 1].to_hz);
            let range = match (first == 0, first + width == shares.len()) {
                (true, true) => "at all frequencies".to_owned(),
                (true, false) => format!("below {} Hz", plain(to_hz)),
                (false, true) => format!("above {} Hz", plain(from_hz)),
                (false, false) => format!("between {} and {} Hz", plain(from_hz), plain(to_hz)),
            };
            return format!("{share_percent:.0} % {range}");
        }
    }
    // Bands where nothing stands out of the noise one by one, though all together it does.
    "spread over all frequencies".to_owned()
}

/// Rest, rising or falling.
fn motion(found: &Where) -> Option<String> {
    let character = &found.character;
    [
        (character.rest_percent, character.rest_time_percent, "while the drive rests"),
        (character.rising_percent, character.rising_time_percent, "while the drive rises"),
        (character.falling_percent, character.falling_time_percent, "while the drive falls"),
    ]
    .into_iter()
    .find(|&(share_percent, time_percent, _)| stands_out(share_percent, time_percent))
    .map(|(_, _, words)| words.to_owned())
}

/// The outer half of the amplitudes, or less of it, or the inner half.
fn amplitude(found: &Where) -> Option<String> {
    let bins = &found.amplitudes;
    let n = bins.len();
    let sum = |from: usize, to: usize| {
        bins[from..to]
            .iter()
            .fold((0.0, 0.0), |(share, time), bin| (share + bin.power.share_percent, time + bin.time_percent))
    };
    let is_strong = |from: usize, to: usize| {
        let (share_percent, time_percent) = sum(from, to);
        stands_out(share_percent, time_percent)
    };
    if let Some(from) = (n / 2..n).rev().find(|&from| is_strong(from, n)) {
        return Some(format!("at drives beyond {} V", plain(bins[from].from_v)));
    }
    let to = (1..=n / 2).find(|&to| is_strong(0, to))?;
    Some(format!("at drives within {} V", plain(bins[to - 1].to_v)))
}

/// The one log or, in it, the one stretch that holds most.
fn log(found: &Where) -> Option<String> {
    let total_s: f64 = found.logs.iter().map(|log| log.duration_s).sum();
    let most = |a: &f64, b: &f64| a.total_cmp(b);
    let segment = found.segments.iter().max_by(|a, b| most(&a.power.share_percent, &b.power.share_percent))?;
    let name = |log: &str| if found.logs.len() > 1 { format!(" of log {log}") } else { String::new() };
    if segment.power.share_percent >= MOST_PERCENT && found.segments.len() > 1 {
        return Some(format!("between {} and {} s{}", plain(segment.from_s), plain(segment.to_s), name(&segment.log)));
    }
    if found.logs.len() < 2 {
        return None;
    }
    let log = found.logs.iter().max_by(|a, b| most(&a.power.share_percent, &b.power.share_percent))?;
    let time_percent = super::power::percent(log.duration_s, total_s);
    stands_out(log.power.share_percent, time_percent).then(|| format!("in log {}", log.log))
}

fn growth(found: &Where) -> Option<String> {
    // Nine tenths of the power of both quarters together in the last one: (0.9 - 0.1) / 1.
    (found.character.growth > 0.8).then(|| "growing towards the end of the log".to_owned())
}

fn stands_out(share_percent: f64, expected_percent: f64) -> bool {
    share_percent >= MOST_PERCENT && share_percent >= STANDS_OUT * expected_percent
}

/// Two significant digits and no more: `4.6`, `46`, `460`.
fn plain(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = 1 - value.abs().log10().floor() as i32;
    let scale = 10f64.powi(digits);
    format!("{}", (value * scale).round() / scale)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Made, sine};
    use super::super::{locate, strongest};
    use super::plain;

    fn words(made: &[Made]) -> String {
        strongest(&locate(&made.iter().map(Made::trace).collect::<Vec<_>>()))
    }

    #[test]
    fn band_direction_and_log_are_named() {
        let quiet = || Made::new("sine", 2.0, sine(10.0), |_, _, _| 0.0);
        let falling = |_: f64, _: f64, rate: f64| if rate < 0.0 { 1e-7 } else { 0.0 };
        // Half a square wave of 20 Hz: half of its power is the constant, in the lowest band, 4/pi^2 of it the fundamental.
        let found = words(&[quiet(), Made::new("loops", 1.0, sine(20.0), falling)]);
        assert!(found.contains("while the drive falls") && found.ends_with("in log loops"), "{found}");

        let tone = Made::new("tone", 1.0, sine(10.0), |t, _, _| 1e-7 * (std::f64::consts::TAU * 330.0 * t).sin());
        assert_eq!(words(&[tone]), "100 % between 220 and 460 Hz");
    }

    #[test]
    fn rest_amplitude_stretch_and_growth_are_named() {
        let hold = |t: f64| if t < 0.5 { 60.0 * (62.8 * t).sin() } else { 30.0 };
        let creep = words(&[Made::new("hold", 1.0, hold, |t, _, _| if t < 0.6 { 0.0 } else { 1e-6 * (t - 0.6) })]);
        assert!(
            creep.contains("below") && creep.contains("while the drive rests") && creep.contains("growing"),
            "{creep}"
        );
        let clip = words(&[Made::new("clip", 1.0, sine(10.0), |_, v, _| if v.abs() > 50.0 { 1e-7 } else { 0.0 })]);
        assert!(clip.contains("drives beyond 53 V"), "{clip}");
        let burst = |t: f64, _: f64, _: f64| if (0.30..0.35).contains(&t) { 1e-6 } else { 0.0 };
        let burst = words(&[Made::new("burst", 1.0, sine(10.0), burst)]);
        assert!(burst.ends_with("between 0.3 and 0.35 s"), "{burst}");
    }

    #[test]
    fn numbers_have_two_digits() {
        assert_eq!([4.6416, 46.416, 464.16, 10_000.0, 0.0].map(plain), ["4.6", "46", "460", "10000", "0"]);
    }
}
