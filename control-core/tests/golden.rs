//! One long seeded run of the whole control path, down to its bits.
//!
//! Only IEEE + - * / on f32 and integer operations are used, so every machine and every optimisation level has to give this
//! very hash. A change of the control law changes it on purpose: then the new value goes here, with a line in the changelog.

use control_core::{Calibration, CalibrationSettings, Command, Controller, Generator, Input, Law, Segment, Settings};

/// FNV-1a, 64 bits.
struct Fnv(u64);

impl Fnv {
    fn take(&mut self, word: u32) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

/// The run: 200,000 samples of a noisy plant, every wave, open and closed loop, two laws, faults and stops. Returns the hash and
/// how many samples were spent in each mode.
fn run(seed: u32) -> (u64, [u32; 5]) {
    let settings = Settings {
        rate_hz: 20e3,
        kp_v_per_m: 2.3164e4,
        ki_v_per_m_s: 1.8384e8,
        feedforward_v_per_m: 530_737.0,
        drive_min_v: -90.0,
        drive_max_v: 90.0,
        slew_v_per_s: 2e5,
        reference_max_m: 100e-6,
        reference_rate_m_per_s: 0.1,
        reference_acceleration_m_per_s2: 200.0,
        trip_m: 120e-6,
        stop_time_s: 100e-6,
    };
    let stiffer = Settings { kp_v_per_m: 6e4, ki_v_per_m_s: 3e8, ..settings };
    let laws = [settings, stiffer].map(|s| Law::try_build(&s).expect("sound settings"));
    let calibration = Calibration::try_build(&CalibrationSettings::NUCLEO_G474RE).expect("sound settings");

    let table: Vec<f32> = (0..77_u8).map(|i| f32::from(i % 11) * 7e-6 - 30e-6).collect();
    let rate_hz = 20e3;
    let closed = [
        Segment::step(80e-6, 500),
        Segment::square(rate_hz, 40e-6, 20.0, 2000),
        Segment::sine(rate_hz, 80e-6, 50.0, 2000),
        Segment::triangle(rate_hz, 90e-6, 10.0, 2000),
        Segment::table(&table, 1000),
        Segment::zero(100),
    ]
    .map(|segment| segment.expect("sound segment"));
    let open = [
        Segment::linear_sweep(rate_hz, 20.0, 1.0, 2000.0, 4000),
        Segment::log_sweep(rate_hz, 20.0, 2000.0, 1.0, 4000),
        Segment::ladder(50.0, 8, 100),
        Segment::decaying_sine(rate_hz, 50.0, 8.0, 5000),
        Segment::hold(10.0, 100),
    ]
    .map(|segment| segment.expect("sound segment"));
    let (closed, open) = (Generator::new(&closed), Generator::new(&open));

    let mut controller = Controller::new(laws[0]);
    let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
    let mut in_mode = [0; 5];
    let mut random = seed;
    let (mut displacement_m, mut closed_loop) = (0.0_f32, true);
    for _ in 0..200_000 {
        // Numerical Recipes' generator: integers only.
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let dice = random >> 16;
        // What is refused is part of the run.
        let accepted = match dice {
            0..=999 => controller.arm().is_ok(),
            1000..=1999 => controller.run().is_ok(),
            2000..=2015 => {
                closed_loop = !closed_loop;
                controller.stop().is_ok()
            }
            2016..=2999 => controller.clear_fault().is_ok(),
            3000..=3031 => {
                controller.exchange_law(laws[(dice & 1) as usize]);
                true
            }
            _ => true,
        };
        // A gain with a lag, and a little noise that is exact in f32.
        let noise_m = (dice as f32 - 32_768.0) * 1e-12;
        let code = calibration.adc_code(displacement_m + noise_m);
        let measured_m = match dice {
            4000..=4001 => f32::NAN,
            4002..=4003 => 125e-6,
            _ => calibration.displacement_m(code),
        };
        let command = match (closed_loop, dice) {
            (_, 4004) => Command::Reference { reference_m: f32::INFINITY },
            (_, 5000..=5100) => Command::Drive { drive_v: 200.0 },
            (true, _) => Command::GeneratedReference(closed),
            (false, _) => Command::GeneratedDrive(open),
        };
        let output = controller.tick(&Input { command, measured_m });
        let dac = calibration.dac_code(output.drive_v);
        displacement_m += (1.88e-6 * calibration.drive_v(dac) - displacement_m) * 0.25;
        hash.take(output.drive_v.to_bits());
        hash.take(output.reference_m.to_bits());
        hash.take(u32::from(output.limited_by.bits()));
        hash.take(u32::from(dac.0));
        hash.take(u32::from(accepted));
        in_mode[controller.mode_name() as usize] += 1;
    }
    (hash.0, in_mode)
}

#[test]
fn a_long_run_gives_the_same_bits_on_every_machine() {
    let (hash, in_mode) = run(1);
    // The run is worth its hash only if it has been everywhere, and most of the time in the loop.
    assert!(in_mode.iter().all(|samples| *samples > 50), "{in_mode:?}");
    assert!(in_mode[2] > 100_000, "{in_mode:?}");
    assert_eq!(hash, 0x81fe_79c6_50a6_695a, "{hash:#018x}");
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_seed_another() {
    assert_eq!(run(7), run(7));
    assert_ne!(run(7).0, run(8).0);
}
