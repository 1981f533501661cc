//! The columns of a log: their names and units in files, and the step from a file's unit to SI.
//!
//! This is the only place of the project that knows micrometres on reading and writing logs.

use std::collections::BTreeMap;

use super::ReadOptions;
use super::error::LogError;

/// A column of a log. Inside the program every one is in SI.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Column {
    /// Time of the sample, seconds.
    Time,
    /// Command, volts, from `time + latency` until the next.
    Command,
    /// Measured displacement, metres.
    Displacement,
    /// Reference displacement, metres.
    Reference,
    /// The amplifier's output monitor, volts.
    Drive,
    /// Force, newtons.
    Force,
    /// Current, amperes.
    Current,
    /// Temperature, degrees Celsius (the one unit that is not SI: an offset scale is what sensors give).
    Temperature,
    /// What limited the controller, its stable code.
    LimitedBy,
    /// Sequence number of the record.
    Seq,
    /// Predicted displacement, metres. Written by `replay`, never read.
    Predicted,
}

/// Columns that are read. `Predicted` is not one of them.
pub(crate) const N_READ: usize = 10;

/// All columns, in the order in which they are written.
pub(crate) const ALL: [Column; 11] = [
    Column::Time,
    Column::Command,
    Column::Displacement,
    Column::Reference,
    Column::Drive,
    Column::Force,
    Column::Current,
    Column::Temperature,
    Column::LimitedBy,
    Column::Seq,
    Column::Predicted,
];

/// Endings that are no unit of any quantity here: to take them for the contract's unit would be wrong by a factor.
const OTHER_UNITS: [&str; 7] = ["lsb", "LSB", "count", "counts", "pct", "percent", "%"];

impl Column {
    /// Name in files, with its unit.
    pub fn file_name(self) -> &'static str {
        match self {
            Self::Time => "time_s",
            Self::Command => "command_V",
            Self::Displacement => "displacement_um",
            Self::Reference => "reference_um",
            Self::Drive => "drive_V",
            Self::Force => "force_N",
            Self::Current => "current_A",
            Self::Temperature => "temperature_C",
            Self::LimitedBy => "limited_by",
            Self::Seq => "seq",
            Self::Predicted => "predicted_um",
        }
    }

    /// Key in `--columns` and `--scale`.
    pub fn key(self) -> &'static str {
        match self {
            Self::Time => "time",
            Self::Command => "command",
            Self::Displacement => "displacement",
            Self::Reference => "reference",
            Self::Drive => "drive",
            Self::Force => "force",
            Self::Current => "current",
            Self::Temperature => "temperature",
            Self::LimitedBy => "limited_by",
            Self::Seq => "seq",
            Self::Predicted => "predicted",
        }
    }

    /// Decimal exponent of the unit of [`Column::file_name`]: -6 for lengths, 0 otherwise.
    pub(crate) fn file_exponent(self) -> i32 {
        match self {
            Self::Displacement | Self::Reference | Self::Predicted => -6,
            _ => 0,
        }
    }

    /// Position in a [`super::source::RawRow`].
    pub(crate) fn idx(self) -> usize {
        self as usize
    }

    /// The unit that a file's own column name ends in, as a decimal exponent of SI; the contract's unit where it
    /// ends in none that fits the quantity; the ending itself where that is a unit which none of these can be.
    ///
    /// `y_nm`, `y [nm]` and `y (nm)` are in nanometres, `pos_m` in metres, `y` and `y_um` in micrometres; `t_ms` in
    /// milliseconds; `u_mV` in millivolts. Case counts, since `mV` and `MV` differ.
    fn exponent_of(self, name: &str) -> Result<i32, String> {
        let (symbol, others): (_, &[&str]) = match self {
            Self::Time => ("s", &["min", "h", "hr"]),
            Self::Command | Self::Drive => ("V", &[]),
            // A sensor's volts are no displacement yet.
            Self::Displacement | Self::Reference | Self::Predicted => {
                ("m", &["cm", "dm", "inch", "inches", "mil", "ft", "V", "kV", "mV", "uV", "nV"])
            }
            Self::Force => ("N", &["gf", "kgf", "lbf"]),
            Self::Current => ("A", &[]),
            Self::Temperature | Self::LimitedBy | Self::Seq => return Ok(0),
        };
        let Some((_, unit)) = name.trim().trim_end_matches([']', ')']).rsplit_once(['_', '[', '(']) else {
            return Ok(self.file_exponent());
        };
        let unit = unit.trim();
        match unit.strip_suffix(symbol) {
            Some("") => Ok(0),
            Some("k") => Ok(3),
            Some("m") => Ok(-3),
            // Two code points are in use for micro: the micro sign and the Greek letter.
            Some("u" | "\u{b5}" | "\u{3bc}") => Ok(-6),
            Some("n") => Ok(-9),
            Some("p") => Ok(-12),
            _ if OTHER_UNITS.contains(&unit) || others.contains(&unit) => Err(unit.to_owned()),
            _ => Ok(self.file_exponent()),
        }
    }
}

/// From a file's unit to SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scale {
    /// By a power of ten: the decimal point moves and the number is rounded once, so that writing and reading
    /// a CSV gives back the same bits.
    Power(i32),
    /// By any other factor.
    Factor(f64),
}

