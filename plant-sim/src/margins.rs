//! Stability and margins of the sampled loop: the plant, a PI law at a rate, and the delay from sampling to the new drive.
//!
//! What it does: for each linear region of the plant (which hysterons are outside their dead zone, [`crate::phs::Phs::linear_regions`]) the exact
//! sampled loop, its eigenvalues, and its gain, phase, delay and modulus margins; over all regions a verdict; and, for a loop
//! that does not do, the nearest rate and delay that would.
//!
//! What it does not do: it says nothing on switching between regions, on limits of the drive, or on how far a response
//! overshoots. A loop that is stable in every region can in principle still be driven unstable by switching; simulate it.
//!
//! The law is the backward rule with the integral kept in volts; feedforward is outside the loop and has no part in this:
//!
//! ```text
//! e_k = r_k - q_k,   I_{k+1} = I_k + Ki T e_k,   u_k = Kp e_k + I_{k+1},   T = 1/rate,
//! u_k acts from k T + D until (k+1) T + D,   D any real >= 0.
//! ```
//!
//! **Inactive hysterons.** A hysteron inside its dead zone is a spring with a memory, `v = alpha/C q + const`. As a state it would
//! give the sampled loop an eigenvalue of exactly 1, one for each such hysteron, whatever the gains. That is the memory of the
//! hysteresis and no verdict, so regions are built without those states.
//!
//! **Signs and infinities.** No number here is ever NaN. For a stable loop every margin is positive and infinite where nothing
//! limits it. For an unstable loop each is the negative distance back: -4 dB of gain margin means that 4 dB less gain would
//! stabilise it, and minus infinity that no lower gain would.
//!
//! ```
//! use plant_sim::margins::{Loop, assess, nearest_stable};
//! use plant_sim::phs::{Hysteron, Phs};
//!
//! let plant = Phs {
//!     mass_kg: 1.0148e-3,
//!     stiffness_n_per_m: 24579.0,
//!     damping_n_s_per_m: 3.7356,
//!     transduction_c_per_m: 0.046311,
//!     hysterons: vec![Hysteron { capacitance_f: 5.2125e-7, slope_s: 1.1528e-4, dead_zone_v: 10.0 }],
//! };
//! let regions = plant.linear_regions()?;
//! let law = Loop { kp_v_per_m: 8.5811e5, ki_v_per_m_s: 9.6755e8, rate_hz: 10e3, delay_s: 10e-6 };
//! println!("{}", assess(&regions, &law)?);
//! println!("{}", nearest_stable(&regions, &law, 170_000_000)?);
//! # Ok::<(), plant_sim::margins::MarginError>(())
//! ```

mod around;
mod curve;
mod delay;
mod region;
mod sampled;
mod search;
mod suggest;

use std::fmt;

use nalgebra::Complex;

pub use region::LinearRegion;
pub use suggest::{Suggestion, nearest_stable};

use curve::{CriticalGain, Curve};
use sampled::SampledLoop;
pub(crate) use sampled::balance;

/// Below this gain margin a loop is worth a warning: half the gain is a usual allowance for a plant that differs from its model
/// (chosen).
pub const SAFE_GAIN_MARGIN_DB: f64 = 6.0;

/// Each sample of delay is a state of the closed loop and eigenvalues cost its cube; 200 take tens of milliseconds.
const MAX_DELAY_SAMPLES: f64 = 200.0;

/// An eigenvalue this close to the unit circle is not told from one on it.
const CIRCLE_TOLERANCE: f64 = 1e-12;

/// The PI law as the loop sees it: gains, rate and delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Loop {
    /// Proportional gain Kp.
    pub kp_v_per_m: f64,
    /// Integral gain Ki. Zero means that there is no integral.
    pub ki_v_per_m_s: f64,
    /// Sampling rate 1/T.
    pub rate_hz: f64,
    /// Delay D from sampling to the new drive; may exceed a sample.
    pub delay_s: f64,
}

