//! A closed loop around the crudest plant there is, a gain of 1.88 um/V with a lag of 0.2 ms: prints a table of the run.
//!
//! `cargo run -p control-core --example closed_loop`

use control_core::{Command, Controller, Generator, Input, Law, Segment, Settings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let law = Law::try_build(&Settings {
        rate_hz: 20e3,
        kp_v_per_m: 2e4,
        ki_v_per_m_s: 5e8,
        feedforward_v_per_m: 530_737.0,
        drive_min_v: -90.0,
        drive_max_v: 90.0,
        slew_v_per_s: 2e5,
        reference_max_m: Settings::DEFAULT_REFERENCE_MAX_M,
        reference_rate_m_per_s: 0.1,
        reference_acceleration_m_per_s2: 200.0,
        trip_m: Settings::DEFAULT_TRIP_M,
        stop_time_s: 100e-6,
    })?;
    let segments = [Segment::step(80e-6, 100)?, Segment::hold(20e-6, 100)?];
    let generator = Generator::new(&segments);
    let mut controller = Controller::new(law);
    controller.arm()?;
    controller.run()?;
    let mut displacement_m = 0.0_f32;
    println!("time_ms reference_um displacement_um drive_V limited_by");
    for k in 0..200 {
        let output =
            controller.tick(&Input { command: Command::GeneratedReference(generator), measured_m: displacement_m });
        if k % 5 == 0 {
            let (reference_um, displacement_um) = (output.reference_m * 1e6, displacement_m * 1e6);
            let time_ms = k as f32 * 0.05;
            let (drive_v, limited_by) = (output.drive_v, output.limited_by);
            println!("{time_ms:7.2} {reference_um:12.3} {displacement_um:15.3} {drive_v:7.2} {limited_by}");
        }
        displacement_m += (1.88e-6 * output.drive_v - displacement_m) * 0.25;
    }
    Ok(())
}
