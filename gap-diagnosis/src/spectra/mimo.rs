//! Best linear approximation of a plant with several inputs, driven by periodic multisines of random phase: gain of every pair, and what
//! is noise and what is distortion.
//!
//! Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, sec. 4.3.1 and 2.7: over the
//! realisations, Y = G U in the least-squares sense at each line. What is left over, beyond the noise that the periods tell, is
//! distortion. With R realisations of n inputs R - n residuals are left for each output.

use super::Transform;
use nalgebra::{Complex, DMatrix};

/// Response of one output to one input.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// |G|, output over input.
    pub gain: Vec<f64>,
    /// Phase, degrees, -180 to 180.
    pub phase_deg: Vec<f64>,
}

/// Responses of all pairs.
#[derive(Clone, Debug, PartialEq)]
pub struct Mimo {
    /// Lines, ascending.
    pub frequency_hz: Vec<f64>,
    /// `pairs[output][input]`.
    pub pairs: Vec<Vec<Pair>>,
    /// Largest singular value of the response: what the most willing direction does, whichever axis it is closest to.
    pub largest: Vec<f64>,
    /// Rms amplitude of noise in the mean over the periods of one realisation, per output and line.
    pub noise: Vec<Vec<f64>>,
    /// Rms amplitude of distortion in one realisation, noise taken off, per output and line.
    pub distortion: Vec<Vec<f64>>,
    /// Rms amplitude of the linear part, per output and line.
    pub linear: Vec<Vec<f64>>,
}

/// The mean of a channel's lines over the periods, and the variance of that mean.
type Lines = (Vec<Complex<f64>>, Vec<f64>);

/// Signals as `[realisation][channel][period][sample]`.
pub type Blocks = [Vec<Vec<Vec<f64>>>];

/// Estimates the responses from periodic `inputs` and `outputs` at `rate_hz`, for lines from the first to `highest_hz`; `None` if the
/// shapes don't fit, or if there are not more realisations than inputs, or fewer than two periods.
pub fn mimo(inputs: &Blocks, outputs: &Blocks, rate_hz: f64, highest_hz: f64) -> Option<Mimo> {
    let realisations = inputs.len();
    let n_inputs = inputs.first()?.len();
    let n_outputs = outputs.first()?.len();
    let periods = outputs.first()?.first()?.len();
    let samples = outputs.first()?.first()?.first()?.len();
    let fits = |blocks: &Blocks, channels: usize| {
        blocks.len() == realisations
            && blocks.iter().all(|block| {
                block.len() == channels
                    && block.iter().all(|c| c.len() == periods && c.iter().all(|p| p.len() == samples))
            })
    };
    let enough = realisations > n_inputs && periods > 1 && samples > 2;
    if !enough || !fits(inputs, n_inputs) || !fits(outputs, n_outputs) {
        return None;
    }
    let mut transform = Transform::new(samples);
    // [realisation][channel]: the mean over the periods, and the variance of that mean.
    let mut spectra = |blocks: &Blocks| -> Vec<Vec<Lines>> {
        let mut channel = |periods_of: &Vec<Vec<f64>>| {
            let lines: Vec<Vec<Complex<f64>>> = periods_of
                .iter()
                .map(|p| {
                    let scale = 2.0 / samples as f64;
                    let found = transform.lines(p.iter().copied());
                    found.iter().map(|z| Complex::new(z.re * scale, z.im * scale)).collect()
                })
                .collect();
            let n = lines[0].len();
            let count = periods as f64;
            let mean: Vec<Complex<f64>> =
                (0..n).map(|k| lines.iter().map(|l| l[k]).sum::<Complex<f64>>() / count).collect();
            let spread = |k: usize| lines.iter().map(|l| (l[k] - mean[k]).norm_sqr()).sum::<f64>();
            let variance = (0..n).map(|k| spread(k) / (count - 1.0) / count).collect();
            (mean, variance)
        };
        blocks.iter().map(|block| block.iter().map(&mut channel).collect()).collect()
    };
    let (u, y) = (spectra(inputs), spectra(outputs));
    let step_hz = rate_hz / samples as f64;
    let last = ((highest_hz / step_hz).floor() as usize).min(samples / 2);
    let empty = || Pair { gain: Vec::new(), phase_deg: Vec::new() };
    let mut all = Mimo {
        frequency_hz: (1..=last).map(|k| k as f64 * step_hz).collect(),
        pairs: (0..n_outputs).map(|_| (0..n_inputs).map(|_| empty()).collect()).collect(),
        largest: Vec::new(),
        noise: vec![Vec::new(); n_outputs],
        distortion: vec![Vec::new(); n_outputs],
        linear: vec![Vec::new(); n_outputs],
    };
    for k in 1..=last {
        let of =
            |from: &[Vec<Lines>], channels: usize| DMatrix::from_fn(channels, realisations, |c, r| from[r][c].0[k]);
        let (u, y_k) = (of(&u, n_inputs), of(&y, n_outputs));
        let inverse = (&u * u.adjoint()).try_inverse()?;
        let g = &y_k * u.adjoint() * inverse;
        let linear = &g * &u;
        all.largest.push(g.singular_values().max());
        let left = &y_k - &linear;
        for output in 0..n_outputs {
            for input in 0..n_inputs {
                let value = g[(output, input)];
                all.pairs[output][input].gain.push(value.norm());
                all.pairs[output][input].phase_deg.push(value.arg().to_degrees());
            }
            let noise = y.iter().map(|block| block[output].1[k]).sum::<f64>() / realisations as f64;
            let total = left.row(output).iter().map(|z| z.norm_sqr()).sum::<f64>() / (realisations - n_inputs) as f64;
            let square = linear.row(output).iter().map(|z| z.norm_sqr()).sum::<f64>() / realisations as f64;
            all.noise[output].push(noise.sqrt());
            all.distortion[output].push((total - noise).max(0.0).sqrt());
            all.linear[output].push(square.sqrt());
        }
    }
    Some(all)
}

