//! An integration that shares nothing with the crate under test but the parameters: classical Runge-Kutta on every equation of the
//! chain at once, as the documentation of the parts states them, at steps that are short against the fast hysteron's 0.94 us.

use plant_sim::chain::{BendLaw, Chain, Drive, Force, Heat, Joint, Lag, Parts, Sensor};
use plant_sim::log::{Hold, Log};
use plant_sim::phs::{Hysteron, Phs};
use plant_sim::replay::{Start, predict};
use std::f64::consts::TAU;

/// 20 kHz.
pub const SAMPLE_S: f64 = 5e-5;

/// The thesis' bender (Table 2.1) with both hysterons, or with the slow one only.
pub fn bender(fast: bool) -> Phs {
    let slow = Hysteron { capacitance_f: 5.2125e-7, slope_s: 1.1528e-4, dead_zone_v: 8.6838 };
    let both = vec![Hysteron { capacitance_f: 5.6425e-7, slope_s: 0.6002, dead_zone_v: 14.5126 }, slow];
    Phs {
        mass_kg: 1.0148e-3,
        damping_n_s_per_m: 3.7356,
        stiffness_n_per_m: 24579.0,
        transduction_c_per_m: 0.046311,
        hysterons: if fast { both } else { vec![slow] },
    }
}

pub fn chain() -> Chain {
    Chain { drive: Drive::IDEAL, plant: bender(true), parts: Parts::default(), sensor: Sensor::IDEAL }
}

pub fn with_force(force: Force) -> Chain {
    Chain { parts: Parts { forces: vec![force], ..Parts::default() }, ..chain() }
}

pub fn with_drive(drive: Drive) -> Chain {
    Chain { drive, ..chain() }
}

/// Steps of 60 V either way and back, then a sine of 60 V and 150 Hz, then rest: 70 ms.
pub fn lively() -> Vec<f64> {
    (0..1400)
        .map(|k| match k {
            10..200 => 60.0,
            200..400 => -60.0,
            500..1200 => 60.0 * (TAU * 150.0 * f64::from(k - 500) * SAMPLE_S).sin(),
            _ => 0.0,
        })
        .collect()
}

/// A sine of 60 V over a period.
pub fn slow_sine(hz: f64) -> Vec<f64> {
    (0..(1.0 / (hz * SAMPLE_S)) as u32).map(|k| 60.0 * (TAU * hz * f64::from(k) * SAMPLE_S).sin()).collect()
}

/// 40 V for `seconds`.
pub fn held(seconds: f64) -> Vec<f64> {
    vec![40.0; (seconds / SAMPLE_S) as usize]
}

pub fn log(command_v: Vec<f64>, latency_s: f64) -> Log {
    let mut log = Log { dt_s: SAMPLE_S, displacement_m: vec![0.0; command_v.len()], command_v, ..Log::default() };
    log.meta.hold = Hold::Zoh;
    log.meta.latency_s = latency_s;
    log
}

/// What the crate predicts for these commands from the relaxed state.
pub fn ours(chain: &Chain, command_v: &[f64]) -> Vec<f64> {
    let log = log(command_v.to_vec(), 0.0);
    predict(chain, &log, &Start::relaxed(chain), log.command_v.len())
}

pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    assert!(a.iter().chain(b).all(|v| v.is_finite()));
    a.iter().zip(b).fold(0.0, |m, (a, b)| m.max((a - b).abs()))
}

const SIZE: usize = 17;
type Vector = [f64; SIZE];
const Q: usize = 0;
const W: usize = 1;
const HYSTERONS: usize = 2;
const LAG: usize = 5;
const THETA: usize = 7;
const SENSOR_LAG: usize = 8;
const SLID: usize = 10;
const MODES: usize = 12;
const BEHIND: usize = 16;

