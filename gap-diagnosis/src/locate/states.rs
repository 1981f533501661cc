//! The residual over the state of the plant: per amplitude and rate of the drive, and maps over pairs of states.

use super::drive::{Direction, range, rate_v_per_s};
use super::power::{Part, powers};
use super::{Power, Trace};
use serde::Serialize;

/// Bins of a map per axis; even, so that zero is an edge of a symmetric axis and the sign of a state is told.
const MAP_BINS: usize = 24;
/// Bins of the drive's amplitude.
const AMPLITUDE_BINS: usize = 8;
/// Bins of the drive's rate per decade, and decades below the largest rate.
const RATE_BINS_PER_DECADE: usize = 2;
const RATE_DECADES: usize = 4;
/// Part of the samples that an axis of rates covers; the rest, the edges of steps, falls into its outermost bins.
const RATE_COVER: f64 = 0.995;

/// Where the drive is this far from zero.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct AmplitudeBin {
    /// Lower edge of |drive|.
    pub from_v: f64,
    /// Upper edge.
    pub to_v: f64,
    /// Part of the time spent here.
    pub time_percent: f64,
    /// Residual here.
    #[serde(flatten)]
    pub power: Power,
}

/// Where the drive changes this fast.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RateBin {
    /// Lower edge of |d drive/dt|; the bin from 0 to 0 is the drive at rest.
    pub from_v_per_s: f64,
    /// Upper edge.
    pub to_v_per_s: f64,
    /// Part of the time spent here.
    pub time_percent: f64,
    /// Residual here.
    #[serde(flatten)]
    pub power: Power,
}

/// An axis of a map.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MapAxis {
    /// What it shows.
    pub quantity: &'static str,
    /// Its unit, which is that of `edges`.
    pub unit: &'static str,
    /// Edges of the bins, ascending, one more than bins. What lies beyond counts to the outermost bin.
    pub edges: Vec<f64>,
}

/// The residual over two states. Bins run along x first: `idx = y_bin * (x.edges.len() - 1) + x_bin`.
#[derive(Clone, Debug, Serialize)]
pub struct StateMap {
    /// Horizontal axis.
    pub x: MapAxis,
    /// Vertical axis, finer towards zero: steps and slow sines share one map.
    pub y: MapAxis,
    /// Samples per bin.
    pub count: Vec<u32>,
    /// Mean residual per bin; NaN (null in JSON) without samples.
    pub mean_um: Vec<f64>,
    /// Root mean square of the residual per bin; NaN without samples.
    pub rms_um: Vec<f64>,
}

