//! Transfer functions from logs, with a choice of order: the counterpart of MATLAB's `tfest`.
//!
//! First the refined instrumental variable method in continuous time (Young and Jakeman 1980): all signals pass 1/A(s) of the last
//! estimate, so that derivatives are filter states and the equation A y = B u + c becomes linear in the coefficients; the instruments are
//! the noise-free output of the last estimate. Then output-error least squares by Levenberg-Marquardt on the exact simulation, each log
//! with its own offset. The order is chosen by the Bayesian criterion, counted in independent samples.

use super::search::{self, FINE};
use super::{IdentifyError, LogFit, Options, check, guess, run_in_rows};
use crate::residual::{Autocorrelation, LAGS, aic_bic, noise_rms, samples_per_independent};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{Complex, DMatrix, DVector, Dyn};
use plant_sim::chain::Chain;
use plant_sim::linear::{TransferFunction, polynomial};
use plant_sim::log::Log;
use plant_sim::metrics::{Score, rms};
use plant_sim::model::Model;
use plant_sim::replay::{Start, predict};
use rayon::prelude::*;

/// Highest order that is tried.
pub const MOST_ORDER: usize = 5;
/// Rounds of the instrumental variables; they settle in about ten.
const ROUNDS: usize = 25;
/// Rows of each log that the first stage looks at.
const FIRST_ROWS: usize = 20_000;
/// Bandwidths that the first filter is tried with, in Hz, up to this share of the rate; where not all of them are, these shares of it as well.
const BANDWIDTHS_HZ: [f64; 4] = [30.0, 150.0, 600.0, 2000.0];
const MOST_BANDWIDTH: f64 = 0.4;
const BANDWIDTHS: [f64; 3] = [0.02, 0.1, 0.3];
/// Relative step of the coefficients for sensitivities.
const STEP: f64 = 1e-6;
/// Poles are kept left of this share of their size, so that an estimate can be simulated.
const LEAST_DAMPING: f64 = 1e-3;

/// An estimate of one order.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The transfer function.
    pub tf: TransferFunction,
    /// Order of the denominator.
    pub order: usize,
    /// Number of zeros.
    pub zeros: usize,
    /// Its logs.
    pub logs: Vec<LogFit>,
    /// Rms over all logs, metres.
    pub rms_m: f64,
    /// Scored rows that count, were they independent.
    pub independent_samples: f64,
    /// Coefficients, and an offset for each log.
    pub coordinates: usize,
    /// Relative standard deviations of the denominator's coefficients but the first, then of the numerator's; infinite where these logs
    /// don't determine them all.
    pub relative_sigma: Vec<f64>,
}

/// A coefficient of a transfer function.
#[derive(Clone, Debug)]
pub struct Coefficient {
    /// `denominator_1`: its highest power's is 1 and not estimated; `numerator_0`: of its highest power.
    pub name: String,
    /// Value, SI.
    pub value: f64,
    /// Its standard deviation, SI.
    pub sigma: f64,
}

impl Estimate {
    /// The estimate as a model file.
    pub fn model(&self) -> Model {
        let names: Vec<&str> = self.logs.iter().map(|log| log.name.as_str()).collect();
        let name = format!("transfer function, {} poles and {} zeros", self.order, self.zeros);
        Model::of_transfer_function(&name, &self.tf, &format!("tfest on {}", names.join(", ")))
    }

    /// What was estimated, denominator first.
    pub fn coefficients(&self) -> Vec<Coefficient> {
        let name = |of: &str, from: usize, values: &[f64]| -> Vec<(String, f64)> {
            values.iter().enumerate().map(|(k, value)| (format!("{of}_{}", k + from), *value)).collect()
        };
        let mut named = name("denominator", 1, &self.tf.denominator[1..]);
        named.extend(name("numerator", 0, &self.tf.numerator));
        let with = |((name, value), relative): ((String, f64), &f64)| Coefficient {
            name,
            value,
            sigma: relative * value.abs(),
        };
        named.into_iter().zip(&self.relative_sigma).map(with).collect()
    }