/// Stability and margins in one region. See the module's page for signs and infinities.
#[derive(Debug, Clone, PartialEq)]
pub struct Margins {
    /// The region's label.
    pub region: String,
    /// Whether every eigenvalue is inside the unit circle.
    pub stable: bool,
    /// Largest size of an eigenvalue.
    pub spectral_radius: f64,
    /// Eigenvalues of the closed loop, largest first; those of held-back drives are near 0.
    pub eigenvalues: Vec<Complex<f64>>,
    /// By how much both gains may rise together. Unstable: how far they must change downwards (negative).
    pub gain_margin_db: f64,
    /// Where the loop then oscillates, if anywhere.
    pub gain_margin_hz: Option<f64>,
    /// If lowering the gains also destabilises the loop: by how much they may fall (negative). Unstable: by how much they must
    /// rise, where that stabilises it (positive). Otherwise `None`: any lower gain is stable, or no higher gain is.
    pub lower_gain_margin_db: Option<f64>,
    /// The least turn of the phase, either way, that brings L to -1. Negative for an unstable loop; infinite if L stays off 1.
    pub phase_margin_deg: f64,
    /// Where `|L| = 1` and the phase margin is taken.
    pub crossover_hz: Option<f64>,
    /// How much longer the delay may get. Unstable: how much shorter it must get (negative; searched within the first turn of
    /// the phase), or minus infinity if that does not help.
    pub delay_margin_s: f64,
    /// Least distance of L from -1, the inverse of the peak of the sensitivity. Negative for an unstable loop.
    pub modulus_margin: f64,
}

impl Margins {
    /// The nearest change of gain, up or down, that loses stability; for an unstable loop [`Self::gain_margin_db`].
    pub fn nearest_gain_margin_db(&self) -> f64 {
        match self.lower_gain_margin_db {
            Some(lower_db) if self.stable => self.gain_margin_db.min(-lower_db),
            _ => self.gain_margin_db,
        }
    }
}

impl fmt::Display for Margins {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.region)?;
        if self.stable {
            write!(
                f,
                "stable; margins: gain {}, phase {}, delay {}, modulus {:.2}",
                Finite(self.nearest_gain_margin_db(), 1.0, " dB"),
                Finite(self.phase_margin_deg, 1.0, " degrees"),
                Finite(self.delay_margin_s, 1e6, " us"),
                self.modulus_margin,
            )
        } else {
            write!(f, "unstable, spectral radius {:.4}", self.spectral_radius)?;
            if self.gain_margin_db.is_finite() {
                write!(f, "; {:.1} dB less gain would stabilise it", -self.gain_margin_db)?;
            } else if let Some(rise_db) = self.lower_gain_margin_db {
                write!(f, "; {rise_db:.1} dB more gain would stabilise it")?;
            }
            Ok(())
        }
    }
}

/// A number in the unit of a reader, or "unlimited".
struct Finite(f64, f64, &'static str);

impl fmt::Display for Finite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_finite() { write!(f, "{:.1}{}", self.0 * self.1, self.2) } else { f.write_str("unlimited") }
    }
}

/// The worst value over the regions, and the region it belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct Worst {
    /// The value.
    pub value: f64,
    /// The region's label.
    pub region: String,
}

/// All regions together.
#[derive(Debug, Clone, PartialEq)]
pub struct Assessment {
    /// One entry for each region, in the order given.
    pub regions: Vec<Margins>,
    /// Least [`Margins::nearest_gain_margin_db`].
    pub gain_margin_db: Worst,
    /// Least phase margin.
    pub phase_margin_deg: Worst,
    /// Least delay margin.
    pub delay_margin_s: Worst,
    /// Least modulus margin.
    pub modulus_margin: Worst,
    /// Largest spectral radius.
    pub spectral_radius: Worst,
    /// What to tell the user.
    pub verdict: Verdict,
}

/// What to tell the user about a loop.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Every region is stable with at least [`SAFE_GAIN_MARGIN_DB`].
    Stable {
        /// The region with the least gain margin.
        worst: Worst,
    },
    /// Every region is stable, but a small change of gain could end that.
    BelowSixDb {
        /// The region with the least gain margin.
        worst: Worst,
    },
    /// At least one region is unstable.
    Unstable {
        /// The region with the largest spectral radius.
        region: String,
        /// That radius.
        spectral_radius: f64,
    },
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stable { worst } => {
                write!(f, "stable: gain margin {} ({})", Finite(worst.value, 1.0, " dB"), worst.region)
            }
            Self::BelowSixDb { worst } => write!(
                f,
                "stable, but the gain margin is {:.1} dB, below {SAFE_GAIN_MARGIN_DB:.0} dB ({})",
                worst.value, worst.region
            ),
            Self::Unstable { region, spectral_radius } => {
                write!(f, "unstable: spectral radius {spectral_radius:.4} ({region})")
            }
        }
    }
}

impl fmt::Display for Assessment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.verdict.fmt(f)
    }
}

