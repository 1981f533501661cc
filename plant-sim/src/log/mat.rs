//! MAT v5 logs: one variable per column, or dSPACE ControlDesk's capture structure. Loaded as a whole, since a row is
//! spread over the file.
//!
//! ControlDesk saves one structure with `X` (time axes: `X(k).Data`) and `Y` (signals: `Y(i).Name`, `.Data`,
//! `.XIndex`, often `.Path` and `.Unit`), the sampling period in `Capture.SamplingPeriod`, and in `Capture.Downsampling`
//! of how many samples one was kept.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::ReadOptions;
use super::column::{Column, N_READ, Scale, Wanted, others};
use super::csv_file::excerpt_list;
use super::error::{LogError, Place, excerpt};
use super::grid::TimePrint;
use super::mat5::{self, Fault, Value};
use super::meta::Meta;
use super::source::{Opened, RawRow, Source};

/// A file is loaded as a whole; the format itself holds less than this per variable.
const MAX_FILE_BYTES: u64 = 1 << 32;

/// Opens a MAT log.
///
/// A name is looked for as a variable, as a dotted path into structures (`log.u`), and among the signals of a
/// ControlDesk capture: by full name, else by its last component after `/`.
pub(crate) fn open<R: Read>(
    path: &Path,
    reader: R,
    options: &ReadOptions,
    wanted: &[Wanted],
) -> Result<Opened, LogError> {
    let mut bytes = Vec::new();
    reader.take(MAX_FILE_BYTES).read_to_end(&mut bytes).map_err(|error| LogError::from_read(path, error))?;
    let variables = mat5::parse(&bytes).map_err(|fault| match fault {
        Fault::Version73 => LogError::Mat73 { path: path.to_path_buf() },
        Fault::Broken(what, offset) => LogError::MatBroken { path: path.to_path_buf(), what, offset },
    })?;
    drop(bytes);
    let capture = Capture::find(&variables);
    let meta = meta_of(path, &variables)?;

    let mut fields: Vec<Field> = Vec::new();
    let mut has = [false; N_READ];
    let mut raster: Option<(usize, String)> = None;
    // What the user has named: a signal is not also what the last component of its name says.
    let mut taken: Vec<&Value> = Vec::new();
    for want in wanted {
        let mut found: Option<&Value> = dotted(&variables, &want.name);
        let mut unit = None;
        if let Some(capture) = capture.as_ref().filter(|_| found.is_none()) {
            let mut hits = capture.signals(&want.name);
            if hits.len() > 1 {
                return Err(LogError::AmbiguousColumn {
                    path: path.to_path_buf(),
                    wanted: want.column.key(),
                    name: want.name.clone(),
                    n: hits.len(),
                });
            }
            let is_free = |signal: &Signal<'_>| {
                want.is_required() || taken.iter().all(|value| !std::ptr::eq(*value, signal.data))
            };
            if let Some(signal) = hits.pop().filter(is_free) {
                let (raster, other) = raster.get_or_insert((signal.raster, want.name.clone()));
                if *raster != signal.raster {
                    return Err(LogError::MatRasters {
                        path: path.to_path_buf(),
                        column: excerpt(&want.name),
                        other: excerpt(other),
                    });
                }
                found = Some(signal.data);
                unit = signal.unit;
            }
        }
        taken.extend(found.filter(|_| want.mapped));
        match found {
            Some(value) => fields.push(Field::new(path, want, value, unit, options)?),
            None if want.is_required() => {
                return Err(LogError::MissingColumn {
                    path: path.to_path_buf(),
                    wanted: want.column.key(),
                    name: want.name.clone(),
                    exists: existing(&variables, capture.as_ref()),
                });
            }
            None => continue,
        }
        has[want.column.idx()] = true;
    }

    // The time axis of a capture has no name of its own. It is in seconds.
    let mut rate_hz = None;
    let wants_time = wanted.iter().find(|want| want.column == Column::Time);
    if let Some(want) = wants_time.filter(|_| !has[Column::Time.idx()]) {
        let raster = raster.as_ref().map_or(0, |(raster, _)| *raster);
        let axis = capture.as_ref().and_then(|capture| capture.axis(raster));
        if let Some(axis) = axis {
            let want = Wanted { name: "X.Data_s".to_owned(), ..want.clone() };
            fields.push(Field::new(path, &want, axis, None, options)?);
            has[Column::Time.idx()] = true;
        } else {
            rate_hz = capture.as_ref().and_then(Capture::rate_hz);
            if rate_hz.is_none() && meta.rate_hz.is_none() {
                return Err(LogError::MissingColumn {
                    path: path.to_path_buf(),
                    wanted: want.column.key(),
                    name: want.name.clone(),
                    exists: existing(&variables, capture.as_ref()),
                });
            }
        }
    }
    if let Some((first, rest)) = fields.split_first()
        && let Some(other) = rest.iter().find(|field| field.numbers.len() != first.numbers.len())
    {
        return Err(LogError::Lengths {
            path: path.to_path_buf(),
            column: excerpt(&first.name),
            n: first.numbers.len(),
            other: excerpt(&other.name),
            n_other: other.numbers.len(),
        });
    }
    // Variables and signals as long as a log; a signal is read by the last component of its name as well.
    let n_rows = fields.first().map_or(0, |field| field.numbers.len());
    let is_as_long = |value: &Value| matches!(value, Value::Real { numbers, .. } if numbers.len() == n_rows);
    let is_read = |signal: &&Signal<'_>| fields.iter().any(|field| signal.full.rsplit('/').next() == Some(&field.name));
    let signals = capture.iter().flat_map(|capture| &capture.signals).filter(|signal| !is_read(signal));
    let all =
        variables.iter().map(|(name, value)| (name, value)).chain(signals.map(|signal| (&signal.full, signal.data)));
    let others = others(all.filter(|(_, value)| is_as_long(value)).map(|(name, _)| name), wanted);
    Ok(Opened { meta, rate_hz, has, others, rows: Box::new(MatRows { path: path.to_path_buf(), fields, n_read: 0 }) })
}