    /// Akaike's and the Bayesian criterion of all scored rows, as if these were independent; less is better. The rows are pooled, as they are fitted.
    pub fn aic_bic(&self) -> [f64; 2] {
        let rows: f64 = self.logs.iter().map(|log| (log.predicted_m.len() - log.run_in_rows) as f64).sum();
        aic_bic(&[[rows, self.rms_m]], self.coordinates)
    }

    /// The Bayesian criterion with `samples` independent samples; less is better.
    pub fn criterion(&self, samples: f64) -> f64 {
        aic_bic(&[[samples, self.rms_m]], self.coordinates)[1]
    }
}

/// Estimates transfer functions of every order up to [`MOST_ORDER`], or of `order` poles and `zeros` zeros alone; the best first.
///
/// # Errors
/// As [`super::identify`].
pub fn tfest(logs: &[Log], options: &Options, order: Option<(usize, usize)>) -> Result<Vec<Estimate>, IdentifyError> {
    check(logs, options)?;
    let orders: Vec<(usize, usize)> = match order {
        Some(order) => vec![order],
        None => (1..=MOST_ORDER).flat_map(|n| [(n, 0), (n, n - 1)]).skip(1).collect(),
    };
    let mut found: Vec<Estimate> = orders.into_par_iter().filter_map(|(n, m)| estimate(logs, options, n, m)).collect();
    rank(&mut found);
    if found.is_empty() { Err(IdentifyError::NoFit { starts: bandwidths_hz(logs[0].dt_s).len() }) } else { Ok(found) }
}

/// The best first, counted alike for all by the least correlated residual.
fn rank(found: &mut [Estimate]) {
    let samples = found.iter().map(|e| e.independent_samples).fold(0.0, f64::max);
    found.sort_by(|a, b| a.criterion(samples).total_cmp(&b.criterion(samples)));
}

fn bandwidths_hz(dt_s: f64) -> Vec<f64> {
    let mut all: Vec<f64> = BANDWIDTHS_HZ.into_iter().filter(|hz| hz * dt_s <= MOST_BANDWIDTH).collect();
    if all.len() < BANDWIDTHS_HZ.len() {
        all.extend(BANDWIDTHS.map(|share| share / dt_s));
    }
    all
}

fn estimate(logs: &[Log], options: &Options, order: usize, zeros: usize) -> Option<Estimate> {
    let records: Vec<Signal<'_>> = logs.iter().map(|log| Signal::new(log, options)).collect();
    let gain = guess::looks_at_all(&logs[0], run_in_rows(&logs[0], options)).gain_m_per_v;
    let mut best: Option<(f64, Fit<'_>)> = None;
    for hz in bandwidths_hz(logs[0].dt_s) {
        let Some(theta) = instrumental(&records, order, zeros, std::f64::consts::TAU * hz, gain) else { continue };
        let fit = Fit::new(&records, order, zeros, theta);
        let cost = fit.residuals.norm_squared();
        if cost.is_finite() && best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, fit));
        }
    }
    let (_, start) = best?;
    let search = LevenbergMarquardt::new().with_ftol(FINE).with_xtol(FINE).with_gtol(1e-12).with_patience(12);
    let before = start.clone();
    let fit = search.minimize(start).0;
    let fit = if fit.residuals.norm_squared() <= before.residuals.norm_squared() { fit } else { before };
    let tf = fit.transfer_function(&fit.theta)?;
    let chain = Model::of_transfer_function("", &tf, "").chain();
    let logs: Vec<LogFit> = records.iter().map(|record| record.log_fit(&chain, options)).collect();
    let residuals: Vec<Vec<f64>> =
        records.iter().zip(&logs).map(|(record, fit)| record.residual(&fit.predicted_m)).collect();
    let independent = logs.iter().map(|log| log.independent_samples).sum();
    let relative_sigma = fit.relative_sigma(independent).unwrap_or_else(|| vec![f64::INFINITY; order + zeros + 1]);
    Some(Estimate {
        relative_sigma,
        rms_m: rms(residuals.iter().flatten().copied()),
        independent_samples: independent,
        coordinates: order + zeros + 1 + logs.len(),
        tf,
        order,
        zeros,
        logs,
    })
}

/// A log about the state in which it begins.
#[derive(Clone)]
struct Signal<'a> {
    log: &'a Log,
    run_in: usize,
    before_v: f64,
}

