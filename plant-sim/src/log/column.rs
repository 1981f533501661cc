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

/// Units of each quantity by name, with their decimal exponent of SI. Micro is written `u` here.
type Units = &'static [(&'static str, i32)];
const SECONDS: Units = &[
    ("s", 0),
    ("ks", 3),
    ("ms", -3),
    ("us", -6),
    ("ns", -9),
    ("ps", -12),
    ("sec", 0),
    ("msec", -3),
    ("usec", -6),
    ("nsec", -9),
];
const VOLTS: Units = &[("V", 0), ("kV", 3), ("mV", -3), ("uV", -6), ("nV", -9), ("pV", -12)];
const METRES: Units = &[("m", 0), ("km", 3), ("mm", -3), ("um", -6), ("nm", -9), ("pm", -12)];
const NEWTONS: Units = &[("N", 0), ("kN", 3), ("mN", -3), ("uN", -6), ("nN", -9), ("pN", -12)];
const AMPERES: Units = &[("A", 0), ("kA", 3), ("mA", -3), ("uA", -6), ("nA", -9), ("pA", -12)];
const QUANTITIES: [Units; 5] = [SECONDS, VOLTS, METRES, NEWTONS, AMPERES];

/// What is no unit of any quantity here: to take it for the contract's unit would be wrong by a factor.
const NO_UNITS: [&str; 6] = ["lsb", "count", "counts", "pct", "percent", "%"];

/// What a text is to a quantity.
enum Reading {
    /// A unit of it, as a decimal exponent of SI.
    Unit(i32),
    /// A unit that is none of it, or one that might be either of two.
    Other,
    /// No unit that is known.
    NoUnit,
}

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

    /// What `unit` is to this quantity.
    ///
    /// Case counts, since `mV` and `MV` differ: what is a unit only where case is ignored is one of no known size, but
    /// where it is the contract's own (`Y_UM`), which is meant without a unit as well.
    fn reading(self, unit: &str) -> Reading {
        let (own, unscaled): (Units, &[&str]) = match self {
            Self::Time => (SECONDS, &["min", "h", "hr", "sample", "samples", "tick", "ticks"]),
            Self::Command | Self::Drive => (VOLTS, &[]),
            Self::Displacement | Self::Reference | Self::Predicted => {
                (METRES, &["cm", "dm", "inch", "inches", "mil", "ft"])
            }
            Self::Force => (NEWTONS, &["gf", "kgf", "lbf"]),
            Self::Current => (AMPERES, &[]),
            Self::Temperature | Self::LimitedBy | Self::Seq => return Reading::NoUnit,
        };
        // Two code points are in use for micro: the micro sign and the Greek letter.
        let unit = unit.replace(['\u{b5}', '\u{3bc}'], "u");
        if let Some((_, exponent)) = own.iter().find(|(name, _)| *name == unit) {
            return Reading::Unit(*exponent);
        }
        // A sensor's volts are no displacement yet. Of the smallest units no log is, and `_ps` is a power supply.
        let of_others = QUANTITIES.into_iter().filter(|units| *units != own).flatten();
        let mut others = of_others.filter(|(_, exponent)| *exponent > -12);
        let lower = unit.to_lowercase();
        let is_lower = |name: &str| name.to_lowercase() == lower;
        if NO_UNITS.contains(&lower.as_str())
            || unscaled.iter().any(|name| is_lower(name))
            || others.clone().any(|(name, _)| *name == unit)
        {
            return Reading::Other;
        }
        if let Some((_, exponent)) = own.iter().find(|(name, _)| is_lower(name)) {
            return if *exponent == self.file_exponent() { Reading::NoUnit } else { Reading::Other };
        }
        // Headers in capitals. One letter is more likely an index than a unit, and so are two in small letters.
        let is_capitals = unit.len() > 1 && unit.chars().all(char::is_uppercase);
        if is_capitals && others.any(|(name, _)| is_lower(name)) { Reading::Other } else { Reading::NoUnit }
    }
}

/// The unit that a column's name ends in, if anything: of `y_nm`, `y [nm]` and `y (nm)` it is `nm`.
fn ending(name: &str) -> Option<&str> {
    let (_, unit) = name.trim().trim_end_matches([']', ')']).rsplit_once(['_', '[', '('])?;
    Some(unit.trim())
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
    /// The scale of a column called `name` in the file, which may state a unit beside the name: as `--scale` says, else
    /// as the name ends, else as it is stated; the contract's unit where none of these does.
    ///
    /// # Errors
    /// [`LogError::OtherUnit`].
    pub(crate) fn of(
        column: Column,
        name: &str,
        stated: Option<&str>,
        options: &ReadOptions,
    ) -> Result<Self, LogError> {
        if let Some(&factor) = options.scale.get(column.key()) {
            return Ok(Self::from_factor(factor));
        }
        for unit in ending(name).into_iter().chain(stated) {
            match column.reading(unit) {
                Reading::Unit(exponent) => return Ok(Self::Power(exponent)),
                Reading::Other => {
                    let (name, unit) = (name.to_owned(), unit.to_owned());
                    return Err(LogError::OtherUnit { name, unit, key: column.key() });
                }
                Reading::NoUnit => {}
            }
        }
        Ok(Self::Power(column.file_exponent()))
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
    // A column that the user has named for something else is not also what its name says, such as an amplifier's
    // monitor that is taken for the command.
    let is_taken = |column: Column| {
        let is_optional = !matches!(column, Column::Time | Column::Command | Column::Displacement);
        let is_mapped = options.columns.contains_key(column.key());
        is_optional && !is_mapped && options.columns.values().any(|name| name.trim() == column.file_name())
    };
    Ok(ALL[..N_READ]
        .iter()
        .filter(|&&column| column != Column::Time || options.rate_hz.is_none())
        .filter(|&&column| !is_taken(column))
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
