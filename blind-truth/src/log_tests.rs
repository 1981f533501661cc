//! What a log must be whatever is planted: clocks start with its first row, its loop obeys its law, its rows and the
//! chain's parts stand in order. No test here asks what a part does to the motion.

use crate::drive::Drive;
use crate::sensor::Follow;
use rand::SeedableRng;
use rand_pcg::Pcg64;

#[test]
fn what_is_a_function_of_time_starts_with_row_zero() {
    // Powers of two: the clocks meet row 0 without rounding.
    let (h_s, before_s) = (1.0 / 4096.0, 0.25);
    let (gain, tau_s, u) = (0.1, 0.2, 50.0);
    for drive in [
        Drive::SettlingGain { error: gain, share: 0.3, tau_s },
        Drive::FlickeringGain { error: gain, share: 0.3, mean_s: 0.05 },
        Drive::TimeWarming { gain, tau_s },
        Drive::RoomSwing { gain, period_s: 1.0, phase_rad: 0.4 },
        Drive::LateWarming { gain, tau_s },
        Drive::WarmingFrom { gain, tau_s, within_s: 0.3 },
        Drive::Ageing { per_decade: gain, t0_s: 0.1 },
    ] {
        let begin = |before_s: f64| drive.begin(h_s, before_s, &mut Pcg64::seed_from_u64(5));
        let (mut late, mut fresh) = (begin(before_s), begin(0.0));
        let history: Vec<f64> = (0..1024).map(|_| drive.step(&mut late, u, h_s)).collect();
        assert!(history.iter().all(|v| v == &history[0]), "{drive:?} moves before row 0");
        for k in 0..4096 {
            assert_eq!(drive.step(&mut late, u, h_s), drive.step(&mut fresh, u, h_s), "{drive:?}, step {k}");
        }
    }
    let mode = Follow::LooseMode { m_per_v: 1e-7, hz: 300.0, damping_ratio: 0.01, share: 0.1, tau_s };
    let (mut late, mut fresh) = (mode.begin(h_s, before_s), mode.begin(h_s, 0.0));
    (0..1024).for_each(|_| assert_eq!(mode.step(&mut late, 0.0, 0.0, h_s), 0.0));
    for k in 0..4096 {
        assert_eq!(mode.step(&mut late, 0.0, u, h_s), mode.step(&mut fresh, 0.0, u, h_s), "step {k}");
    }
}
