//! Table: the thesis plant in closed loop with PI 1, as the thesis has it and as a board runs it.

use crate::report::{Runner, Table, markdown, number};
use anyhow::Result;

pub const TABLE: Table = Table {
    title: "Closed loop: PI 1 on the thesis plant",
    about: "References of 120 um; steps over 20 ms, sines over three periods of which the last is judged. \
            At 1 MHz without delay and without limits the loop stands for the thesis' continuous-time controller. \
            At 20 and 40 kHz, with 10 us from sampling to the new drive, it is the one a board runs: \
            volts and slew limited, reference clamped and shaped. \"ff\" is the static feedforward (k/alpha) r.",
    rows,
};

/// One controller at one rate.
struct Loop {
    controller: &'static str,
    rate_hz: u32,
    delay_us: u32,
}

const LOOPS: &[Loop] = &[
    Loop { controller: "controllers/pi1-unlimited.toml", rate_hz: 1_000_000, delay_us: 0 },
    Loop { controller: "controllers/pi1.toml", rate_hz: 20_000, delay_us: 10 },
    Loop { controller: "controllers/pi1.toml", rate_hz: 40_000, delay_us: 10 },
];

/// Frequencies of the thesis' sines.
const SINES_HZ: &[u32] = &[1, 50, 100, 150];

fn rows(runner: &mut dyn Runner) -> Result<String> {
    let mut steps = Vec::new();
    let mut sines = Vec::new();
    for control in LOOPS {
        for feedforward in [false, true] {
            let name = [
                (control.rate_hz / 1000).to_string(),
                control.delay_us.to_string(),
                if feedforward { "yes" } else { "no" }.to_owned(),
            ];
            let json = runner.json(&arguments(control, feedforward, "step:120um", 0.02))?;
            let mut row = name.to_vec();
            row.push(number(&json, "rise_ms", 3)?);
            row.push(number(&json, "overshoot_percent", 2)?);
            row.push(number(&json, "settle_2_percent_ms", 3)?);
            row.push(number(&json, "peak_um", 1)?);
            row.push(number(&json, "peak_V", 1)?);
            row.push(number(&json, "limited_samples", 0)?);
            steps.push(row);
            for &sine_hz in SINES_HZ {
                let spec = format!("sine:120um@{sine_hz}Hz");
                let json = runner.json(&arguments(control, feedforward, &spec, 3.0 / f64::from(sine_hz)))?;
                let mut row = name.to_vec();
                row.push(sine_hz.to_string());
                row.push(number(&json, "rms_error_percent", 3)?);
                row.push(number(&json, "gain", 4)?);
                row.push(number(&json, "phase_deg", 2)?);
                row.push(number(&json, "peak_um", 1)?);
                row.push(number(&json, "peak_V", 1)?);
                row.push(number(&json, "limited_samples", 0)?);
                sines.push(row);
            }
        }
    }
    let step_header =
        ["kHz", "delay us", "ff", "rise ms", "overshoot %", "settle ms", "peak um", "peak V", "limited samples"];
    let sine_header =
        ["kHz", "delay us", "ff", "Hz", "rms error %", "gain", "phase deg", "peak um", "peak V", "limited samples"];
    Ok(format!("{}\n{}", markdown(&step_header, &steps), markdown(&sine_header, &sines)))
}

fn arguments(control: &Loop, feedforward: bool, reference: &str, seconds: f64) -> Vec<String> {
    let (rate, seconds, delay) = (control.rate_hz.to_string(), seconds.to_string(), control.delay_us.to_string());
    let mut words = vec!["simulate", "--plant", "models/thesis-phs.toml", "--controller", control.controller];
    words.extend(["--reference", reference, "--rate", &rate, "--seconds", &seconds, "--delay-us", &delay]);
    if !feedforward {
        words.push("--no-feedforward");
    }
    words.into_iter().map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fake::Fake;

    #[test]
    fn every_loop_is_run_with_and_without_feedforward_on_every_reference() {
        let mut fake = Fake::default();
        let text = rows(&mut fake).unwrap();
        // 3 loops, with and without feedforward, a step and 4 sines.
        assert_eq!(fake.calls.len(), 3 * 2 * 5);
        assert_eq!(fake.calls.iter().filter(|call| call.contains(&"--no-feedforward".to_owned())).count(), 15);
        assert_eq!(text.lines().filter(|line| line.starts_with("| 20 | 10 | yes |")).count(), 5);
        assert!(text.contains("| 1000 | 0 | yes | 0.153 | 46.15 | - | 175.6 | 167.8 | 0 |"), "{text}");
        assert!(text.contains("| 1000 | 0 | no | 150 | 0.055 | 1.0001 | -0.04 | 175.6 | 167.8 | 0 |"), "{text}");
    }

    #[test]
    fn the_command_line_is_the_contract_s() {
        let words = arguments(&LOOPS[0], false, "sine:120um@50Hz", 0.06).join(" ");
        assert_eq!(
            words,
            "simulate --plant models/thesis-phs.toml --controller controllers/pi1-unlimited.toml \
             --reference sine:120um@50Hz --rate 1000000 --seconds 0.06 --delay-us 0 --no-feedforward"
        );
    }
}
