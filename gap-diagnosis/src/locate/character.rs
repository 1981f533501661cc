//! Numbers that say in words how the residual goes with the motion.

use super::drive::Direction;
use super::power::{Part, percent};
use super::states::scored;
use super::{Harmonics, Trace};
use serde::Serialize;

/// Bins of the drive between minus and plus its largest magnitude, for even, odd and loop parts; even, so that bins come in pairs.
const DRIVE_BINS: usize = 24;

/// How the residual goes with the motion. Percentages are of the reducible power of all logs; they overlap and need not sum to 100.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Character {
    /// A constant per log.
    pub offset_percent: f64,
    /// An odd function of the drive alone: a gain or an odd nonlinearity.
    pub odd_in_drive_percent: f64,
    /// An even function of the drive alone, the offset not counted: asymmetry.
    pub even_in_drive_percent: f64,
    /// Half the difference between rising and falling at the same drive: a loop, from hysteresis or a lag.
    pub loop_percent: f64,
    /// While the drive rises.
    pub rising_percent: f64,
    /// While it falls.
    pub falling_percent: f64,
    /// While it rests, unchanged for more than 20 ms: creep, drift, hum.
    pub rest_percent: f64,
    /// Part of the time in which the drive rises.
    pub rising_time_percent: f64,
    /// Part of the time in which it falls.
    pub falling_time_percent: f64,
    /// Part of the time in which it rests.
    pub rest_time_percent: f64,
    /// Correlation with the predicted displacement, -1 to 1.
    pub displacement_correlation: f64,
    /// Correlation with the predicted velocity: a delay or a lag gives a negative one.
    pub velocity_correlation: f64,
    /// Correlation with the predicted acceleration: a mass or a second lag.
    pub acceleration_correlation: f64,
    /// Excess power in the last quarter of a log against that in the first, (last - first) / (last + first), -1 to 1; mean over the
    /// logs weighted by their excess. Positive: it grows.
    pub growth: f64,
    /// Share of the reducible power in periodic stretches that is the same in every period; none without such a stretch.
    pub coherent_percent: Option<f64>,
}

/// Sums for one correlation, weighted by time.
#[derive(Clone, Copy, Default)]
struct Correlation {
    products: f64,
    squares: f64,
}

impl Correlation {
    fn add(&mut self, residual: f64, other: f64, dt_s: f64) {
        self.products += residual * other * dt_s;
        self.squares += other * other * dt_s;
    }

    fn with(&self, residual_squares: f64) -> f64 {
        let scale = (self.squares * residual_squares).sqrt();
        if scale > 0.0 { self.products / scale } else { 0.0 }
    }
}