/// A column, loaded.
struct Field {
    column: Column,
    name: String,
    numbers: Vec<f64>,
    scale: Scale,
    epsilon: f64,
}

impl Field {
    /// `unit` is what the file states beside the name.
    fn new(
        path: &Path,
        want: &Wanted,
        value: &Value,
        unit: Option<&str>,
        options: &ReadOptions,
    ) -> Result<Self, LogError> {
        let found = match value {
            Value::Real { dims, numbers, single } => {
                if dims.iter().filter(|&&length| length != 1).count() <= 1 {
                    return Ok(Self {
                        column: want.column,
                        name: want.name.clone(),
                        numbers: numbers.clone(),
                        scale: Scale::of(want.column, &want.name, unit, options)?,
                        epsilon: if *single { f64::from(f32::EPSILON) } else { f64::EPSILON },
                    });
                }
                let lengths: Vec<String> = dims.iter().map(usize::to_string).collect();
                format!("an array of {}", lengths.join(" x "))
            }
            Value::Text(_) => "text".to_owned(),
            Value::Struct { .. } => "a structure".to_owned(),
            Value::Other(what) => (*what).to_owned(),
        };
        Err(LogError::MatNotVector { path: path.to_path_buf(), column: excerpt(&want.name), found })
    }
}

struct MatRows {
    path: PathBuf,
    fields: Vec<Field>,
    n_read: usize,
}

impl Source for MatRows {
    fn next_row(&mut self) -> Result<Option<RawRow>, LogError> {
        let mut row = RawRow {
            place: Place::Sample(self.n_read as u64),
            values: [0.0; N_READ],
            print: TimePrint::Binary { epsilon: f64::EPSILON },
        };
        for field in &self.fields {
            let Some(&number) = field.numbers.get(self.n_read) else {
                return Ok(None);
            };
            let value = field.scale.apply(number);
            if !value.is_finite() {
                return Err(LogError::NotFinite {
                    path: self.path.clone(),
                    place: row.place,
                    column: excerpt(&field.name),
                    value: number.to_string(),
                });
            }
            if field.column == Column::Time {
                row.print = TimePrint::Binary { epsilon: field.epsilon };
            }
            row.values[field.column.idx()] = value;
        }
        self.n_read += 1;
        Ok(Some(row))
    }
}

/// A variable by its name, or by a path into structures.
fn dotted<'a>(variables: &'a [(String, Value)], name: &str) -> Option<&'a Value> {
    let top = |name: &str| variables.iter().find(|(n, _)| n == name).map(|(_, value)| value);
    top(name).or_else(|| {
        let mut parts = name.split('.');
        let first = top(parts.next()?)?;
        parts.try_fold(first, |value, part| value.field(part))
    })
}

