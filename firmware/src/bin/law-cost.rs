//! For no board: the control law alone, in functions of their own, so that the virtual board can count the instructions of each.
#![no_std]
#![no_main]

use control_core::{AdcCode, Law, LawState, Pi, PiState};
use core::hint::black_box;
use wire::{Checked, Converters, Parameters};

/// PI with feedforward, volt and slew limits, anti-windup.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn cost_of_pi(pi: &Pi, state: &mut PiState, reference_m: f32, measured_m: f32, limits: &mut u8) -> f32 {
    let (drive_v, limited_by) = pi.step(state, reference_m, measured_m);
    *limits = limited_by.bits();
    drive_v
}

/// The same with trip, reference clamp and shaping.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn cost_of_law(law: &Law, state: &mut LawState, reference_m: f32, measured_m: f32, limits: &mut u8) -> f32 {
    let output = law.step(state, reference_m, measured_m);
    *limits = output.limited_by.bits();
    output.drive_v
}

/// The same from code to code.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn cost_of_codes(set: &Checked, state: &mut LawState, reference_m: f32, adc: u16) -> u16 {
    let measured_m = set.calibration.displacement_m(AdcCode(adc));
    set.calibration.dac_code(set.law.step(state, reference_m, measured_m).drive_v).0
}

#[cortex_m_rt::entry]
fn main() -> ! {
    firmware::registers::copy_control_path();
    let Ok(set) = black_box(Parameters::NUCLEO_PI1).check(&Converters::NUCLEO_G474RE) else {
        panic!("the board's own parameters are refused");
    };
    let mut pi = PiState::default();
    let (mut law, mut codes) = (LawState::default(), LawState::default());
    let mut limits = 0;
    loop {
        // A reference as smooth as shaping wants it, up and down within 50 um, and a measurement that follows it.
        for k in (0..1000).chain((0..1000).rev()) {
            let reference_m = 5e-8 * k as f32;
            let measured_m = 0.9 * reference_m;
            black_box(cost_of_pi(set.law.pi(), &mut pi, reference_m, measured_m, &mut limits));
            black_box(cost_of_law(&set.law, &mut law, reference_m, measured_m, &mut limits));
            black_box(cost_of_codes(&set, &mut codes, reference_m, 2048 + (k / 2) as u16));
            black_box(limits);
        }
    }
}