/// Why there are no margins.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MarginError {
    /// The rate is not a positive finite number, or its period is not.
    #[error("the sampling rate must be positive, not {rate_hz} Hz")]
    BadRate {
        /// As given.
        rate_hz: f64,
    },
    /// The delay is negative or not finite.
    #[error("the delay must be zero or more, not {delay_s} s")]
    BadDelay {
        /// As given.
        delay_s: f64,
    },
    /// A gain is not finite.
    #[error("the gains must be finite, not {kp_v_per_m} V/m and {ki_v_per_m_s} V/(m s)")]
    BadGain {
        /// As given.
        kp_v_per_m: f64,
        /// As given.
        ki_v_per_m_s: f64,
    },
    /// A coefficient of the plant is not positive (a damping or a slope: negative) or not finite.
    #[error("{name} must be positive, not {value}")]
    BadCoefficient {
        /// Its field.
        name: &'static str,
        /// As given.
        value: f64,
    },
    /// More hysterons that open and shut than have a sensible number of regions.
    #[error("{n_hysterons} hysterons with a dead zone; at most {limit} can be assessed region by region")]
    TooManyHysterons {
        /// As given.
        n_hysterons: usize,
        /// The most accepted.
        limit: usize,
    },
    /// The matrices of a region do not fit together, are empty, or hold a number that is not finite.
    #[error("region '{region}': its matrices do not fit together or are not finite")]
    BadRegion {
        /// Its label.
        region: String,
    },
    /// A plant without mass or lag has no dynamics that a loop could be assessed with.
    #[error("the plant has no dynamics: a static model has no margins; use a plant with a mass")]
    Massless,
    /// No regions to assess.
    #[error("there is no region to assess")]
    NoRegion,
    /// The delay is more samples than can be assessed.
    #[error("a delay of {samples:.0} samples is too long to assess; at most {limit:.0}")]
    DelayTooLong {
        /// Delay times rate.
        samples: f64,
        /// The most accepted.
        limit: f64,
    },
    /// The fastest mode of the region is too fast for this period, or a number overflows.
    #[error("region '{region}': its fastest mode is too fast to assess at {rate_hz} Hz")]
    TooStiff {
        /// Its label.
        region: String,
        /// As given.
        rate_hz: f64,
    },
    /// The frequency response is lost in rounding: the coefficients are too many powers of ten apart.
    #[error("region '{region}': its frequency response is lost in rounding; check the units")]
    Unresolved {
        /// Its label.
        region: String,
    },
    /// The eigenvalue iteration did not converge.
    #[error("region '{region}': the eigenvalues could not be computed")]
    NoEigenvalues {
        /// Its label.
        region: String,
    },
}

/// Stability and margins in one region.
pub fn margins(region: &LinearRegion, law: &Loop) -> Result<Margins, MarginError> {
    check_loop(law)?;
    check_region(region)?;
    let examined = Examined::new(region, law)?;
    let curve = examined.curve(region)?;
    let (stable, spectral_radius) = (examined.stable, examined.spectral_radius);
    let sign = if stable { 1.0 } else { -1.0 };

    let gain = examined.gain_limits(&curve.critical_gains());
    let turn_deg = |value: &Complex<f64>| (-value).arg().abs().to_degrees();
    let crossing = curve
        .unity_crossings()
        .into_iter()
        .map(|(angle, value)| (angle, turn_deg(&value)))
        .min_by(|left, right| left.1.total_cmp(&right.1));
    let critical_delay_s = if stable {
        delay::next_critical_delay(region, law, &examined.time_scales)
    } else {
        delay::stabilising_delay(region, law, &examined.time_scales).unwrap_or(f64::NEG_INFINITY)
    };
    let modulus_margin = sign * curve.modulus();
    let to_hz = |angle: f64| angle * law.rate_hz / std::f64::consts::TAU;

    let mut eigenvalues = examined.eigenvalues;
    eigenvalues.sort_by(|left, right| right.norm().total_cmp(&left.norm()));
    Ok(Margins {
        region: region.label.clone(),
        stable,
        spectral_radius,
        eigenvalues,
        gain_margin_db: gain.upper_db,
        gain_margin_hz: gain.upper_angle.map(to_hz),
        lower_gain_margin_db: gain.lower_db,
        phase_margin_deg: sign * crossing.map_or(f64::INFINITY, |(_, turn_deg)| turn_deg),
        crossover_hz: crossing.map(|(angle, _)| to_hz(angle)),
        delay_margin_s: critical_delay_s - law.delay_s,
        modulus_margin,
    })
}

