//! Feedforward that inverts the identified plant, hysterons included: the volts that would move it along the reference.
//!
//! ```text
//! V = (M r'' + b r' + k r)/alpha + sum v_i,   C_i v_i' = alpha r' - h_i(v_i)        (2.5) solved for V
//! u = V + tau V'                                                                    ahead of a first-order amplifier
//! ```
//!
//! The drive acts from D after the sample until a sample later, so that reference and hysterons are taken `lead` = D + T/2 ahead, by the
//! reference's own velocity and acceleration. A hysteron inside its dead zone follows r exactly; beyond it, it leaks by its own
//! exponential over a sample.
//!
//! **Deadline.** As [`crate::Law`]: no division and no call outside this crate in [`Inverse::step`]; one short loop over the hysterons.
//!
//! Not here: feedback. Errors of the identified numbers are the integral's business.

use crate::arithmetic::between;
use crate::settings::{SettingsError, finite_above_zero, finite_from_zero};

/// Most hysterons that are inverted.
pub const MOST_HYSTERONS: usize = 6;

/// A hysteron as the model file has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseHysteron {
    /// C in farad.
    pub capacitance_f: f32,
    /// beta in siemens.
    pub slope_s: f32,
    /// d in volts; zero for a creep element.
    pub dead_zone_v: f32,
}

/// The plant to be inverted, in physical units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseSettings<'a> {
    /// Samples per second.
    pub rate_hz: f32,
    /// From sampling to the new drive, in seconds.
    pub delay_s: f32,
    /// M in kg.
    pub mass_kg: f32,
    /// b in N s/m.
    pub damping_n_s_per_m: f32,
    /// k in N/m.
    pub stiffness_n_per_m: f32,
    /// alpha in C/m.
    pub transduction_c_per_m: f32,
    /// tau of the amplifier in seconds; zero for none.
    pub amplifier_s: f32,
    /// The hysterons.
    pub hysterons: &'a [InverseHysteron],
}

/// The inverse, per sample. Immutable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inverse {
    stiffness_v: f32,
    damping_v: f32,
    mass_v: f32,
    amplifier: f32,
    lead: f32,
    count: usize,
    per_metre_v: [f32; MOST_HYSTERONS],
    edge_v: [f32; MOST_HYSTERONS],
    /// Share of what is beyond the edge that leaks in a sample.
    leak: [f32; MOST_HYSTERONS],
}

/// What the inverse remembers; `default()` is relaxed at the origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InverseState {
    reference_m: f32,
    velocity_m: f32,
    ahead_m: f32,
    volts: f32,
    held_v: [f32; MOST_HYSTERONS],
}

impl InverseState {
    /// Voltage of each hysteron that the reference has left, those that are not there zero.
    pub fn held_v(&self) -> [f32; MOST_HYSTERONS] {
        self.held_v
    }
}