impl<'a> Signal<'a> {
    fn new(log: &'a Log, options: &Options) -> Self {
        let run_in = run_in_rows(log, options);
        let start = search::record(log, run_in, options.initial, true).start;
        let before_v = if options.initial == plant_sim::replay::Initial::Relaxed { 0.0 } else { start.drive_v };
        Self { log, run_in, before_v }
    }

    fn residual(&self, predicted_m: &[f64]) -> Vec<f64> {
        self.log.displacement_m.iter().zip(predicted_m).skip(self.run_in).map(|(y, p)| y - p).collect()
    }

    /// Prediction with the offset that fits best.
    fn predicted(&self, chain: &Chain) -> (Vec<f64>, f64) {
        let start = Start::at_rest(chain, self.before_v, Vec::new());
        let mut predicted = predict(chain, self.log, &start, self.log.len());
        let residual = self.residual(&predicted);
        let offset_m = residual.iter().sum::<f64>() / residual.len() as f64;
        predicted.iter_mut().for_each(|p| *p += offset_m);
        (predicted, offset_m)
    }

    fn log_fit(&self, chain: &Chain, options: &Options) -> LogFit {
        let (predicted_m, offset_m) = self.predicted(chain);
        let mut score = Score::default();
        self.log.displacement_m.iter().zip(&predicted_m).skip(self.run_in).for_each(|(y, p)| score.add(*y, *p));
        let residual_m = self.residual(&predicted_m);
        LogFit {
            name: self.log.name.clone(),
            run_in_rows: run_in_rows(self.log, options),
            rms_m: score.rms_m(false),
            fit_percent: score.fit_percent(false),
            noise_m: noise_rms(&self.log.displacement_m[self.run_in..]),
            offset_m,
            start: Start::at_rest(chain, self.before_v, Vec::new()),
            autocorrelation: Autocorrelation::of(&residual_m, LAGS),
            independent_samples: residual_m.len() as f64 / samples_per_independent(&residual_m),
            predicted_m,
        }
    }
}

/// Coefficients a1 .. an, b0 .. bm for s in units of `rate`, a0 = 1, b in units of the gain.
#[derive(Clone, Debug)]
struct Theta {
    rate: f64,
    gain: f64,
    a: Vec<f64>,
    b: Vec<f64>,
}

impl Theta {
    fn transfer_function(&self) -> TransferFunction {
        let n = self.a.len();
        let power = |k: usize| self.rate.powi(k as i32);
        let denominator = std::iter::once(1.0).chain((1..=n).map(|k| self.a[k - 1] * power(k))).collect();
        let m = self.b.len() - 1;
        let numerator = self.b.iter().enumerate().map(|(j, b)| b * self.gain * power(n - m + j)).collect();
        TransferFunction { numerator, denominator }
    }

    /// Poles that grow are mirrored, and hardly damped ones moved left, so that filters and simulations stay bounded.
    fn tamed(mut self) -> Option<Self> {
        let mut coefficients = vec![1.0];
        coefficients.extend(&self.a);
        let tame = |z: &Complex<f64>| Complex::new(-z.re.abs().max(LEAST_DAMPING * z.norm()), z.im);
        let roots: Vec<Complex<f64>> = plant_sim::linear::roots(&coefficients).iter().map(tame).collect();
        if roots.len() != self.a.len() || roots.iter().any(|z| !z.re.is_finite() || z.norm() > 1e6) {
            return None;
        }
        self.a = polynomial(&roots)[1..].to_vec();
        Some(self)
    }
}

