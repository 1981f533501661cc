//! A recording as columns, and its text.

use std::fmt::Write;

/// One log. Row k: displacement sampled at k / rate; the command applies from then plus the latency to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// File name without ending.
    pub name: String,
    /// Rows per second.
    pub rate_hz: f64,
    /// From sampling to the command's edge.
    pub latency_us: f64,
    /// Commanded voltage.
    pub command_v: Vec<f64>,
    /// Measured displacement.
    pub displacement_um: Vec<f64>,
    /// Reference of a closed loop.
    pub reference_um: Option<Vec<f64>>,
    /// Amplifier's output monitor.
    pub drive_v: Option<Vec<f64>>,
}

impl Record {
    /// The log as CSV with metadata lines, as contracts.md defines it.
    pub fn to_csv(&self) -> String {
        let mut text = String::with_capacity(40 * self.command_v.len());
        let _ = writeln!(text, "# rate_hz: {}\n# latency_us: {}", self.rate_hz, self.latency_us);
        text.push_str("time_s,command_V,displacement_um");
        if self.reference_um.is_some() {
            text.push_str(",reference_um");
        }
        if self.drive_v.is_some() {
            text.push_str(",drive_V");
        }
        text.push('\n');
        for (k, (command_v, displacement_um)) in self.command_v.iter().zip(&self.displacement_um).enumerate() {
            // Writing to a String cannot fail.
            let _ = write!(text, "{:.6},{command_v:.6},{displacement_um:.6}", k as f64 / self.rate_hz);
            if let Some(column) = &self.reference_um {
                let _ = write!(text, ",{:.6}", column[k]);
            }
            if let Some(column) = &self.drive_v {
                let _ = write!(text, ",{:.6}", column[k]);
            }
            text.push('\n');
        }
        text
    }

    /// Length in seconds.
    pub fn seconds(&self) -> f64 {
        self.command_v.len() as f64 / self.rate_hz
    }
}