/// Shares per amplitude (equal bins up to the largest) and per rate (half decades, with rest in a bin of its own).
pub(super) fn amplitudes_and_rates(
    traces: &[Trace<'_>],
    directions: &[Vec<Direction>],
) -> (Vec<AmplitudeBin>, Vec<RateBin>) {
    let largest_v = largest(traces.iter().flat_map(|trace| trace.drive_v.iter().copied()));
    let rates = traces.iter().flat_map(|trace| (0..trace.drive_v.len()).map(move |k| rate_v_per_s(trace, k)));
    let largest_v_per_s = largest(rates);
    let mut per_amplitude = [Part::default(); AMPLITUDE_BINS];
    // Bin 0 is rest.
    let n_moving = RATE_DECADES * RATE_BINS_PER_DECADE;
    let mut per_rate = vec![Part::default(); 1 + n_moving];
    for (trace, directions) in traces.iter().zip(directions) {
        for k in scored(trace) {
            let energy_m2_s = trace.residual_m[k].powi(2) * trace.dt_s;
            let noise_m2_s = trace.noise_m.powi(2) * trace.dt_s;
            let amplitude_idx = (trace.drive_v[k].abs() / largest_v * AMPLITUDE_BINS as f64) as usize;
            per_amplitude[amplitude_idx.min(AMPLITUDE_BINS - 1)].add(energy_m2_s, noise_m2_s, trace.dt_s);
            let rate_idx = if directions[k] == Direction::Rest {
                0
            } else {
                let decades = RATE_DECADES as f64 + (rate_v_per_s(trace, k).abs() / largest_v_per_s).log10();
                // The cast takes what is below the lowest edge, minus infinity included, to bin 0 of the moving ones.
                1 + ((decades * RATE_BINS_PER_DECADE as f64) as usize).min(n_moving - 1)
            };
            per_rate[rate_idx].add(energy_m2_s, noise_m2_s, trace.dt_s);
        }
    }
    let amplitude_edge = |idx: usize| largest_v * idx as f64 / AMPLITUDE_BINS as f64;
    let amplitudes = with_time(&per_amplitude)
        .enumerate()
        .map(|(idx, (power, time_percent))| AmplitudeBin {
            from_v: amplitude_edge(idx),
            to_v: amplitude_edge(idx + 1),
            time_percent,
            power,
        })
        .collect();
    let rate_edge = |idx: usize| match idx {
        0 | 1 => 0.0,
        _ => largest_v_per_s * 10f64.powf((idx - 1) as f64 / RATE_BINS_PER_DECADE as f64 - RATE_DECADES as f64),
    };
    let rates = with_time(&per_rate)
        .enumerate()
        .map(|(idx, (power, time_percent))| RateBin {
            from_v_per_s: rate_edge(idx),
            to_v_per_s: rate_edge(idx + 1),
            time_percent,
            power,
        })
        .collect();
    (amplitudes, rates)
}

/// Maps over (drive, drive rate) and (displacement, velocity).
pub(super) fn maps(traces: &[Trace<'_>]) -> Vec<StateMap> {
    let drive: Vec<&[f64]> = traces.iter().map(|trace| trace.drive_v).collect();
    let displacement: Vec<&[f64]> = traces.iter().map(|trace| trace.displacement_m).collect();
    let drive_rate = |trace_idx: usize, k: usize| rate_v_per_s(&traces[trace_idx], k);
    let velocity = |trace_idx: usize, k: usize| traces[trace_idx].velocity_m_per_s(k);
    vec![
        map(traces, ("drive", "V", 1.0), &drive, ("drive rate", "V/s", 1.0), &drive_rate),
        map(traces, ("displacement", "µm", 1e6), &displacement, ("velocity", "µm/s", 1e6), &velocity),
    ]
}

/// Quantity, unit, and units per SI unit.
type Labelled = (&'static str, &'static str, f64);

fn map(
    traces: &[Trace<'_>],
    x: Labelled,
    x_values: &[&[f64]],
    y: Labelled,
    y_value: &dyn Fn(usize, usize) -> f64,
) -> StateMap {
    let (low, high) =
        x_values.iter().map(|column| range(column)).fold((0.0, 0.0), |a: (f64, f64), b| (a.0.min(b.0), a.1.max(b.1)));
    let high = if high > low { high } else { low + 1.0 };
    let top = cover(traces, y_value);
    let n = MAP_BINS as f64;
    let x_edge = |idx: usize| low + (high - low) * idx as f64 / n;
    // Edges at +-top s^2 for s = -1..1 in equal steps: finer towards zero, where slow motion is.
    let y_edge = |idx: usize| {
        let s = 2.0 * idx as f64 / n - 1.0;
        top * s * s.abs()
    };
    let mut count = vec![0_u32; MAP_BINS * MAP_BINS];
    let mut sum_m = vec![0.0; count.len()];
    let mut squares_m2 = vec![0.0; count.len()];
    for (trace_idx, trace) in traces.iter().enumerate() {
        for k in scored(trace) {
            let (x_at, y_at) = (x_values[trace_idx][k], y_value(trace_idx, k));
            // A negative position casts to bin 0, one beyond the last is held.
            let x_bin = (n * (x_at - low) / (high - low)) as usize;
            let s = (y_at.abs() / top).sqrt().copysign(y_at);
            let y_bin = (0.5 * n * (s + 1.0)) as usize;
            let idx = y_bin.min(MAP_BINS - 1) * MAP_BINS + x_bin.min(MAP_BINS - 1);
            count[idx] += 1;
            sum_m[idx] += trace.residual_m[k];
            squares_m2[idx] += trace.residual_m[k].powi(2);
        }
    }
    let per_sample =
        |sums: &[f64]| -> Vec<f64> { sums.iter().zip(&count).map(|(sum, &n)| sum / f64::from(n)).collect() };
    StateMap {
        x: MapAxis { quantity: x.0, unit: x.1, edges: (0..=MAP_BINS).map(|idx| x.2 * x_edge(idx)).collect() },
        y: MapAxis { quantity: y.0, unit: y.1, edges: (0..=MAP_BINS).map(|idx| y.2 * y_edge(idx)).collect() },
        mean_um: per_sample(&sum_m).iter().map(|mean_m| 1e6 * mean_m).collect(),
        rms_um: per_sample(&squares_m2).iter().map(|mean_m2| 1e6 * mean_m2.sqrt()).collect(),
        count,
    }
}

/// Indices of the samples that are scored.
pub(super) fn scored<'a>(trace: &Trace<'a>) -> impl Iterator<Item = usize> + use<'a> {
    let residual_m = trace.residual_m;
    (0..residual_m.len()).filter(|&k| residual_m[k].is_finite())
}

fn with_time(parts: &[Part]) -> impl Iterator<Item = (Power, f64)> {
    let time_s: f64 = parts.iter().map(|part| part.time_s).sum();
    let times: Vec<f64> = parts.iter().map(|part| super::power::percent(part.time_s, time_s)).collect();
    powers(parts).into_iter().zip(times)
}

/// Largest finite magnitude; 1 where all is zero, so that it can divide.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    let largest = values.filter(|value| value.is_finite()).fold(0.0, |most: f64, value| most.max(value.abs()));
    if largest > 0.0 { largest } else { 1.0 }
}

