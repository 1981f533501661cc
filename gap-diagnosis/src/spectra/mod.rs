//! Spectra of logs: what repeats, frequency response, power density, best linear approximation with its distortions.
//!
//! Slices in, plain structs out, SI units. What it does not do: read logs, decide what a distortion means.

mod bla;
mod mimo;
mod period;
mod welch;

pub use bla::{BestLinear, SilentLine, best_linear};
pub use mimo::{Blocks, Mimo, Pair, mimo, peak_hz};
pub use period::{Repeats, repeats};
pub use welch::{Frf, PowerDensity, frf, frf_closed_loop, power_density, segment_samples};

use realfft::num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};
use std::sync::Arc;

/// A real FFT of one length, made once and used for every piece of a log.
struct Transform {
    plan: Arc<dyn RealToComplex<f64>>,
    input: Vec<f64>,
    scratch: Vec<Complex64>,
}

impl Transform {
    fn new(n_samples: usize) -> Self {
        let plan = RealFftPlanner::<f64>::new().plan_fft_forward(n_samples);
        let (input, scratch) = (plan.make_input_vec(), plan.make_scratch_vec());
        Self { plan, input, scratch }
    }

    /// Lines 0 to N/2 of `sum_n x[n] exp(-2 pi i k n / N)`.
    fn lines(&mut self, values: impl Iterator<Item = f64>) -> Vec<Complex64> {
        for (place, value) in self.input.iter_mut().zip(values) {
            *place = value;
        }
        let mut lines = self.plan.make_output_vec();
        self.plan
            .process_with_scratch(&mut self.input, &mut lines, &mut self.scratch)
            .expect("buffers come from the plan");
        lines
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    /// White noise of unit variance.
    pub fn white(n: usize, seed: u64) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        (0..n).map(|_| rng.sample(StandardNormal)).collect()
    }

    /// `y[k+1] = a y[k] + (1 - a) u[k]`: a first-order lag, H(z) = (1 - a) / (z - a).
    pub fn lag(input: &[f64], a: f64) -> Vec<f64> {
        let mut state = 0.0;
        input
            .iter()
            .map(|u| {
                let output = state;
                state = a * state + (1.0 - a) * u;
                output
            })
            .collect()
    }

    /// Reference, command and reading of `u = 3 (r - y)` around that lag, y its output with so much noise of the sensor: that reaches the command.
    pub fn loop_around_lag(a: f64, n: usize, noise: f64) -> [Vec<f64>; 3] {
        let (reference, white) = (white(n, 3), white(n, 4));
        let (mut state, mut command, mut output) = (0.0, Vec::new(), Vec::new());
        for k in 0..n {
            let measured = state + noise * white[k];
            let u = 3.0 * (reference[k] - measured);
            state = a * state + (1.0 - a) * u;
            command.push(u);
            output.push(measured);
        }
        [reference, command, output]
    }

    /// Gain and phase of that lag at `turns` cycles per sample.
    pub fn lag_response(a: f64, turns: f64) -> (f64, f64) {
        let (sin, cos) = (std::f64::consts::TAU * turns).sin_cos();
        let response =
            realfft::num_complex::Complex64::new(1.0 - a, 0.0) / realfft::num_complex::Complex64::new(cos - a, sin);
        (response.norm(), response.arg())
    }
}