impl Scale {
    /// The scale of a column called `name` in the file.
    ///
    /// # Errors
    /// [`LogError::OtherUnit`].
    pub(crate) fn of(column: Column, name: &str, options: &ReadOptions) -> Result<Self, LogError> {
        match options.scale.get(column.key()) {
            Some(&factor) => Ok(Self::from_factor(factor)),
            None => column.exponent_of(name).map(Self::Power).map_err(|unit| LogError::OtherUnit {
                name: name.to_owned(),
                unit,
                key: column.key(),
            }),
        }
    }

    /// Recognises powers of ten up to 10^22, the largest one that an f64 holds exactly.
    fn from_factor(factor: f64) -> Self {
        (-22..=22)
            .find(|&exponent| format!("1e{exponent}").parse() == Ok(factor))
            .map_or(Self::Factor(factor), Self::Power)
    }

    /// The SI value of a number read from a binary file. Rounds once: powers of ten are exact as f64, their
    /// inverses are not, so a division is better than a multiplication by 1e-6.
    pub(crate) fn apply(self, value: f64) -> f64 {
        match self {
            Self::Power(0) => value,
            Self::Power(exponent) if exponent > 0 => value * 10f64.powi(exponent),
            Self::Power(exponent) => value / 10f64.powi(-exponent),
            Self::Factor(factor) => value * factor,
        }
    }

    /// The SI value of a number printed in a text file, `None` if it is none. May be infinite or NaN.
    pub(crate) fn parse(self, text: &str, scratch: &mut String) -> Option<f64> {
        let shift = match self {
            Self::Power(0) => return text.parse().ok(),
            Self::Power(shift) => shift,
            Self::Factor(factor) => return text.parse::<f64>().ok().map(|value| value * factor),
        };
        scratch.clear();
        match text.find(['e', 'E']) {
            None => {
                scratch.push_str(text);
                push_exponent(scratch, shift);
            }
            Some(at) => {
                let exponent: i32 = text[at + 1..].parse().ok()?;
                scratch.push_str(&text[..at]);
                push_exponent(scratch, exponent.saturating_add(shift));
            }
        }
        // `nan` and `inf` take no exponent; they are numbers all the same, refused later by their value.
        scratch.parse().or_else(|_| text.parse()).ok()
    }
}

/// Appends `e<exponent>`; the common case without the formatting machinery.
fn push_exponent(text: &mut String, exponent: i32) {
    if exponent == -6 {
        text.push_str("e-6");
    } else {
        text.push('e');
        text.push_str(&exponent.to_string());
    }
}

/// A column to be read: which, what the file calls it, and its scale.
#[derive(Clone, Debug)]
pub(crate) struct Wanted {
    pub(crate) column: Column,
    pub(crate) name: String,
    pub(crate) mapped: bool,
}

impl Wanted {
    /// Whether a file without this column is refused: those every log has, and those the user named.
    pub(crate) fn is_required(&self) -> bool {
        self.mapped || matches!(self.column, Column::Command | Column::Displacement)
    }
}

/// The columns to look for. With a rate given there is no time column to look for.
///
/// # Errors
/// [`LogError::UnknownKey`] and [`LogError::BadOption`] where the options make no sense.
pub(crate) fn wanted(options: &ReadOptions) -> Result<Vec<Wanted>, LogError> {
    check_keys("--columns", &options.columns)?;
    check_keys("--scale", &options.scale)?;
    for (key, &value) in &options.scale {
        // A negative scale turns a sensor round, which is legitimate; zero loses the data.
        if !value.is_finite() || value == 0.0 {
            return Err(LogError::BadOption { option: format!("--scale {key}"), value, expected: "other than zero" });
        }
    }
    if let Some(value) = options.rate_hz.filter(|&rate_hz| !is_rate(rate_hz)) {
        return Err(LogError::BadOption { option: "--rate".into(), value, expected: "above zero" });
    }
    Ok(ALL[..N_READ]
        .iter()
        .filter(|&&column| column != Column::Time || options.rate_hz.is_none())
        .map(|&column| {
            let mapped = options.columns.get(column.key());
            Wanted {
                column,
                name: mapped.map_or_else(|| column.file_name().to_owned(), |name| name.trim().to_owned()),
                mapped: mapped.is_some(),
            }
        })
        .collect())
}

/// Those of a file's `names` that are none of the `wanted` columns.
pub(crate) fn others<'n>(names: impl IntoIterator<Item = &'n String>, wanted: &[Wanted]) -> Vec<String> {
    let is_other = |name: &&String| !name.is_empty() && wanted.iter().all(|want| want.name != **name);
    names.into_iter().filter(is_other).cloned().collect()
}

/// Whether a rate can be used: positive, and neither it nor the interval overflows.
pub(crate) fn is_rate(rate_hz: f64) -> bool {
    rate_hz.is_normal() && rate_hz > 0.0 && rate_hz.recip().is_normal()
}

fn check_keys<T>(option: &'static str, map: &BTreeMap<String, T>) -> Result<(), LogError> {
    let keys = || ALL[..N_READ].iter().map(|column| column.key());
    match map.keys().find(|&key| keys().all(|known| known != key)) {
        None => Ok(()),
        Some(key) => {
            Err(LogError::UnknownKey { option, key: key.clone(), known: keys().collect::<Vec<_>>().join(", ") })
        }
    }
}