/// Readings at the start of each sample under the commands, by `steps` Runge-Kutta steps per sample; the drive's delay must be a whole
/// number of those. Knows the heat of the drive's square only, and no play with drag.
pub fn rival(chain: &Chain, command_v: &[f64], steps: usize) -> Vec<f64> {
    let h = SAMPLE_S / steps as f64;
    let delay = (chain.drive.delay_s / h).round() as usize;
    let mut x: Vector = [0.0; SIZE];
    let mut slewed_v = chain.drive.output_v(0.0);
    x[LAG] = slewed_v;
    let mut readings_m = Vec::with_capacity(command_v.len());
    for row in 0..command_v.len() {
        readings_m.push(reading_m(chain, &x, row as f64 * SAMPLE_S));
        for step in 0..steps {
            let index = row * steps + step;
            let command = if index < delay { 0.0 } else { command_v[(index - delay) / steps] };
            let wanted_v = chain.drive.output_v(command);
            let most = chain.drive.slew_v_per_s * h;
            let next_v = slewed_v + (wanted_v - slewed_v).clamp(-chain.drive.slew_down_v_per_s * h, most);
            let middle_v = 0.5 * (slewed_v + next_v);
            let t = index as f64 * h;
            let k1 = slope(chain, &x, slewed_v, t);
            let k2 = slope(chain, &moved(&x, &k1, h / 2.0), middle_v, t + h / 2.0);
            let k3 = slope(chain, &moved(&x, &k2, h / 2.0), middle_v, t + h / 2.0);
            let k4 = slope(chain, &moved(&x, &k3, h), next_v, t + h);
            // An instantaneous slew is a jump at the step's start.
            let (k1, k2, k3, k4) = if most.is_finite() {
                (k1, k2, k3, k4)
            } else {
                let k1 = slope(chain, &x, next_v, t);
                let k2 = slope(chain, &moved(&x, &k1, h / 2.0), next_v, t + h / 2.0);
                let k3 = slope(chain, &moved(&x, &k2, h / 2.0), next_v, t + h / 2.0);
                let k4 = slope(chain, &moved(&x, &k3, h), next_v, t + h);
                (k1, k2, k3, k4)
            };
            for i in 0..SIZE {
                x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
            slewed_v = next_v;
            x[BEHIND] = behind_m(chain, &x);
        }
    }
    readings_m
}

fn moved(x: &Vector, slope: &Vector, by: f64) -> Vector {
    let mut y = *x;
    for i in 0..SIZE {
        y[i] += by * slope[i];
    }
    y
}

fn seen_m(chain: &Chain, x: &Vector) -> f64 {
    let parallel = |(i, mode): (usize, &plant_sim::chain::Mode)| match mode.joint {
        Joint::Parallel { .. } => x[MODES + 2 * i],
        Joint::Attached { .. } => 0.0,
    };
    x[Q] + chain.parts.modes.iter().enumerate().map(parallel).sum::<f64>()
}

/// Where the play's other side is: it goes no farther than the play lets it, and stands as long as it can.
fn behind_m(chain: &Chain, x: &Vector) -> f64 {
    let (seen_m, half_m) = (seen_m(chain, x), 0.5 * chain.sensor.play_m);
    x[BEHIND].clamp(seen_m - half_m, seen_m + half_m)
}

fn reading_m(chain: &Chain, x: &Vector, t: f64) -> f64 {
    let seen_m = if chain.sensor.lag.is_some() { x[SENSOR_LAG] } else { behind_m(chain, x) };
    let y = seen_m + chain.sensor.quadratic_per_m * seen_m.powi(2) + chain.sensor.cubic_per_m2 * seen_m.powi(3);
    let drifts = chain.sensor.drifts.iter().map(|d| {
        if d.time_constant_s.is_finite() {
            d.amplitude_m * (1.0 - (-t / d.time_constant_s).exp())
        } else {
            d.amplitude_m * t
        }
    });
    let drift: f64 = drifts.sum();
    let lines: f64 =
        chain.sensor.lines.iter().map(|l| l.cos_m * (TAU * l.hz * t).cos() + l.sin_m * (TAU * l.hz * t).sin()).sum();
    chain.sensor.gain * y + chain.sensor.offset_m + drift + lines
}

fn lag_slope(lag: Option<Lag>, x: &Vector, at: usize, input: f64, dx: &mut Vector) {
    match lag {
        Some(Lag::First { time_constant_s }) => dx[at] = (input - x[at]) / time_constant_s,
        Some(Lag::Second { natural_rad_per_s: w, damping_ratio: z }) => {
            dx[at] = x[at + 1];
            dx[at + 1] = w * w * (input - x[at]) - 2.0 * z * w * x[at + 1];
        }
        None => {}
    }
}

fn slope(chain: &Chain, x: &Vector, slewed_v: f64, t: f64) -> Vector {
    let mut dx = [0.0; SIZE];
    let plant = &chain.plant;
    let alpha = plant.transduction_c_per_m;
    let (q, w) = (x[Q], x[W]);
    lag_slope(chain.drive.lag, x, LAG, slewed_v, &mut dx);
    let mut drive_v = if chain.drive.lag.is_some() { x[LAG] } else { slewed_v };
    if let Some(warming) = chain.drive.warmings.first() {
        let heating = match warming.heat {
            Heat::Time => 1.0,
            Heat::Drive { volts } => (drive_v / volts).powi(2),
            Heat::Loss { .. } => unreachable!("a test of its own"),
        };
        dx[THETA] = (heating - x[THETA]) / warming.time_constant_s;
        drive_v *= 1.0 + warming.coefficient * x[THETA];
    }
    let pull_n = alpha * drive_v;
    let mut force = pull_n - plant.stiffness_n_per_m * q - plant.damping_n_s_per_m * w;
    for (i, hysteron) in plant.hysterons.iter().enumerate() {
        let v = x[HYSTERONS + i];
        force -= alpha * v;
        dx[HYSTERONS + i] = hysteron_slope(chain, i, hysteron, v, w);
    }
    for (i, law) in chain.parts.forces.iter().enumerate() {
        force -= match *law {
            Force::Spring { quadratic_n_per_m2, cubic_n_per_m3 } => {
                quadratic_n_per_m2 * q * q + cubic_n_per_m3 * q * q * q
            }
            Force::Fifth { fifth_n_per_m5 } => fifth_n_per_m5 * q * q * q * q * q,
            Force::OneSided { stiffness_n_per_m } => {
                if q > 0.0 {
                    stiffness_n_per_m * q
                } else {
                    0.0
                }
            }
            Force::Presliding { coulomb_n, presliding_m } => {
                let z = x[SLID + i];
                dx[SLID + i] = (w - z * w.abs()) / presliding_m;
                coulomb_n * z
            }
            Force::Slider { coulomb_n, slip_m } => {
                let z = x[SLID + i];
                dx[SLID + i] = if z * w.signum() < 1.0 { w / slip_m } else { 0.0 };
                coulomb_n * z.clamp(-1.0, 1.0)
            }
            Force::Patch { coulomb_n, slip_m, at_m, half_width_m } => {
                let z = x[SLID + i];
                dx[SLID + i] = if z * w.signum() < 1.0 { w / slip_m } else { 0.0 };
                let felt = (0.5 + (half_width_m - (q - at_m).abs()) / (slip_m + 0.1 * half_width_m)).clamp(0.0, 1.0);
                coulomb_n * felt * z.clamp(-1.0, 1.0)
            }
            Force::Detent { period_m, sin_n, cos_n } => {
                let angle = TAU * q / period_m;
                sin_n * angle.sin() + cos_n * (1.0 - angle.cos())
            }
            Force::BoucWen(law) => {
                let h = x[SLID + i];
                let power = h.abs().powf(law.exponent);
                dx[SLID + i] = law.amplitude * w - (law.beta * w.abs() * h.signum() + law.gamma * w) * power;
                h
            }
            Force::Smooth { coulomb_n, speed_m_per_s } => coulomb_n * (w / speed_m_per_s).tanh(),
            Force::Power { force_n, reference_m_per_s, exponent } => {
                // As documented: below 1e-9 of the reference the law is straight.
                let r = w / reference_m_per_s;
                force_n * r * (r * r + 1e-18).powf(0.5 * (exponent - 1.0))
            }
            Force::Fourth { fourth_n_per_m4 } => fourth_n_per_m4 * q * q * q * q,
            Force::Pad { at_m, stiffness_n_per_m, exponent } => {
                let (depth_m, unit_m) = (if at_m > 0.0 { q - at_m } else { at_m - q }, 0.1 * at_m.abs());
                let force = stiffness_n_per_m * unit_m * (depth_m.max(0.0) / unit_m).powf(exponent);
                if at_m > 0.0 { force } else { -force }
            }
            Force::Gradual { stiffness_n_per_m, at_m, width_m } => {
                let rounded = |x: f64| 0.5 * (x + (x * x + width_m * width_m).sqrt());
                stiffness_n_per_m * (rounded(q - at_m) - rounded(-at_m))
            }
            Force::Stop { at_m, stiffness_n_per_m, damping_s_per_m } => {
                if at_m > 0.0 {
                    stiffness_n_per_m * (q - at_m).max(0.0) * (1.0 + damping_s_per_m * w).max(0.0)
                } else {
                    stiffness_n_per_m * (q - at_m).min(0.0) * (1.0 - damping_s_per_m * w).max(0.0)
                }
            }
        };
    }
    for shake in &chain.parts.shakes {
        force += shake.cos_n * (TAU * shake.hz * t).cos() + shake.sin_n * (TAU * shake.hz * t).sin();
    }
    for (i, mode) in chain.parts.modes.iter().enumerate() {
        let (y, u) = (x[MODES + 2 * i], x[MODES + 2 * i + 1]);
        let omega = TAU * mode.hz;
        let damper = 2.0 * mode.damping_ratio * omega;
        dx[MODES + 2 * i] = u;
        match mode.joint {
            Joint::Attached { mass_kg } => {
                let acceleration = omega * omega * (q - y) + damper * (w - u);
                dx[MODES + 2 * i + 1] = acceleration;
                force -= mass_kg * acceleration;
            }
            Joint::Parallel { compliance_m_per_n } => {
                dx[MODES + 2 * i + 1] = omega * omega * (compliance_m_per_n * pull_n - y) - damper * u;
            }
        }
    }
    dx[Q] = w;
    dx[W] = force / plant.mass_kg;
    lag_slope(chain.sensor.lag, x, SENSOR_LAG, behind_m(chain, x), &mut dx);
    dx
}

/// (1 + skew) / C (alpha q' - h(v)).
fn hysteron_slope(chain: &Chain, i: usize, hysteron: &Hysteron, v: f64, w: f64) -> f64 {
    let plant = &chain.plant;
    let half = 0.5 * hysteron.dead_zone_v;
    let (mut softer, mut leakier, mut exponent, mut edge) = (1.0, 1.0, 1.0, half);
    for bend in chain.parts.bends.iter().filter(|bend| bend.hysteron.is_none_or(|only| only == i)) {
        match bend.law {
            BendLaw::CapacitanceSkew(skew) => softer += skew * (v / half).clamp(-1.0, 1.0),
            BendLaw::SlopeSkew(skew) => leakier += skew * v.signum(),
            BendLaw::Exponent(p) => exponent += p - 1.0,
            BendLaw::Easing { share, reference_m_per_s } => leakier += share * w.abs() / reference_m_per_s,
            BendLaw::Widening { share, reference_v_per_s } => {
                let rate = w.abs() * plant.stiffness_n_per_m / plant.transduction_c_per_m;
                edge += half * share * rate / reference_v_per_s;
            }
        }
    }
    let excess = (v.abs() - edge).max(0.0);
    let leak = hysteron.slope_s * leakier * half * (excess / half).powf(exponent) * v.signum();
    softer / hysteron.capacitance_f * (plant.transduction_c_per_m * w - leak)
}