/// Frequency and value of the highest peak of `gain` between `range_hz`, refined by a parabola through the logarithms around it.
pub fn peak_hz(frequency_hz: &[f64], gain: &[f64], range_hz: [f64; 2]) -> Option<(f64, f64)> {
    let inside = |&k: &usize| (range_hz[0]..=range_hz[1]).contains(&frequency_hz[k]);
    let top = (1..frequency_hz.len().saturating_sub(1)).filter(inside).max_by(|&i, &j| gain[i].total_cmp(&gain[j]))?;
    let [left, middle, right] = [-1i64, 0, 1].map(|d| gain[(top as i64 + d) as usize].ln());
    let curve = left - 2.0 * middle + right;
    let shift = if curve < 0.0 { (0.5 * (left - right) / curve).clamp(-0.5, 0.5) } else { 0.0 };
    let step = frequency_hz[1] - frequency_hz[0];
    Some((frequency_hz[top] + shift * step, (middle - 0.25 * (left - right) * shift).exp()))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{lag, white};
    use super::*;

    /// Two inputs of random lines, an output that lags behind their weighted sum, with a cubic and noise.
    fn made(cubic: f64, noise: f64) -> Mimo {
        let (realisations, periods, n) = (6, 2, 512);
        let mut inputs = Vec::new();
        let mut outputs = Vec::new();
        for r in 0..realisations {
            let u: Vec<Vec<f64>> = (0..2).map(|c| white(n, 10 * r + c)).collect();
            let sum: Vec<f64> = (0..n).map(|i| u[0][i] + 0.5 * u[1][i]).collect();
            let bent: Vec<f64> = sum.iter().map(|x| x + cubic * x * x * x).collect();
            // Three periods, so that the last two are steady.
            let three: Vec<f64> = bent.iter().cycle().take(3 * n).copied().collect();
            let y = lag(&three, 0.8);
            let own = |p: usize| {
                let extra = white(n, 1000 + 10 * r + p as u64);
                (0..n).map(|i| y[(p + 1) * n + i] + noise * extra[i]).collect::<Vec<f64>>()
            };
            inputs.push(u.iter().map(|x| vec![x.clone(); periods]).collect());
            outputs.push(vec![(0..periods).map(own).collect()]);
        }
        mimo(&inputs, &outputs, 512.0, 200.0).expect("shapes fit")
    }

    #[test]
    fn a_linear_plant_has_its_gains_and_no_distortion() {
        let found = made(0.0, 1e-3);
        for (k, hz) in found.frequency_hz.iter().enumerate().step_by(17) {
            let z = Complex::from_polar(1.0, std::f64::consts::TAU * hz / 512.0);
            let h = (Complex::from(0.2) / (z - 0.8)).norm();
            let gain = |input: usize| found.pairs[0][input].gain[k];
            // Noise of 1e-3 a sample against unit drive in 6 realisations: some 1e-3 of the gain, more where the lag has eaten it.
            assert!((gain(0) / h - 1.0).abs() < 0.02 && (gain(1) / (0.5 * h) - 1.0).abs() < 0.04, "{hz}");
        }
        let mean = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
        // The noise floor of the mean over two periods: (2/N) sqrt(N) / sqrt(2) of 1e-3.
        let floor = (2.0 / 512f64.sqrt() / 2f64.sqrt() * 1e-3).powi(2);
        assert!((0.7..1.4).contains(&(mean(&found.noise[0]) / floor)));
        assert!(mean(&found.distortion[0]) < 1.5 * floor);
    }

    #[test]
    fn a_cubic_shows_as_distortion() {
        let (plain, bent) = (made(0.0, 1e-3), made(0.05, 1e-3));
        let mean = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
        assert!(mean(&bent.distortion[0]) > 10.0 * mean(&plain.distortion[0]));
    }

    #[test]
    fn a_peak_between_two_lines_is_found() {
        let hz: Vec<f64> = (0..200).map(f64::from).collect();
        let gain: Vec<f64> = hz.iter().map(|f| 1.0 / (1.0 + (f - 80.3f64).powi(2))).collect();
        let (at, _) = peak_hz(&hz, &gain, [50.0, 120.0]).expect("inside");
        assert!((at - 80.3).abs() < 0.1, "{at}");
        assert_eq!(peak_hz(&hz, &gain, [500.0, 600.0]), None);
    }
}