pub(super) fn character(
    traces: &[Trace<'_>],
    directions: &[Vec<Direction>],
    harmonics: &Harmonics,
    whole: &Part,
) -> Character {
    let largest_v = traces
        .iter()
        .flat_map(|trace| trace.drive_v)
        .fold(f64::MIN_POSITIVE, |most, value| if value.is_finite() { most.max(value.abs()) } else { most });
    // Rising, falling, rest.
    let mut per_direction = [Part::default(); 3];
    let mut bins = [[Bin::default(); 3]; DRIVE_BINS];
    let mut correlations = [Correlation::default(); 3];
    let (mut centred_m2_s, mut offset_m2_s) = (0.0, 0.0);
    let (mut growth_m2_s, mut quarters_m2_s) = (0.0, 0.0);
    for (trace, directions) in traces.iter().zip(directions) {
        let dt_s = trace.dt_s;
        let n_scored = scored(trace).count().max(1) as f64;
        let mean = |value: &dyn Fn(usize) -> f64| scored(trace).map(value).sum::<f64>() / n_scored;
        let acceleration = |k: usize| trace.slope(k, 1, |k| trace.velocity_m_per_s(k));
        let others: [&dyn Fn(usize) -> f64; 3] =
            [&|k| trace.displacement_m[k], &|k| trace.velocity_m_per_s(k), &acceleration];
        let means = others.map(mean);
        let mean_m = mean(&|k| trace.residual_m[k]);
        // The noise's own mean has the variance noise^2 / N.
        offset_m2_s += (mean_m * mean_m * n_scored - trace.noise_m.powi(2)).max(0.0) * dt_s;
        for k in scored(trace) {
            let residual_m = trace.residual_m[k];
            let direction_idx = match directions[k] {
                Direction::Rising => 0,
                Direction::Falling => 1,
                Direction::Rest => 2,
            };
            let noise_m2_s = trace.noise_m.powi(2) * dt_s;
            per_direction[direction_idx].add(residual_m * residual_m * dt_s, noise_m2_s, dt_s);
            let position = 0.5 * (trace.drive_v[k] / largest_v + 1.0) * DRIVE_BINS as f64;
            bins[(position as usize).min(DRIVE_BINS - 1)][direction_idx].add(
                residual_m - mean_m,
                dt_s,
                noise_m2_s * dt_s,
            );
            centred_m2_s += (residual_m - mean_m).powi(2) * dt_s;
            for ((correlation, other), other_mean) in correlations.iter_mut().zip(others).zip(means) {
                correlation.add(residual_m - mean_m, other(k) - other_mean, dt_s);
            }
        }
        let n = trace.residual_m.len();
        let first_m2_s = super::part(trace, 0, n / 4).reducible_m2_s();
        let last_m2_s = super::part(trace, n - n / 4, n).reducible_m2_s();
        growth_m2_s += last_m2_s - first_m2_s;
        quarters_m2_s += last_m2_s + first_m2_s;
    }
    let reducible_m2_s = whole.reducible_m2_s();
    let share = |energy_m2_s: f64| percent(energy_m2_s, reducible_m2_s);
    let [odd, even, loops] = drive_parts(&bins).map(share);
    let [rising_percent, falling_percent, rest_percent] = per_direction.map(|part| share(part.reducible_m2_s()));
    let [rising_time_percent, falling_time_percent, rest_time_percent] =
        per_direction.map(|part| percent(part.time_s, whole.time_s));
    let [displacement_correlation, velocity_correlation, acceleration_correlation] =
        correlations.map(|correlation| correlation.with(centred_m2_s));
    Character {
        offset_percent: share(offset_m2_s),
        odd_in_drive_percent: odd,
        even_in_drive_percent: even,
        loop_percent: loops,
        rising_percent,
        falling_percent,
        rest_percent,
        rising_time_percent,
        falling_time_percent,
        rest_time_percent,
        displacement_correlation,
        velocity_correlation,
        acceleration_correlation,
        growth: if quarters_m2_s > 0.0 { growth_m2_s / quarters_m2_s } else { 0.0 },
        coherent_percent: harmonics.coherent_percent,
    }
}

/// Sums over the samples of one bin of the drive and one direction.
#[derive(Clone, Copy, Default)]
struct Bin {
    sum_m_s: f64,
    time_s: f64,
    /// Variance of `sum_m_s` by the noise.
    noise_m2_s2: f64,
}

impl Bin {
    fn add(&mut self, centred_m: f64, time_s: f64, noise_m2_s2: f64) {
        self.sum_m_s += centred_m * time_s;
        self.time_s += time_s;
        self.noise_m2_s2 += noise_m2_s2;
    }

    fn and(&self, other: &Self) -> Self {
        Self {
            sum_m_s: self.sum_m_s + other.sum_m_s,
            time_s: self.time_s + other.time_s,
            noise_m2_s2: self.noise_m2_s2 + other.noise_m2_s2,
        }
    }

    fn mean_m(&self) -> f64 {
        self.sum_m_s / self.time_s
    }

    /// Variance of the mean by the noise.
    fn variance_m2(&self) -> f64 {
        self.noise_m2_s2 / (self.time_s * self.time_s)
    }
}

/// Energies of the odd, even and loop part of the residual's mean over the drive, what noise makes of it taken off.
///
/// In a pair of values a, b the parts (a - b)/2 and (a + b)/2 hold their squares times the time spent in both.
fn drive_parts(bins: &[[Bin; 3]; DRIVE_BINS]) -> [f64; 3] {
    let (mut odd_m2_s, mut even_m2_s, mut loop_m2_s) = (0.0, 0.0, 0.0);
    let half = |a: &Bin, b: &Bin, sign: f64| {
        let noise_m2 = 0.25 * (a.variance_m2() + b.variance_m2());
        ((0.5 * (a.mean_m() + sign * b.mean_m())).powi(2) - noise_m2) * (a.time_s + b.time_s)
    };
    let of_all = |idx: usize| bins[idx].iter().fold(Bin::default(), |sum, bin| sum.and(bin));
    for idx in 0..DRIVE_BINS / 2 {
        let (negative, positive) = (of_all(idx), of_all(DRIVE_BINS - 1 - idx));
        if negative.time_s > 0.0 && positive.time_s > 0.0 {
            odd_m2_s += half(&positive, &negative, -1.0);
            even_m2_s += half(&positive, &negative, 1.0);
        }
    }
    for [rising, falling, _] in bins {
        if rising.time_s > 0.0 && falling.time_s > 0.0 {
            loop_m2_s += half(rising, falling, -1.0);
        }
    }
    [odd_m2_s, even_m2_s, loop_m2_s]
}

#[cfg(test)]
mod tests {
    use super::super::locate;
    use super::super::tests::{Made, sine};
    use super::Character;

    fn of(drive: impl Fn(f64) -> f64, residual: impl Fn(f64, f64, f64) -> f64) -> Character {
        locate(&[Made::new("made", 1.0, drive, residual).trace()]).character
    }

    #[test]
    fn even_odd_and_loop_are_told_apart() {
        let gain = of(sine(10.0), |_, v, _| 1e-8 * v);
        // Within a bin of 5 V the residual varies: 1/24^2 of its power is not in the bin's mean.
        assert!(
            gain.odd_in_drive_percent > 98.0 && gain.even_in_drive_percent < 0.5 && gain.loop_percent < 0.5,
            "{gain:?}"
        );
        assert!(gain.displacement_correlation > 0.99 && gain.velocity_correlation.abs() < 0.01);

        // The square's mean is the offset, 2/3 of its power (<s^4> = 3/8, <s^2>^2 = 1/4); the rest is even.
        let square = of(sine(10.0), |_, v, _| 1e-10 * v * v);
        assert!((square.offset_percent - 66.7).abs() < 1.0, "{square:?}");
        assert!((square.even_in_drive_percent - 33.3).abs() < 1.5 && square.odd_in_drive_percent < 0.5, "{square:?}");

        let hysteresis = of(sine(10.0), |_, _, rate| -1e-7 * rate.signum());
        // The direction is known 0.024 V after a turning point, 1 % of the time; bins there mix both signs.
        assert!(hysteresis.loop_percent > 95.0 && hysteresis.odd_in_drive_percent < 0.5, "{hysteresis:?}");
        // A square wave against a cosine: 2 sqrt(2) / pi = 0.90, less for the 4 % of noise.
        assert!((-0.91..-0.86).contains(&hysteresis.velocity_correlation), "{hysteresis:?}");
        assert!((hysteresis.rising_percent - 50.0).abs() < 2.0 && (hysteresis.falling_percent - 50.0).abs() < 2.0);
        assert!(hysteresis.coherent_percent.is_some_and(|percent| percent > 95.0));
    }

    #[test]
    fn an_inertia_goes_with_the_acceleration() {
        let omega = std::f64::consts::TAU * 10.0;
        let inertia = of(sine(10.0), |t, _, _| -1e-7 * (omega * t).sin());
        assert!(inertia.acceleration_correlation > 0.95, "{inertia:?}");
    }

    #[test]
    fn rest_growth_and_offset() {
        let drift = of(|t| if t < 0.1 { 0.0 } else { 40.0 }, |t, _, _| 1e-6 * t);
        assert!(drift.rest_percent > 95.0 && drift.rest_time_percent > 95.0, "{drift:?}");
        // (1 - 0.75^3) against 0.25^3: (0.578 - 0.0156) / (0.578 + 0.0156).
        assert!((drift.growth - 0.947).abs() < 0.01, "{drift:?}");
        assert!(drift.coherent_percent.is_none());
        let offset = of(sine(10.0), |_, _, _| 1e-7);
        assert!((offset.offset_percent - 100.0).abs() < 1.0 && offset.growth.abs() < 0.05, "{offset:?}");
    }
}