/// The refined instrumental variable method, from a Butterworth filter of bandwidth `rate`.
fn instrumental(signals: &[Signal<'_>], n: usize, m: usize, rate: f64, gain: f64) -> Option<Theta> {
    let angle = |k: usize| std::f64::consts::PI * (2.0 * k as f64 + n as f64 + 1.0) / (2.0 * n as f64);
    let butterworth: Vec<Complex<f64>> = (0..n).map(|k| Complex::from_polar(1.0, angle(k))).collect();
    let mut theta = Theta { rate, gain, a: polynomial(&butterworth)[1..].to_vec(), b: vec![0.0; m + 1] };
    theta.b[m] = theta.a[n - 1];
    for round in 0..ROUNDS {
        let width = n + m + 1 + signals.len();
        let (mut normal, mut right) = (DMatrix::zeros(width, width), DVector::zeros(width));
        for (index, signal) in signals.iter().enumerate() {
            let rows = signal.log.len().min(guess::moves_from(signal.log, signal.run_in) + FIRST_ROWS);
            let dt = signal.log.dt_s * rate;
            let u: Vec<f64> = signal.log.command_v[..rows].iter().map(|v| v - signal.before_v).collect();
            let base_m = signal.log.displacement_m[0];
            let y: Vec<f64> = signal.log.displacement_m[..rows].iter().map(|y| (y - base_m) / gain).collect();
            let held = Filter::new(&theta.a, dt, false)?;
            let line = Filter::new(&theta.a, dt, true)?;
            let filtered_u = held.run(&u);
            let filtered_y = line.run(&y);
            let filtered_one = held.run(&vec![1.0; rows]);
            // The instruments: what the last estimate answers, filtered alike; in the first round the data themselves.
            let filtered_x = if round == 0 {
                filtered_y.clone()
            } else {
                let x: Vec<f64> =
                    filtered_u.iter().map(|s| (0..=m).map(|j| theta.b[j] * s[m - j]).sum::<f64>()).collect();
                line.run(&x)
            };
            let top =
                |states: &DVector<f64>, input: f64| input - (0..n).map(|i| theta.a[n - 1 - i] * states[i]).sum::<f64>();
            for k in signal.run_in.min(rows)..rows {
                let mut row = DVector::zeros(width);
                let mut instrument = DVector::zeros(width);
                for i in 0..n {
                    row[i] = -filtered_y[k][n - 1 - i];
                    instrument[i] = -filtered_x[k][n - 1 - i];
                }
                for j in 0..=m {
                    row[n + j] = filtered_u[k][m - j];
                }
                row[n + m + 1 + index] = filtered_one[k][0];
                for j in n..width {
                    instrument[j] = row[j];
                }
                let target = top(&filtered_y[k], y[k]);
                normal += &instrument * row.transpose();
                right += instrument * target;
            }
        }
        let solution = normal.lu().solve(&right)?;
        let next =
            Theta { rate, gain, a: solution.as_slice()[..n].to_vec(), b: solution.as_slice()[n..n + m + 1].to_vec() };
        let next = next.tamed()?;
        let change = next.a.iter().zip(&theta.a).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        theta = next;
        if change < 1e-6 {
            break;
        }
    }
    theta.b.iter().all(|b| b.is_finite()).then_some(theta)
}

/// 1/A(s), its states the input's filtered derivatives 0 .. n-1, stepped exactly for a held input or a line between samples.
struct Filter {
    step: DMatrix<f64>,
    held: DVector<f64>,
    ramp: DVector<f64>,
    line: bool,
}

impl Filter {
    fn new(a: &[f64], dt: f64, line: bool) -> Option<Self> {
        let n = a.len();
        let mut big = DMatrix::zeros(n + 2, n + 2);
        for i in 0..n - 1 {
            big[(i, i + 1)] = dt;
        }
        for i in 0..n {
            big[(n - 1, i)] = -a[n - 1 - i] * dt;
        }
        big[(n - 1, n)] = dt;
        // The input's slope over a sample, in units of one sample.
        big[(n, n + 1)] = 1.0;
        let e = big.exp();
        let column = |j: usize| DVector::from_fn(n, |i, _| e[(i, j)]);
        let filter = Self { step: e.view((0, 0), (n, n)).into_owned(), held: column(n), ramp: column(n + 1), line };
        filter.step.iter().all(|x| x.is_finite()).then_some(filter)
    }

    /// The states at each sample.
    fn run(&self, input: &[f64]) -> Vec<DVector<f64>> {
        let mut x = DVector::zeros(self.step.nrows());
        let mut states = Vec::with_capacity(input.len());
        for (k, &u) in input.iter().enumerate() {
            states.push(x.clone());
            x = &self.step * x + &self.held * u;
            if self.line {
                let next = input.get(k + 1).copied().unwrap_or(u);
                x += &self.ramp * (next - u);
            }
        }
        states
    }
}

/// Output-error least squares in the coefficients; each log's offset is eliminated.
#[derive(Clone)]
struct Fit<'a> {
    signals: &'a [Signal<'a>],
    order: usize,
    start: Theta,
    theta: DVector<f64>,
    residuals: DVector<f64>,
}