/// Metadata kept as variables under the contract's keys; other texts are kept too.
fn meta_of(path: &Path, variables: &[(String, Value)]) -> Result<Meta, LogError> {
    const KEYS: [&str; 10] = [
        "rate_hz",
        "hold",
        "latency_us",
        "adc_lsb_um",
        "dac_lsb_V",
        "period_samples",
        "run_in_s",
        "controller",
        "firmware",
        "seed",
    ];
    let mut meta = Meta::default();
    for (name, value) in variables {
        if let Some(text) = value.text() {
            meta.set(path, None, name, text.trim())?;
        } else if let Some(number) = value.number().filter(|_| KEYS.contains(&name.as_str())) {
            meta.set(path, None, name, &number.to_string())?;
        }
    }
    Ok(meta)
}

/// What there is, for a message.
fn existing(variables: &[(String, Value)], capture: Option<&Capture<'_>>) -> String {
    match capture {
        Some(capture) => excerpt_list(&capture.signals.iter().map(|s| s.full.as_str()).collect::<Vec<_>>()),
        None => excerpt_list(&variables.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>()),
    }
}

/// dSPACE ControlDesk's capture.
struct Capture<'a> {
    whole: &'a Value,
    signals: Vec<Signal<'a>>,
}

#[derive(Clone)]
struct Signal<'a> {
    /// With its path, without quotes.
    full: String,
    /// `Name` as it is, without quotes.
    name: String,
    data: &'a Value,
    /// `Unit`: empty or `-` where nobody has set it.
    unit: Option<&'a str>,
    /// Which time axis, from 0.
    raster: usize,
}

impl<'a> Capture<'a> {
    fn find(variables: &'a [(String, Value)]) -> Option<Self> {
        variables.iter().find_map(|(_, whole)| {
            whole.field("X")?;
            let y = whole.field("Y")?;
            let Value::Struct { elements, .. } = y else {
                return None;
            };
            let signals = (0..elements.len()).filter_map(|idx| {
                let name = unquoted(y.field_of(idx, "Name")?.text()?);
                let path = y.field_of(idx, "Path").and_then(Value::text).map(unquoted);
                let raster = y.field_of(idx, "XIndex").and_then(Value::number);
                Some(Signal {
                    full: match path.filter(|path| !path.is_empty() && !name.contains('/')) {
                        Some(path) => format!("{path}/{name}"),
                        None => name.clone(),
                    },
                    name,
                    data: y.field_of(idx, "Data")?,
                    unit: y.field_of(idx, "Unit").and_then(Value::text).map(str::trim),
                    // MATLAB counts from 1; a nonsensical index saturates and finds no axis.
                    raster: raster.map_or(0, |raster| (raster as usize).saturating_sub(1)),
                })
            });
            Some(Self { whole, signals: signals.collect() })
        })
    }

    /// The signals that answer to a name: by the whole of it, else by the last component.
    fn signals(&self, name: &str) -> Vec<Signal<'a>> {
        let name = unquoted(name);
        let by = |fits: &dyn Fn(&Signal<'_>) -> bool| -> Vec<Signal<'a>> {
            self.signals.iter().filter(|&signal| fits(signal)).cloned().collect()
        };
        let whole = by(&|signal| signal.full == name || signal.name == name);
        if whole.is_empty() { by(&|signal| signal.full.rsplit('/').next() == Some(name.as_str())) } else { whole }
    }

    /// A time axis, unless it was saved empty.
    fn axis(&self, raster: usize) -> Option<&'a Value> {
        let axis = self.whole.field("X")?.field_of(raster, "Data")?;
        match axis {
            Value::Real { numbers, .. } if numbers.is_empty() => None,
            _ => Some(axis),
        }
    }

    fn rate_hz(&self) -> Option<f64> {
        let capture = self.whole.field("Capture")?;
        let period_s = capture.field("SamplingPeriod")?.number()?;
        let downsampling = capture.field("Downsampling").and_then(Value::number).unwrap_or(1.0);
        let rate_hz = (period_s * downsampling).recip();
        (downsampling >= 1.0 && super::column::is_rate(rate_hz)).then_some(rate_hz)
    }
}

/// ControlDesk quotes the parts of a path when they hold blanks.
fn unquoted(name: &str) -> String {
    name.chars().filter(|&c| c != '"').collect::<String>().trim().to_owned()
}
