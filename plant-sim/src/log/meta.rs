//! Metadata of a log: how it was recorded. Read from `# key: value` lines, written the same way.

use std::collections::BTreeMap;
use std::path::Path;

use super::column::is_rate;
use super::error::{LogError, excerpt};

/// What the command does between two samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Hold {
    /// Constant (a DAC).
    #[default]
    Zoh,
    /// A straight line to the next sample.
    Foh,
    /// The band-limited signal through the samples (a multisine, an audio generator).
    Bandlimited,
}

impl Hold {
    fn name(self) -> &'static str {
        match self {
            Self::Zoh => "zoh",
            Self::Foh => "foh",
            Self::Bandlimited => "bandlimited",
        }
    }
}

/// How a log was recorded. What a log does not say is `None`, or the contract's default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Meta {
    /// Sampling rate, hertz.
    pub rate_hz: Option<f64>,
    /// What the command does between samples.
    pub hold: Hold,
    /// From sampling the displacement to the command taking effect, seconds.
    pub latency_s: f64,
    /// One step of the displacement's converter, metres.
    pub adc_lsb_m: Option<f64>,
    /// One step of the command's converter, volts.
    pub dac_lsb_v: Option<f64>,
    /// Samples in one period of a periodic excitation.
    pub period_samples: Option<usize>,
    /// Start-up to be simulated but never fitted or scored, seconds.
    pub run_in_s: Option<f64>,
    /// The controller's file or name.
    pub controller: Option<String>,
    /// The firmware's version.
    pub firmware: Option<String>,
    /// Seed of a simulated log, as printed.
    pub seed: Option<String>,
    /// Keys that the contract does not know, kept as they are.
    pub other: BTreeMap<String, String>,
}

impl Meta {
    /// Rows of the start-up at a sampling period of `dt_s`: of `asked_s` seconds, else of what the log states.
    pub fn run_in_rows(&self, asked_s: Option<f64>, dt_s: f64) -> usize {
        (asked_s.or(self.run_in_s).unwrap_or(0.0) / dt_s).round() as usize
    }

    /// Takes one `key: value` over. `line` is `None` where the file has no lines.
    pub(crate) fn set(&mut self, path: &Path, line: Option<u64>, key: &str, text: &str) -> Result<(), LogError> {
        let bad = |expected| LogError::MetaValue {
            path: path.to_path_buf(),
            line,
            key: key.to_owned(),
            text: excerpt(text),
            expected,
        };
        // The decimal point is moved in the text, so that 0.1 um comes back as the same bits.
        let number = |exponent: i32, low: f64, expected| {
            let mut scratch = String::new();
            super::column::Scale::Power(exponent)
                .parse(text, &mut scratch)
                .filter(|value| value.is_finite() && *value >= low)
                .ok_or_else(|| bad(expected))
        };
        match key {
            "rate_hz" => {
                let rate_hz = number(0, 0.0, "a rate above zero")?;
                if !is_rate(rate_hz) {
                    return Err(bad("a rate above zero"));
                }
                self.rate_hz = Some(rate_hz);
            }
            "hold" => {
                self.hold = [Hold::Zoh, Hold::Foh, Hold::Bandlimited]
                    .into_iter()
                    .find(|hold| hold.name() == text)
                    .ok_or_else(|| bad("zoh, foh or bandlimited"))?;
            }
            "latency_us" => self.latency_s = number(-6, 0.0, "a time of at least zero")?,
            "adc_lsb_um" => self.adc_lsb_m = Some(number(-6, 0.0, "a length of at least zero")?),
            "dac_lsb_V" => self.dac_lsb_v = Some(number(0, 0.0, "a voltage of at least zero")?),
            "run_in_s" => self.run_in_s = Some(number(0, 0.0, "a time of at least zero")?),
            "period_samples" => {
                let n = text.parse().ok().filter(|&n: &usize| n > 0);
                self.period_samples = Some(n.ok_or_else(|| bad("a whole number above zero"))?);
            }
            "controller" => self.controller = Some(text.to_owned()),
            "firmware" => self.firmware = Some(text.to_owned()),
            "seed" => self.seed = Some(text.to_owned()),
            _ => {
                self.other.insert(key.to_owned(), text.to_owned());
            }
        }
        Ok(())
    }

    /// Keys and values as they are written: only what differs from the default, numbers so that they come back
    /// as the same bits, text on one line.
    pub(crate) fn entries(&self) -> Vec<(String, String)> {
        let mut entries: Vec<(String, String)> = Vec::new();
        let mut put = |key: &str, value: Option<String>| {
            if let Some(value) = value {
                let one_line = |text: &str| text.replace(|c: char| c.is_control(), " ").trim().to_owned();
                entries.push((one_line(key), one_line(&value)));
            }
        };
        let number = |value: f64, exponent: i32| super::writer::shortest(value, exponent);
        put("rate_hz", self.rate_hz.map(|v| number(v, 0)));
        put("hold", Some(self.hold.name().to_owned()));
        put("latency_us", (self.latency_s != 0.0).then(|| number(self.latency_s, -6)));
        put("adc_lsb_um", self.adc_lsb_m.map(|v| number(v, -6)));
        put("dac_lsb_V", self.dac_lsb_v.map(|v| number(v, 0)));
        put("period_samples", self.period_samples.map(|n| n.to_string()));
        put("run_in_s", self.run_in_s.map(|v| number(v, 0)));
        put("controller", self.controller.clone());
        put("firmware", self.firmware.clone());
        put("seed", self.seed.clone());
        for (key, value) in &self.other {
            put(key, Some(value.clone()));
        }
        entries
    }
}
