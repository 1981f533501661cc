//! A set of parameters is taken whole or refused with the field that is wrong.

use control_core::{Ramp, SettingsError};
use wire::{Converters, ParameterError, Parameters};

const NUCLEO: Converters = Converters::NUCLEO_G474RE;

fn good() -> Parameters {
    Parameters::NUCLEO_PI1
}

#[test]
fn the_defaults_of_the_board_are_sound() {
    let checked = good().check(&NUCLEO).unwrap();
    assert_eq!(checked.period_cycles, 8500);
    assert_eq!(checked.link_timeout_samples, 5000);
    // The monitor's pin sees the DAC's own 3.3 V: one of its codes is one of the DAC's.
    assert!((checked.monitor_v_per_code - checked.calibration.drive_v_per_code()).abs() < 1e-6);
    let fast = Parameters { rate_hz: 40e3, ..good() };
    assert_eq!(fast.check(&NUCLEO).unwrap().period_cycles, 4250);
}

#[test]
fn the_defaults_of_the_external_board_are_sound_and_sixteen_times_finer() {
    let external = Parameters::EXTERNAL_PI1.check(&Converters::EXTERNAL_16BIT).unwrap();
    let nucleo = good().check(&NUCLEO).unwrap();
    let ratio = nucleo.calibration.displacement_m_per_code() / external.calibration.displacement_m_per_code();
    assert!((ratio - 16.0).abs() < 1e-3, "{ratio}");
}

#[test]
fn each_wrong_field_is_named() {
    type Case = (Parameters, ParameterError);
    let cases: [Case; 11] = [
        (Parameters { kp_v_per_m: f32::NAN, ..good() }, SettingsError::NotFinite { field: "kp_v_per_m" }.into()),
        (Parameters { slew_v_per_s: f32::INFINITY, ..good() }, ParameterError::Unlimited),
        (
            Parameters { rate_hz: 21e3, ..good() },
            ParameterError::RateDoesNotDivide { rate_hz: 21e3, timer_hz: 170_000_000 },
        ),
        (Parameters { rate_hz: 60e3, ..good() }, ParameterError::RateOutside { least_hz: 2594, most_hz: 50_000 }),
        (Parameters { rate_hz: 0.5, ..good() }, ParameterError::RateOutside { least_hz: 2594, most_hz: 50_000 }),
        (Parameters { slew_v_per_s: 16.8, ..good() }, ParameterError::SlowToZero { least_v_per_s: 16.875 }),
        (Parameters { trip_m: 131e-6, ..good() }, ParameterError::TripBeyondSensor),
        (
            Parameters { sensor_m_per_v: f32::NAN, ..good() },
            SettingsError::NotFinite { field: "sensor_m_per_v" }.into(),
        ),
        (Parameters { monitor_v_per_v: 0.0, ..good() }, ParameterError::NotPositive { field: "monitor_v_per_v" }),
        (Parameters { overrun_limit: 0, ..good() }, ParameterError::NotPositive { field: "overrun_limit" }),
        (Parameters { link_timeout_s: -1.0, ..good() }, ParameterError::NotPositive { field: "link_timeout_s" }),
    ];
    for (parameters, error) in cases {
        assert_eq!(parameters.check(&NUCLEO), Err(error), "{error}");
    }
    let beyond = Parameters { drive_max_v: 92.0, ..good() }.check(&NUCLEO).unwrap_err().to_string();
    assert!(beyond.starts_with("drive_min_v and drive_max_v must lie within -89."), "{beyond}");
}

/// Ten seconds by the ramp that the board takes, which is steeper in its middle than its mean.
#[test]
fn the_slowest_slew_limit_is_at_0_v_within_ten_seconds() {
    let slowest = Parameters { slew_v_per_s: 16.875, ..good() };
    assert!(slowest.check(&NUCLEO).is_ok());
    let mut ramp = Ramp::to_zero(slowest.drive_max_v, slowest.slew_v_per_s / slowest.rate_hz);
    let mut samples = 0_u32;
    while !ramp.is_done() {
        ramp.step();
        samples += 1;
    }
    // Two samples of 50 us: the one that a ramp has more, and one for the rounding of its slope.
    let way_s = f64::from(samples) / f64::from(slowest.rate_hz);
    assert!((way_s - 10.0).abs() < 1e-4, "{way_s}");
    assert!((way_s - 1e-4..way_s + 2e-4).contains(&f64::from(slowest.way_to_zero_s())), "{way_s}");
}

#[test]
fn a_board_may_run_alone_and_without_a_monitor() {
    let alone = Parameters { link_timeout_s: f32::INFINITY, monitor_tolerance_v: f32::INFINITY, ..good() };
    assert_eq!(alone.check(&NUCLEO).unwrap().link_timeout_samples, u32::MAX);
}

#[test]
fn every_code_of_the_monitor_comes_back_and_the_rest_saturates() {
    for (parameters, board) in
        [(Parameters::NUCLEO_PI1, Converters::NUCLEO_G474RE), (Parameters::EXTERNAL_PI1, Converters::EXTERNAL_16BIT)]
    {
        let checked = parameters.check(&board).unwrap();
        for code in 0..4096 {
            assert_eq!(checked.monitor_code(checked.monitor_v(code), &board), code);
        }
        assert_eq!([-1e3, 1e3].map(|volts| checked.monitor_code(volts, &board)), [0, 4095]);
        // 0 V of the amplifier is half of the 3.3 V.
        assert_eq!((checked.monitor_code(0.0, &board), checked.monitor_v(2048)), (2048, 0.0));
    }
}