impl Inverse {
    /// Checks the numbers and turns them into volts per metre and sample.
    ///
    /// # Errors
    ///
    /// [`SettingsError`] names the first field that can't be used.
    pub fn try_build(settings: &InverseSettings<'_>) -> Result<Inverse, SettingsError> {
        let rate = settings.rate_hz;
        finite_above_zero("rate_hz", rate)?;
        finite_above_zero("mass_kg", settings.mass_kg)?;
        finite_above_zero("stiffness_n_per_m", settings.stiffness_n_per_m)?;
        finite_above_zero("transduction_c_per_m", settings.transduction_c_per_m)?;
        finite_from_zero("delay_s", settings.delay_s)?;
        finite_from_zero("damping_n_s_per_m", settings.damping_n_s_per_m)?;
        finite_from_zero("amplifier_s", settings.amplifier_s)?;
        if settings.hysterons.len() > MOST_HYSTERONS {
            return Err(SettingsError::TooLarge { field: "inverse.hysteron", at_most: MOST_HYSTERONS as u32 });
        }
        let alpha = settings.transduction_c_per_m;
        let mut inverse = Inverse {
            stiffness_v: settings.stiffness_n_per_m / alpha,
            damping_v: settings.damping_n_s_per_m / alpha * rate,
            mass_v: settings.mass_kg / alpha * rate * rate,
            amplifier: settings.amplifier_s * rate,
            lead: settings.delay_s * rate + 0.5,
            count: settings.hysterons.len(),
            per_metre_v: [0.0; MOST_HYSTERONS],
            edge_v: [0.0; MOST_HYSTERONS],
            leak: [0.0; MOST_HYSTERONS],
        };
        for (i, hysteron) in settings.hysterons.iter().enumerate() {
            finite_above_zero("capacitance_f", hysteron.capacitance_f)?;
            finite_from_zero("slope_s", hysteron.slope_s)?;
            finite_from_zero("dead_zone_v", hysteron.dead_zone_v)?;
            inverse.per_metre_v[i] = alpha / hysteron.capacitance_f;
            inverse.edge_v[i] = 0.5 * hysteron.dead_zone_v;
            // 1 - 1/(series of e^x): right to x^5/120 for a slow hysteron, and one for a fast one.
            let x = hysteron.slope_s / hysteron.capacitance_f / rate;
            inverse.leak[i] = 1.0 - 1.0 / (1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x / 24.0))));
        }
        Ok(inverse)
    }

    /// Volts for the shaped reference of this sample, which must be finite.
    #[inline]
    pub fn step(&self, state: &mut InverseState, reference_m: f32) -> f32 {
        let velocity_m = reference_m - state.reference_m;
        let bend_m = velocity_m - state.velocity_m;
        state.reference_m = reference_m;
        state.velocity_m = velocity_m;
        // The difference belongs half a sample back.
        let now_m = velocity_m + 0.5 * bend_m;
        let ahead_m = reference_m + self.lead * (now_m + 0.5 * self.lead * bend_m);
        let speed_m = now_m + self.lead * bend_m;
        let by_m = ahead_m - state.ahead_m;
        state.ahead_m = ahead_m;
        let mut volts = self.stiffness_v * ahead_m + self.damping_v * speed_m + self.mass_v * bend_m;
        for i in 0..self.count {
            let moved_v = state.held_v[i] + self.per_metre_v[i] * by_m;
            let beyond_v = moved_v - between(moved_v, -self.edge_v[i], self.edge_v[i]);
            state.held_v[i] = moved_v - self.leak[i] * beyond_v;
            volts += state.held_v[i];
        }
        let rate_v = volts - state.volts;
        state.volts = volts;
        volts + self.amplifier * rate_v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(hysterons: &[InverseHysteron]) -> InverseSettings<'_> {
        InverseSettings {
            rate_hz: 40e3,
            delay_s: 10e-6,
            mass_kg: 1e-3,
            damping_n_s_per_m: 4.0,
            stiffness_n_per_m: 25e3,
            transduction_c_per_m: 0.05,
            amplifier_s: 0.0,
            hysterons,
        }
    }

    #[test]
    fn at_rest_it_is_the_static_feedforward_and_what_hysterons_hold() {
        let hysteron = InverseHysteron { capacitance_f: 5e-7, slope_s: 0.5, dead_zone_v: 10.0 };
        let inverse = Inverse::try_build(&settings(&[hysteron])).unwrap();
        let mut state = InverseState::default();
        // 80 um in a second, then rest: the fast hysteron ends on its edge.
        for k in 0..40_000 {
            inverse.step(&mut state, 80e-6 * k as f32 / 40e3);
        }
        let mut volts = 0.0;
        for _ in 0..100 {
            volts = inverse.step(&mut state, 80e-6);
        }
        // 80 um k/alpha = 40 V and the edge of 5 V; f32 and the last leak leave a millivolt.
        assert!((volts - 45.0).abs() < 2e-3, "{volts}");
        assert!((state.held_v()[0] - 5.0).abs() < 1e-3);
    }

    #[test]
    fn what_cannot_be_inverted_is_named() {
        let hysteron = InverseHysteron { capacitance_f: 5e-7, slope_s: 0.5, dead_zone_v: 10.0 };
        let none = InverseSettings { mass_kg: 0.0, ..settings(&[]) };
        assert_eq!(Inverse::try_build(&none), Err(SettingsError::NotPositive { field: "mass_kg" }));
        let many = [hysteron; MOST_HYSTERONS + 1];
        assert_eq!(
            Inverse::try_build(&settings(&many)),
            Err(SettingsError::TooLarge { field: "inverse.hysteron", at_most: MOST_HYSTERONS as u32 })
        );
    }
}