impl<'a> Fit<'a> {
    fn new(signals: &'a [Signal<'a>], order: usize, zeros: usize, start: Theta) -> Self {
        // Coordinates are relative to the start, so that one step size serves all.
        let theta = DVector::from_element(order + zeros + 1, 1.0);
        let mut fit = Self { signals, order, start, theta: theta.clone(), residuals: DVector::zeros(0) };
        fit.set_params(&theta);
        fit
    }

    fn transfer_function(&self, x: &DVector<f64>) -> Option<TransferFunction> {
        let n = self.order;
        let a = self.start.a.iter().zip(x.iter()).map(|(a, x)| a * x).collect();
        let b = self.start.b.iter().zip(x.iter().skip(n)).map(|(b, x)| b * x).collect();
        let theta = Theta { a, b, ..self.start.clone() };
        let tf = theta.transfer_function();
        // An estimate that grows can't be compared; the search steps back.
        tf.poles().iter().all(|pole| pole.re < 0.0).then_some(tf)
    }

    /// Relative standard deviations of the coefficients, where the residual counts as so many `independent` rows.
    fn relative_sigma(&self, independent: f64) -> Option<Vec<f64>> {
        let jacobian = self.jacobian()?;
        let covariance = jacobian.tr_mul(&jacobian).try_inverse()?;
        let variance = self.residuals.norm_squared() / independent;
        let of = |j: usize| (covariance[(j, j)].max(0.0) * variance).sqrt() / self.theta[j].abs();
        Some((0..self.theta.len()).map(of).collect())
    }

    fn evaluate(&self, x: &DVector<f64>) -> Option<DVector<f64>> {
        let chain = Model::of_transfer_function("", &self.transfer_function(x)?, "").chain();
        let residuals: Vec<f64> = self
            .signals
            .iter()
            .flat_map(|signal| {
                let scale = 1.0 / self.start.gain.abs();
                signal.residual(&signal.predicted(&chain).0).into_iter().map(move |r| r * scale)
            })
            .collect();
        residuals.iter().all(|r| r.is_finite()).then(|| DVector::from_vec(residuals))
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Fit<'_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.theta.copy_from(x);
        let rows: usize = self.signals.iter().map(|s| s.log.len() - s.run_in).sum();
        self.residuals = self.evaluate(x).unwrap_or_else(|| DVector::from_element(rows, 1e30));
    }

    fn params(&self) -> DVector<f64> {
        self.theta.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(self.residuals.clone())
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let columns: Option<Vec<DVector<f64>>> = (0..self.theta.len())
            .map(|j| {
                let mut x = self.theta.clone();
                let step = STEP * x[j].abs().max(1e-3);
                x[j] += step;
                Some((self.evaluate(&x)? - &self.residuals) / step)
            })
            .collect();
        Some(DMatrix::from_columns(&columns?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_counted_by_the_least_correlated_residual() {
        let tf = TransferFunction { numerator: vec![1.0], denominator: vec![1.0, 1.0] };
        let of = |coordinates: usize, rms_m: f64, independent_samples: f64| Estimate {
            tf: tf.clone(),
            order: coordinates,
            zeros: 0,
            logs: Vec::new(),
            rms_m,
            independent_samples,
            coordinates,
            relative_sigma: Vec::new(),
        };
        // What the lower order leaves is so slow that it counts as ten samples, of which a tenth less would not pay for three coordinates; of the
        // thousand that the higher order leaves white it does.
        let mut found = [of(3, 1.0e-6, 10.0), of(6, 0.9e-6, 1000.0)];
        rank(&mut found);
        assert_eq!(found[0].order, 6);
    }

    #[test]
    fn a_slow_log_has_bandwidths_of_its_own() {
        assert_eq!(bandwidths_hz(1.0 / 50.0), [1.0, 5.0, 15.0]);
        assert_eq!(bandwidths_hz(1e-4), BANDWIDTHS_HZ);
    }
}