/// The open loop L, broken at the error, at each of `hz`, all above zero and at most half the rate.
///
/// # Errors
/// As [`margins`].
pub fn open_loop(region: &LinearRegion, law: &Loop, hz: &[f64]) -> Result<Vec<Complex<f64>>, MarginError> {
    check_loop(law)?;
    check_region(region)?;
    let too_stiff = || MarginError::TooStiff { region: region.label.clone(), rate_hz: law.rate_hz };
    let sampled = SampledLoop::new(region, law).ok_or_else(too_stiff)?;
    let angle = |hz: f64| (std::f64::consts::TAU * hz / law.rate_hz).min(std::f64::consts::PI);
    Ok(hz.iter().map(|&hz| sampled.open_loop(angle(hz))).collect())
}

/// Eigenvalues z of the closed loop with both gains multiplied by `gain`.
///
/// # Errors
/// As [`margins`].
pub fn closed_loop_poles(region: &LinearRegion, law: &Loop, gain: f64) -> Result<Vec<Complex<f64>>, MarginError> {
    check_loop(law)?;
    check_region(region)?;
    let samples = law.delay_s * law.rate_hz;
    if samples > MAX_DELAY_SAMPLES {
        return Err(MarginError::DelayTooLong { samples, limit: MAX_DELAY_SAMPLES });
    }
    let too_stiff = || MarginError::TooStiff { region: region.label.clone(), rate_hz: law.rate_hz };
    let sampled = SampledLoop::new(region, law).ok_or_else(too_stiff)?;
    let none = || MarginError::NoEigenvalues { region: region.label.clone() };
    sampled.closed_loop_eigenvalues(gain).ok_or_else(none)
}

/// Margins in every region, the worst of each, and a verdict.
pub fn assess(regions: &[LinearRegion], law: &Loop) -> Result<Assessment, MarginError> {
    let regions: Vec<Margins> = regions.iter().map(|region| margins(region, law)).collect::<Result<_, _>>()?;
    let least = |of: fn(&Margins) -> f64| {
        let worst = regions.iter().min_by(|left, right| of(left).total_cmp(&of(right)));
        worst.map(|margins| Worst { value: of(margins), region: margins.region.clone() }).ok_or(MarginError::NoRegion)
    };
    let gain_margin_db = least(Margins::nearest_gain_margin_db)?;
    let mut spectral_radius = least(|margins| -margins.spectral_radius)?;
    spectral_radius.value = -spectral_radius.value;

    let verdict = if regions.iter().any(|margins| !margins.stable) {
        Verdict::Unstable { region: spectral_radius.region.clone(), spectral_radius: spectral_radius.value }
    } else if gain_margin_db.value < SAFE_GAIN_MARGIN_DB {
        Verdict::BelowSixDb { worst: gain_margin_db.clone() }
    } else {
        Verdict::Stable { worst: gain_margin_db.clone() }
    };
    Ok(Assessment {
        gain_margin_db,
        phase_margin_deg: least(|margins| margins.phase_margin_deg)?,
        delay_margin_s: least(|margins| margins.delay_margin_s)?,
        modulus_margin: least(|margins| margins.modulus_margin)?,
        spectral_radius,
        verdict,
        regions,
    })
}

/// The gain margin of the worst region, or `None` as soon as a region is unstable or has less than `at_least_db`.
fn worst_gain_margin_db(regions: &[LinearRegion], law: &Loop, at_least_db: f64) -> Result<Option<f64>, MarginError> {
    let mut worst_db = f64::INFINITY;
    for region in regions {
        let examined = Examined::new(region, law)?;
        if !examined.stable {
            return Ok(None);
        }
        let curve = examined.curve(region)?;
        let limits = examined.gain_limits(&curve.critical_gains());
        let region_db = limits.upper_db.min(limits.lower_db.map_or(f64::INFINITY, |lower_db| -lower_db));
        if region_db < at_least_db {
            return Ok(None);
        }
        worst_db = worst_db.min(region_db);
    }
    Ok(Some(worst_db))
}

/// A region sampled, with its eigenvalues.
struct Examined {
    sampled: SampledLoop,
    eigenvalues: Vec<Complex<f64>>,
    /// Eigenvalues of the closed loop and of the plant: where the curve of L can be narrow.
    time_scales: Vec<Complex<f64>>,
    spectral_radius: f64,
    stable: bool,
}

struct GainLimits {
    upper_db: f64,
    upper_angle: Option<f64>,
    lower_db: Option<f64>,
}

