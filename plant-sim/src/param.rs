//! A number with its uncertainty and its source: the one record that simulator, fit and report all read.
//!
//! The unit is part of the key that holds the record (`mass_kg = { value = ..., sigma = ..., source = "..." }`).

use serde::{Deserialize, Serialize};

/// Relative standard deviation where a source states none (2 %).
pub const ASSUMED_SIGMA: f64 = 0.02;
/// Relative standard deviation of a weighed mass where a source states none (0.5 %).
pub const ASSUMED_MASS_SIGMA: f64 = 0.005;

/// One number of a model file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a record, as in `{ value = 1.0, source = \"data sheet\" }`")]
pub struct Param {
    /// The number, in the unit that its key names.
    pub value: f64,
    /// Relative standard deviation (0.02 is 2 %); for numbers whose natural null is zero use [`Param::sigma_abs`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<f64>,
    /// Absolute standard deviation in the unit of the value (offsets, delays, noise).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_abs: Option<f64>,
    /// Where the number comes from: a table, a date and method, a fit, or "assumed", which it is where a file says nothing.
    #[serde(default = "assumed", skip_serializing_if = "String::is_empty")]
    pub source: String,
}

fn assumed() -> String {
    "assumed".to_owned()
}

impl Param {
    /// A number with a relative standard deviation.
    pub fn new(value: f64, sigma: f64, source: &str) -> Self {
        Self { value, sigma: Some(sigma), sigma_abs: None, source: source.to_owned() }
    }

    /// A number with an absolute standard deviation, for quantities that may be zero.
    pub fn absolute(value: f64, sigma_abs: f64, source: &str) -> Self {
        Self { value, sigma: None, sigma_abs: Some(sigma_abs), source: source.to_owned() }
    }

    /// A number nobody measured, with the assumed relative standard deviation.
    pub fn assumed(value: f64) -> Self {
        Self::new(value, ASSUMED_SIGMA, "assumed")
    }

    /// Relative standard deviation; [`ASSUMED_SIGMA`] where the record gives none.
    pub fn relative_sigma(&self) -> f64 {
        self.relative_sigma_or(ASSUMED_SIGMA)
    }

    /// The same with what is `assumed` of this number where the record gives none.
    pub fn relative_sigma_or(&self, assumed: f64) -> f64 {
        match (self.sigma, self.sigma_abs) {
            (Some(sigma), _) => sigma,
            (None, Some(absolute)) if self.value != 0.0 => absolute / self.value.abs(),
            _ => assumed,
        }
    }
}
