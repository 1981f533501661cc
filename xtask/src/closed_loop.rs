//! Table: the thesis plant in closed loop with PI 1, as the thesis has it and as a board runs it.

use crate::report::{Runner, Table, markdown, number};
use anyhow::Result;

pub const TABLE: Table = Table {
    title: "Closed loop on the thesis plant",
    about: "Steps over 20 ms, sines over three periods of which the last is judged. At 1 MHz without delay and without limits \
            the loop stands for the thesis' continuous-time controller, with its 120 um that would break the bender. \
            At 20 and 40 kHz, with 10 us from sampling to the new drive, it is the one a board runs, at the 100 um to which \
            it clamps: volts and slew limited, reference shaped. Peaks are predictions for a bench. \
            \"ff\" is the static feedforward (k/alpha) r; \"limited\" counts samples in which a limit acted; the shaping of the reference is not one.",
    rows,
};

/// One controller at one rate.
struct Loop {
    name: &'static str,
    controller: &'static str,
    amplitude_um: u32,
    rate_hz: u32,
    delay_us: u32,
}

const LOOPS: &[Loop] = &[
    Loop {
        name: "PI 1, unlimited",
        controller: "controllers/pi1-unlimited.toml",
        amplitude_um: 120,
        rate_hz: 1_000_000,
        delay_us: 0,
    },
    Loop { name: "PI 1", controller: "controllers/pi1.toml", amplitude_um: 100, rate_hz: 20_000, delay_us: 10 },
    Loop { name: "PI 1", controller: "controllers/pi1.toml", amplitude_um: 100, rate_hz: 40_000, delay_us: 10 },
    Loop { name: "PI 2", controller: "controllers/pi2.toml", amplitude_um: 100, rate_hz: 20_000, delay_us: 10 },
    Loop { name: "PI 2", controller: "controllers/pi2.toml", amplitude_um: 100, rate_hz: 40_000, delay_us: 10 },
];

/// Frequencies of the thesis' sines.
const SINES_HZ: &[u32] = &[1, 50, 100, 150];

fn rows(runner: &mut dyn Runner) -> Result<String> {
    let mut steps = Vec::new();
    let mut sines = Vec::new();
    for control in LOOPS {
        for feedforward in [false, true] {
            let name = [
                control.name.to_owned(),
                (control.rate_hz / 1000).to_string(),
                control.delay_us.to_string(),
                if feedforward { "yes" } else { "no" }.to_owned(),
            ];
            let json =
                runner.json(&arguments(control, feedforward, &format!("step:{}um", control.amplitude_um), 0.02))?;
            let mut row = name.to_vec();
            row.push(number(&json, "rise_ms", 3)?);
            row.push(number(&json, "overshoot_percent", 2)?);
            row.push(number(&json, "settle_2_percent_ms", 3)?);
            row.push(number(&json, "peak_um", 1)?);
            row.push(number(&json, "peak_V", 1)?);
            row.push(number(&json, "limited_samples", 0)?);
            steps.push(row);
            for &sine_hz in SINES_HZ {
                let spec = format!("sine:{}um@{sine_hz}Hz", control.amplitude_um);
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
        ["controller", "kHz", "delay us", "ff", "rise ms", "overshoot %", "settle ms", "peak um", "peak V", "limited"];
    let sine_header = [
        "controller",
        "kHz",
        "delay us",
        "ff",
        "Hz",
        "rms error %",
        "gain",
        "phase deg",
        "peak um",
        "peak V",
        "limited",
    ];
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
        // 5 loops, with and without feedforward, a step and 4 sines.
        assert_eq!(fake.calls.len(), 5 * 2 * 5);
        assert_eq!(fake.calls.iter().filter(|call| call.contains(&"--no-feedforward".to_owned())).count(), 25);
        assert_eq!(text.lines().filter(|line| line.starts_with("| PI 1 | 20 | 10 | yes |")).count(), 5);
        assert!(
            text.contains("| PI 1, unlimited | 1000 | 0 | yes | 0.153 | 46.15 | - | 175.6 | 167.8 | 0 |"),
            "{text}"
        );
        assert!(
            text.contains("| PI 1, unlimited | 1000 | 0 | no | 150 | 0.055 | 1.0001 | -0.04 | 175.6 | 167.8 | 0 |"),
            "{text}"
        );
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