impl Examined {
    fn new(region: &LinearRegion, law: &Loop) -> Result<Self, MarginError> {
        let samples = law.delay_s * law.rate_hz;
        if samples > MAX_DELAY_SAMPLES {
            return Err(MarginError::DelayTooLong { samples, limit: MAX_DELAY_SAMPLES });
        }
        let too_stiff = || MarginError::TooStiff { region: region.label.clone(), rate_hz: law.rate_hz };
        let no_eigenvalues = || MarginError::NoEigenvalues { region: region.label.clone() };
        let sampled = SampledLoop::new(region, law).ok_or_else(too_stiff)?;
        let eigenvalues = sampled.closed_loop_eigenvalues(1.0).ok_or_else(no_eigenvalues)?;
        let mut time_scales = sampled.plant_eigenvalues().ok_or_else(no_eigenvalues)?;
        time_scales.extend_from_slice(&eigenvalues);
        let spectral_radius = spectral_radius(&eigenvalues);
        Ok(Self { sampled, eigenvalues, time_scales, spectral_radius, stable: is_stable(spectral_radius) })
    }

    fn curve(&self, region: &LinearRegion) -> Result<Curve<'_>, MarginError> {
        Curve::trace(&self.sampled, &self.time_scales)
            .ok_or_else(|| MarginError::Unresolved { region: region.label.clone() })
    }

    /// Stability changes only at a critical gain. A stable loop is limited by the nearest on either side; for an unstable one the
    /// intervals between them are tried outwards from 1.
    fn gain_limits(&self, critical: &[CriticalGain]) -> GainLimits {
        let n_below = critical.partition_point(|at| at.gain <= 1.0);
        let (below, above) = critical.split_at(n_below);
        let to_db = |at: &CriticalGain| 20.0 * at.gain.log10();
        if self.stable {
            return GainLimits {
                upper_db: above.first().map_or(f64::INFINITY, to_db),
                upper_angle: above.first().map(|at| at.angle),
                lower_db: below.last().map(to_db),
            };
        }
        let is_stable_at = |gain: f64| {
            self.sampled.closed_loop_eigenvalues(gain).is_some_and(|found| is_stable(spectral_radius(&found)))
        };
        let falling = (0..below.len()).rev().find(|&i| {
            let next = if i == 0 { 0.25 * below[0].gain } else { below[i - 1].gain };
            is_stable_at((next * below[i].gain).sqrt())
        });
        let rising = (0..above.len()).find(|&i| {
            let next = above.get(i + 1).map_or(4.0 * above[i].gain, |at| at.gain);
            is_stable_at((next * above[i].gain).sqrt())
        });
        GainLimits {
            upper_db: falling.map_or(f64::NEG_INFINITY, |i| to_db(&below[i])),
            upper_angle: falling.map(|i| below[i].angle),
            lower_db: rising.map(|i| to_db(&above[i])),
        }
    }
}

fn spectral_radius(eigenvalues: &[Complex<f64>]) -> f64 {
    eigenvalues.iter().map(|z| z.norm()).fold(0.0, f64::max)
}

fn is_stable(spectral_radius: f64) -> bool {
    spectral_radius < 1.0 - CIRCLE_TOLERANCE
}

fn check_loop(law: &Loop) -> Result<(), MarginError> {
    let &Loop { kp_v_per_m, ki_v_per_m_s, rate_hz, delay_s } = law;
    if !(rate_hz.is_finite() && rate_hz > 0.0 && (1.0 / rate_hz).is_finite()) {
        return Err(MarginError::BadRate { rate_hz });
    }
    if !(delay_s.is_finite() && delay_s >= 0.0) {
        return Err(MarginError::BadDelay { delay_s });
    }
    if !(kp_v_per_m.is_finite() && ki_v_per_m_s.is_finite()) {
        return Err(MarginError::BadGain { kp_v_per_m, ki_v_per_m_s });
    }
    Ok(())
}

fn check_region(region: &LinearRegion) -> Result<(), MarginError> {
    let n = region.a.nrows();
    let fits = n > 0 && region.a.ncols() == n && region.b.len() == n && region.c.len() == n;
    let finite = |x: &f64| x.is_finite();
    if fits
        && region.a.iter().all(finite)
        && region.b.iter().all(finite)
        && region.c.iter().all(finite)
        && region.d.is_finite()
    {
        Ok(())
    } else {
        Err(MarginError::BadRegion { region: region.label.clone() })
    }
}