/// Magnitude below which 99.5 % of the values that are not zero lie; 1 where all is zero. From every 64th value of long logs.
fn cover(traces: &[Trace<'_>], value: &dyn Fn(usize, usize) -> f64) -> f64 {
    let n: usize = traces.iter().map(|trace| trace.residual_m.len()).sum();
    let stride = (n / 200_000).max(1);
    let mut magnitudes: Vec<f64> = traces
        .iter()
        .enumerate()
        .flat_map(|(idx, trace)| (0..trace.residual_m.len()).step_by(stride).map(move |k| (idx, k)))
        .map(|(idx, k)| value(idx, k).abs())
        .filter(|&value| value > 0.0 && value.is_finite())
        .collect();
    if magnitudes.is_empty() {
        return 1.0;
    }
    let place = ((magnitudes.len() - 1) as f64 * RATE_COVER) as usize;
    *magnitudes.select_nth_unstable_by(place, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::super::locate;
    use super::super::tests::{Made, sine};

    #[test]
    fn a_residual_at_large_drive_is_in_the_outer_amplitudes() {
        let clip = |_: f64, v: f64, _: f64| if v.abs() > 53.0 { 1e-6 } else { 0.0 };
        let found = locate(&[Made::new("clip", 1.0, sine(10.0), clip).trace()]);
        assert_eq!(found.amplitudes.len(), 8);
        assert!(found.amplitudes[7].power.share_percent > 96.0, "{:?}", found.amplitudes);
        assert_eq!(found.amplitudes[3].power.share_percent, 0.0);
        let time_percent: f64 = found.amplitudes.iter().map(|bin| bin.time_percent).sum();
        assert!((time_percent - 100.0).abs() < 1e-9);
    }

    #[test]
    fn a_residual_that_follows_the_rate_is_in_the_fast_bins_and_one_at_rest_in_the_first() {
        let fast = Made::new("fast", 1.0, sine(100.0), |_, _, rate| 1e-11 * rate);
        let slow = Made::new("slow", 1.0, sine(1.0), |_, _, rate| 1e-11 * rate);
        let found = locate(&[fast.trace(), slow.trace()]);
        let above: f64 =
            found.rates.iter().filter(|bin| bin.from_v_per_s > 1000.0).map(|bin| bin.power.share_percent).sum();
        assert!(above > 99.0, "{:?}", found.rates);

        let creeping =
            Made::new("step", 1.0, |t| if t < 0.1 { 0.0 } else { 40.0 }, |t, _, _| if t < 0.1 { 0.0 } else { 1e-6 });
        let found = locate(&[creeping.trace()]);
        // All but the 20 ms after the step.
        assert!((found.rates[0].power.share_percent - 100.0 * 0.88 / 0.9).abs() < 0.1, "{:?}", found.rates[0]);
    }

    #[test]
    fn the_maps_show_the_sign_of_a_loop() {
        // Positive while the drive rises, negative while it falls: upper half against lower half of both maps.
        let found = locate(&[Made::new("loop", 1.0, sine(10.0), |_, _, rate| 3e-7 * rate.signum()).trace()]);
        for map in &found.states {
            assert_eq!(map.count.len(), 24 * 24);
            assert_eq!(map.count.iter().map(|&n| u64::from(n)).sum::<u64>(), 20_000);
            for (idx, &n) in map.count.iter().enumerate().filter(|&(_, &n)| n > 30) {
                let y_bin = idx / 24;
                let expected_um = if y_bin >= 12 { 0.3 } else { -0.3 };
                // 20 nm of noise over more than 30 samples: five sigma are 18 nm. At a turning point the sign may differ.
                let is_turning = y_bin == 12 || y_bin == 11;
                assert!(is_turning || (map.mean_um[idx] - expected_um).abs() < 0.02, "{n}: {}", map.mean_um[idx]);
            }
            assert!(map.mean_um.iter().any(|mean_um| mean_um.is_nan()), "a loop leaves most of the plane empty");
        }
        assert_eq!(found.states[1].x.unit, "µm");
        assert!((found.states[1].x.edges[24] - 60.0).abs() < 0.1);
    }
}
