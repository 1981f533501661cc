//! SPEC: what to drive with, as text. One grammar for references (um) and open-loop commands (V).
//!
//! ```text
//! SPEC    = PART ("+" PART)*
//! PART    = KIND [":" AMPLITUDE ("um" | "V")] ["/" COUNT] ["@" WHEN] ("," OPTION)*
//! WHEN    = FREQ "Hz" | FREQ "-" FREQ "Hz" ["/" TIME "s"] | TIME "s"
//! OPTION  = "shaped" | "odd" | "log" | NAME "=" VALUE
//! ```
//!
//! | kind | example | meaning |
//! | --- | --- | --- |
//! | zero, hold, step | `zero@5s`, `hold:40V@5s`, `step:80um` | constant; a step is a hold whose metrics are a step's |
//! | square, sine, triangle | `sine:120um@100Hz` | periodic between plus and minus the amplitude |
//! | sweep | `sweep:20V@1-2000Hz/4s` | sine, its frequency linear in time (`log`: exponential) |
//! | decaying-sine | `decaying-sine:60V@8Hz/2s` | sine whose amplitude falls in a straight line to zero: demagnetises a loop |
//! | ladder | `ladder:60V/8,hold=2s` | up in 8 equal levels and down again, each held |
//! | multisine | `multisine:20V@1-2000Hz,odd,periods=4,realisations=6,seed=7` | random phases; the amplitude is the peak |
//! | minor-loops | `minor-loops:60V@1Hz` | sines of falling amplitude, each nested in the last: full, 3/4, 1/2, 1/4 |
//! | file | `file:ref.csv` | one number per sample, in the amplitude's unit: um unless `unit=V` |
//!
//! `for=2s` is the length of a part that states none behind `@` or `/`; a sweep's stands behind `/`, and a ladder's follows from its levels. Of minor
//! loops the last goes on until the end. Every part but the last needs a length.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Unit of the amplitudes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// A reference, micrometres in text and metres inside.
    Micrometre,
    /// A command.
    Volt,
}

/// A parsed SPEC.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// Unit of every amplitude; `None` if only zeros are asked for.
    pub unit: Option<Unit>,
    /// The parts in sequence.
    pub parts: Vec<Part>,
}

/// One part of the sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Waveform.
    pub shape: Shape,
    /// Amplitude in SI (metres or volts).
    pub amplitude: f64,
    /// Length in seconds, where the part has one.
    pub seconds: Option<f64>,
    /// Whether rate and acceleration are to be bounded.
    pub shaped: bool,
}

impl Part {
    /// This part as boards generate it: minor loops are sines one after the other, the last of which goes on.
    pub fn generated(&self) -> Vec<Part> {
        let Shape::MinorLoops { hz } = self.shape else { return vec![self.clone()] };
        let mut left_s = self.seconds.unwrap_or(f64::INFINITY);
        let mut sines = Vec::new();
        for (index, scale) in MINOR_LOOP_SCALES.into_iter().enumerate() {
            let is_last = index + 1 == MINOR_LOOP_SCALES.len();
            let seconds = if is_last { left_s } else { left_s.min(2.0 / hz) };
            if seconds > 0.0 {
                let amplitude = scale * self.amplitude;
                let seconds = Some(seconds).filter(|seconds| seconds.is_finite());
                sines.push(Part { shape: Shape::Sine { hz }, amplitude, seconds, ..self.clone() });
            }
            left_s -= seconds;
        }
        sines
    }
}

/// Waveforms, for an amplitude of one.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Zero.
    Zero,
    /// Constant.
    Hold,
    /// Constant from the first sample, evaluated as a step.
    Step,
    /// +1 for the first half of each period, then -1.
    Square {
        /// Frequency in hertz.
        hz: f64,
    },
    /// Sine from phase zero.
    Sine {
        /// Frequency in hertz.
        hz: f64,
    },
    /// Sine from phase zero whose amplitude has fallen to zero at the part's end.
    DecayingSine {
        /// Frequency in hertz.
        hz: f64,
    },
    /// Triangle from zero upwards.
    Triangle {
        /// Frequency in hertz.
        hz: f64,
    },
    /// Sine of changing frequency.
    Sweep {
        /// Frequency at the start and at the end in hertz.
        hz: [f64; 2],
        /// Exponential in time rather than linear.
        log: bool,
    },
    /// Staircase up and down.
    Ladder {
        /// Levels from zero (excluded) to the amplitude.
        levels: u32,
        /// Time on each level in seconds.
        hold_s: f64,
    },
    /// Periodic sum of sines with random phases.
    Multisine {
        /// Lowest line, which is the spacing of the lines, and highest line, in hertz.
        hz: [f64; 2],
        /// Odd multiples of the lowest line only.
        odd: bool,
        /// Periods of each realisation.
        periods: u32,
        /// Different sets of phases.
        realisations: u32,
        /// Seed of the phases.
        seed: u64,
    },
    /// Nested loops.
    MinorLoops {
        /// Frequency in hertz.
        hz: f64,
    },
    /// Samples from a file.
    File {
        /// Text file with one number per line.
        path: PathBuf,
    },
}

impl Shape {
    /// The kind as a SPEC spells it.
    pub fn kind(&self) -> &'static str {
        match self {
            Shape::Zero => "zero",
            Shape::Hold => "hold",
            Shape::Step => "step",
            Shape::Square { .. } => "square",
            Shape::Sine { .. } => "sine",
            Shape::DecayingSine { .. } => "decaying-sine",
            Shape::Triangle { .. } => "triangle",
            Shape::Sweep { .. } => "sweep",
            Shape::Ladder { .. } => "ladder",
            Shape::Multisine { .. } => "multisine",
            Shape::MinorLoops { .. } => "minor-loops",
            Shape::File { .. } => "file",
        }
    }
}

/// Why a SPEC can't be used; the message names the part.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("SPEC part {part:?}: {reason}")]
pub struct SpecError {
    /// The part as written.
    pub part: String,
    /// What is wrong and what would do.
    pub reason: String,
    /// Whether the file that the part names is at fault, and not the SPEC.
    pub in_file: bool,
}

impl Spec {
    /// Parses `text`.
    ///
    /// # Errors
    /// The part that can't be understood and why.
    pub fn parse(text: &str) -> Result<Self, SpecError> {
        let mut unit = None;
        let mut parts = Vec::new();
        let texts: Vec<&str> = text.split('+').collect();
        for (index, part_text) in texts.iter().enumerate() {
            let fail = |reason: String| SpecError { part: (*part_text).to_owned(), reason, in_file: false };
            let (part, part_unit) = parse_part(part_text).map_err(fail)?;
            if let (Some(a), Some(b)) = (unit, part_unit)
                && a != b
            {
                return Err(fail("mixes um and V in one sequence".into()));
            }
            unit = unit.or(part_unit);
            if part.seconds.is_none() && index + 1 < texts.len() {
                return Err(fail("needs a length because another part follows: add `,for=2s`".into()));
            }
            parts.push(part);
        }
        Ok(Self { unit, parts })
    }

    /// Whether any part asks for shaping.
    pub fn shaped(&self) -> bool {
        self.parts.iter().any(|p| p.shaped)
    }
}

impl std::str::FromStr for Spec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        Self::parse(text)
    }
}

const KINDS: &str =
    "zero, step, square, sine, decaying-sine, triangle, sweep, ladder, hold, multisine, minor-loops, file:PATH";

fn parse_part(text: &str) -> Result<(Part, Option<Unit>), String> {
    let (kind, rest) = match text.find([':', '@', ',', '/']) {
        Some(at) => (text[..at].trim(), &text[at..]),
        None => (text.trim(), ""),
    };
    if kind == "file" {
        return parse_file(rest);
    }
    let mut fields = rest.split(',');
    let head = fields.next().unwrap_or("");
    let mut options = Options::parse(fields)?;
    let (head, when) = head.split_once('@').map_or((head, None), |(h, w)| (h, Some(w.trim())));
    let (head, count) = head.split_once('/').map_or((head, None), |(h, c)| (h, Some(c.trim())));
    let (amplitude, unit) = match head.strip_prefix(':') {
        Some(text) => parse_amplitude(text.trim()).map(|(a, u)| (Some(a), Some(u)))?,
        None => (None, None),
    };
    let when = when.map(When::parse).transpose()?;
    let tone = |what: &str| match when {
        Some(When::Tone { hz, .. }) => Ok(hz),
        _ => Err(format!("a {what} needs a frequency, as in `{what}:20um@10Hz`")),
    };
    if matches!(kind, "zero" | "hold" | "step" | "ladder") && !matches!(when, None | Some(When::Time { .. })) {
        return Err(format!("a {kind} has no frequency"));
    }
    let band = |example: &str| match when {
        Some(When::Band { hz, .. }) => Ok(hz),
        _ => Err(format!("needs a band of frequencies, as in `{example}`")),
    };
    let mut seconds = match when {
        Some(
            When::Time { seconds }
            | When::Band { seconds: Some(seconds), .. }
            | When::Tone { seconds: Some(seconds), .. },
        ) => Some(seconds),
        _ => None,
    };
    let stated_s = seconds;
    let shape = match kind {
        "zero" => Shape::Zero,
        "hold" => Shape::Hold,
        "step" => Shape::Step,
        "square" => Shape::Square { hz: tone(kind)? },
        "sine" => Shape::Sine { hz: tone(kind)? },
        "triangle" => Shape::Triangle { hz: tone(kind)? },
        "decaying-sine" => {
            let hz = tone(kind)?;
            if seconds.is_none() && !options.has("for") {
                return Err("a decaying-sine needs its duration, as in `decaying-sine:60V@8Hz/2s`".into());
            }
            Shape::DecayingSine { hz }
        }
        "minor-loops" => {
            let hz = tone(kind)?;
            seconds = seconds.or(Some(2.0 * MINOR_LOOP_SCALES.len() as f64 / hz));
            Shape::MinorLoops { hz }
        }
        "sweep" => {
            let hz = band("sweep:20V@1-2000Hz/4s")?;
            if seconds.is_none() {
                return Err("a sweep needs its duration, as in `sweep:20V@1-2000Hz/4s`".into());
            }
            Shape::Sweep { hz, log: options.flag("log")? }
        }
        "ladder" => {
            let levels = count.and_then(|c| c.parse().ok()).filter(|&c: &u32| (1..=1000).contains(&c));
            let levels = levels.ok_or("a ladder needs its number of levels, as in `ladder:60V/8,hold=2s`")?;
            let hold_s = options.seconds("hold")?.ok_or("a ladder needs the time on each level, as in `hold=2s`")?;
            if seconds.is_some() || options.has("for") {
                return Err("a ladder is as long as its levels: change `hold`, and leave the length out".into());
            }
            seconds = Some(2.0 * f64::from(levels) * hold_s);
            Shape::Ladder { levels, hold_s }
        }
        "multisine" => {
            let hz = band("multisine:20V@1-2000Hz")?;
            let (periods, realisations) =
                (options.whole("periods")?.unwrap_or(2), options.whole("realisations")?.unwrap_or(1));
            if periods == 0 || realisations == 0 || periods.saturating_mul(realisations) > 100_000 {
                return Err("periods and realisations must be between 1 and 100000 together".into());
            }
            seconds = seconds.or(Some((periods * realisations) as f64 / hz[0]));
            Shape::Multisine {
                hz,
                odd: options.flag("odd")?,
                periods: periods as u32,
                realisations: realisations as u32,
                seed: options.whole("seed")?.unwrap_or(1),
            }
        }
        _ => return Err(format!("unknown kind {kind:?}; known: {KINDS}")),
    };
    if count.is_some() && !matches!(shape, Shape::Ladder { .. }) {
        return Err("only a ladder has a count after `/`".into());
    }
    if stated_s.is_some() && options.has("for") {
        let sign = if matches!(when, Some(When::Time { .. })) { '@' } else { '/' };
        return Err(format!("a {kind} takes the time behind `{sign}`: change that, and leave `for` out"));
    }
    let seconds = options.seconds("for")?.or(seconds);
    let shaped = options.flag("shaped")?;
    options.finish()?;
    let amplitude = match (amplitude, &shape) {
        (None, Shape::Zero) => 0.0,
        (Some(_), Shape::Zero) => return Err("a zero has no amplitude".into()),
        (Some(amplitude), _) => amplitude,
        (None, _) => return Err(format!("a {kind} needs an amplitude, as in `{kind}:20um`")),
    };
    Ok((Part { shape, amplitude, seconds, shaped }, unit))
}

fn parse_file(rest: &str) -> Result<(Part, Option<Unit>), String> {
    let mut fields = rest.strip_prefix(':').unwrap_or("").split(',');
    let path = fields.next().unwrap_or("");
    if path.is_empty() {
        return Err("needs a path, as in `file:reference.csv`".into());
    }
    let mut options = Options::parse(fields)?;
    let unit = match options.text("unit")?.as_deref() {
        None | Some("um") => Unit::Micrometre,
        Some("V") => Unit::Volt,
        Some(other) => return Err(format!("unit={other} is neither um nor V")),
    };
    let part = Part {
        shape: Shape::File { path: PathBuf::from(path) },
        amplitude: if unit == Unit::Micrometre { 1e-6 } else { 1.0 },
        seconds: options.seconds("for")?,
        shaped: options.flag("shaped")?,
    };
    options.finish()?;
    Ok((part, Some(unit)))
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
        let is_scaled = text.trim_end_matches(['m', 'k', 'u', 'n', 'M']).parse::<f64>().is_ok();
        let units = if is_scaled { ": the units are V, um, Hz, s and ms" } else { "" };
        format!("{text:?} is not a number{units}")
    })
}

fn positive(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v > 0.0 { Ok(v) } else { Err(format!("{text:?} must be greater than zero")) })
}

fn parse_amplitude(text: &str) -> Result<(f64, Unit), String> {
    if let Some(value) = text.strip_suffix("um") {
        Ok((number(value)? / 1e6, Unit::Micrometre))
    } else if let Some(value) = text.strip_suffix('V') {
        Ok((number(value)?, Unit::Volt))
    } else {
        Err(format!("amplitude {text:?} needs its unit, um or V"))
    }
}

fn parse_time(text: &str) -> Result<f64, String> {
    match (text.strip_suffix("ms"), text.strip_suffix('s')) {
        (Some(ms), _) => positive(ms).map(|v| v * 1e-3),
        (None, Some(s)) => positive(s),
        (None, None) => Err(format!("time {text:?} needs its unit, s or ms")),
    }
}

#[derive(Clone, Copy)]
enum When {
    Tone { hz: f64, seconds: Option<f64> },
    Band { hz: [f64; 2], seconds: Option<f64> },
    Time { seconds: f64 },
}

impl When {
    fn parse(text: &str) -> Result<Self, String> {
        let (frequency, time) = text.split_once('/').map_or((text, None), |(f, t)| (f, Some(t)));
        let Some(frequency) = frequency.trim().strip_suffix("Hz") else {
            if number(frequency).is_ok() {
                return Err(format!("{frequency:?} needs its unit: Hz of a frequency, s or ms of a time"));
            }
            return parse_time(text).map(|seconds| Self::Time { seconds });
        };
        let seconds = time.map(parse_time).transpose()?;
        // The dash of a band stands behind a number, and not behind the e of one.
        let dash = frequency.match_indices('-').map(|(at, _)| at);
        let dash = dash.into_iter().find(|&at| at > 0 && !frequency[..at].ends_with(['e', 'E']));
        match dash.map(|at| (&frequency[..at], &frequency[at + 1..])) {
            Some((from, to)) => {
                let hz = [positive(from)?, positive(to)?];
                if hz[1] <= hz[0] {
                    return Err(format!("band {frequency}Hz must go upwards"));
                }
                Ok(Self::Band { hz, seconds })
            }
            None => Ok(Self::Tone { hz: positive(frequency)?, seconds }),
        }
    }
}

/// Options as written; what nobody asked for is an error.
struct Options(Vec<(String, Option<String>)>);

impl Options {
    fn parse<'a>(fields: impl Iterator<Item = &'a str>) -> Result<Self, String> {
        fields
            .map(|field| {
                let field = field.trim();
                if field.is_empty() {
                    return Err("has an empty option".to_owned());
                }
                Ok(field
                    .split_once('=')
                    .map_or((field.to_owned(), None), |(name, value)| (name.to_owned(), Some(value.to_owned()))))
            })
            .collect::<Result<_, _>>()
            .map(Self)
    }

    fn take(&mut self, name: &str) -> Option<Option<String>> {
        let at = self.0.iter().position(|(n, _)| n == name)?;
        Some(self.0.remove(at).1)
    }

    fn has(&self, name: &str) -> bool {
        self.0.iter().any(|(n, _)| n == name)
    }

    fn flag(&mut self, name: &str) -> Result<bool, String> {
        match self.take(name) {
            Some(Some(value)) => Err(format!("`{name}` takes no value, and {value:?} is given")),
            taken => Ok(taken.is_some()),
        }
    }

    fn text(&mut self, name: &str) -> Result<Option<String>, String> {
        match self.take(name) {
            Some(None) => Err(format!("`{name}` needs a value, as in `{name}=...`")),
            taken => Ok(taken.flatten()),
        }
    }

    fn seconds(&mut self, name: &str) -> Result<Option<f64>, String> {
        self.text(name)?.map(|t| parse_time(&t)).transpose()
    }

    fn whole(&mut self, name: &str) -> Result<Option<u64>, String> {
        self.text(name)?.map(|t| t.parse().map_err(|_| format!("{name}={t} is not a whole number"))).transpose()
    }

    fn finish(self) -> Result<(), String> {
        match self.0.first() {
            None => Ok(()),
            Some((name, _)) => Err(format!("unknown option {name:?}, or given twice")),
        }
    }
}

/// Amplitudes of the nested loops, two periods each.
const MINOR_LOOP_SCALES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];

/// Most samples in the tables of one part: 80 MB.
const MOST_TABLE_SAMPLES: f64 = 2e7;
/// Most products of samples and lines in a multisine: some seconds of work.
const MOST_LINE_SAMPLES: f64 = 2e9;
/// Longest file of samples in bytes: as many as a table holds, each with the 20 characters that a number written in full has with its line's end.
const MOST_FILE_BYTES: u64 = 20 * MOST_TABLE_SAMPLES as u64;
/// Samples after which a line's phasor is set anew, so that its rounding stays below 64 units in the last place.
const PHASOR_RUN: usize = 64;

/// How many samples the tables of a waveform have in all, without making them: [`table`] may take seconds.
///
/// `None` for the kinds that boards generate, and for a file, whose length only reading it tells.
pub fn table_samples(shape: &Shape, rate_hz: f64) -> Option<usize> {
    match shape {
        Shape::Multisine { hz, realisations, .. } => {
            Some(((rate_hz / hz[0]).round() * f64::from(*realisations)) as usize)
        }
        _ => None,
    }
}

/// Samples of a waveform that boards play from a table, for an amplitude of one; `None` for the kinds they generate.
///
/// A multisine's table holds one period of every realisation, a file's its numbers.
///
/// # Errors
/// A file that can't be read, a multisine whose period isn't a whole number of samples, and frequencies that the rate can't show.
pub fn table(shape: &Shape, rate_hz: f64) -> Result<Option<Vec<Vec<f32>>>, String> {
    let half_hz = rate_hz / 2.0;
    match shape {
        // At half the rate they would be sampled where they are zero.
        Shape::Sine { hz } | Shape::DecayingSine { hz } | Shape::Triangle { hz } if *hz >= half_hz => {
            Err(format!("its {hz} Hz must lie below half the rate, {half_hz} Hz"))
        }
        Shape::Square { hz } | Shape::Sweep { hz: [_, hz], .. } if *hz > half_hz => {
            Err(format!("its {hz} Hz must not be above half the rate, {half_hz} Hz"))
        }
        Shape::Multisine { hz, odd, realisations, seed, .. } => {
            let period = rate_hz / hz[0];
            if (period - period.round()).abs() > 1e-6 * period || period > 1e7 {
                return Err(format!(
                    "the lowest line {} Hz must divide the rate {rate_hz} Hz; the nearest that does is {} Hz",
                    hz[0],
                    rate_hz / period.round().max(1.0)
                ));
            }
            if hz[1] >= half_hz {
                return Err(format!("the highest line {} Hz must lie below half the rate, {half_hz} Hz", hz[1]));
            }
            let samples = period * f64::from(*realisations);
            if samples > MOST_TABLE_SAMPLES || samples * (hz[1] / hz[0]) > MOST_LINE_SAMPLES {
                return Err(format!(
                    "{samples:.0} samples of up to {:.0} lines are too many to make: lower the rate, the realisations or the highest line",
                    hz[1] / hz[0]
                ));
            }
            let mut random = Pcg64::seed_from_u64(*seed);
            let tables =
                (0..*realisations).map(|_| multisine(period.round() as usize, hz[1] / hz[0], *odd, &mut random));
            Ok(Some(tables.collect()))
        }
        Shape::File { path } => read_samples(path).map(|samples| Some(vec![samples])),
        _ => Ok(None),
    }
}

/// One period of a random-phase multisine with a peak of one.
fn multisine(period: usize, lines: f64, odd: bool, random: &mut Pcg64) -> Vec<f32> {
    let lines = (lines * (1.0 + 1e-9)) as usize;
    let mut wave = vec![0.0f64; period];
    for line in (1..=lines).step_by(if odd { 2 } else { 1 }) {
        let phase: f64 = random.random_range(0.0..TAU);
        let (turn_sin, turn_cos) = (TAU * line as f64 / period as f64).sin_cos();
        for (run, samples) in wave.chunks_mut(PHASOR_RUN).enumerate() {
            // The product is reduced in whole numbers first, so that high lines keep their phase exactly.
            let turns = (line * run * PHASOR_RUN) % period;
            let (mut sin, mut cos) = (TAU * turns as f64 / period as f64 + phase).sin_cos();
            for sample in samples {
                *sample += cos;
                (cos, sin) = (cos * turn_cos - sin * turn_sin, sin * turn_cos + cos * turn_sin);
            }
        }
    }
    let peak = wave.iter().fold(0.0f64, |m, s| m.max(s.abs()));
    wave.iter().map(|s| (s / peak) as f32).collect()
}

fn read_samples(path: &Path) -> Result<Vec<f32>, String> {
    let text = read_text(path)?;
    let mut samples = Vec::new();
    let mut header_allowed = true;
    // Windows' programs begin a text with a byte order mark.
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        match line.parse::<f32>() {
            Ok(value) if value.is_finite() => {
                if samples.len() as f64 >= MOST_TABLE_SAMPLES {
                    return Err(too_long(path));
                }
                samples.push(value);
            }
            _ if header_allowed && is_header(line) => {}
            _ => {
                let shown: String = line.chars().take(40).collect();
                return Err(format!(
                    "{}, line {}: {shown:?} is not a number; a reference file has one number per line",
                    path.display(),
                    index + 1
                ));
            }
        }
        header_allowed = false;
    }
    if samples.is_empty() {
        Err(format!("{} holds no numbers: it needs one in each line", path.display()))
    } else {
        Ok(samples)
    }
}

/// Whether a first line is a column's name and not a number that is mistyped, too large or none.
fn is_header(line: &str) -> bool {
    let begins_as_number = line.starts_with(|first: char| first.is_ascii_digit() || "+-.".contains(first));
    line.chars().any(char::is_alphabetic) && !begins_as_number && line.parse::<f32>().is_err()
}

/// The text of a file, in bounded time and memory.
fn read_text(path: &Path) -> Result<String, String> {
    let unreadable = |error: std::io::Error| format!("{} cannot be read: {error}; check the name", path.display());
    // Asked before it is opened: opening a pipe waits for whoever writes into it, and a device may never end.
    let found = path.metadata().map_err(unreadable)?;
    if !found.is_file() {
        return Err(format!(
            "{} is a folder, a pipe or a device: write the numbers to a file and name that",
            path.display()
        ));
    }
    if found.len() > MOST_FILE_BYTES {
        return Err(too_long(path));
    }
    // It may grow meanwhile, and files that the system makes up state no length.
    let mut text = String::new();
    let file = File::open(path).map_err(unreadable)?;
    let bytes = file.take(MOST_FILE_BYTES + 1).read_to_string(&mut text).map_err(unreadable)?;
    if bytes as u64 > MOST_FILE_BYTES { Err(too_long(path)) } else { Ok(text) }
}

fn too_long(path: &Path) -> String {
    format!(
        "{} is longer than {MOST_TABLE_SAMPLES} numbers or {MOST_FILE_BYTES} bytes: give a part of it",
        path.display()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(text: &str) -> Part {
        Spec::parse(text).unwrap_or_else(|e| panic!("{e}")).parts.remove(0)
    }

    #[test]
    fn every_documented_example_parses() {
        assert_eq!(one("step:80um").amplitude, 80e-6);
        assert_eq!(one("square:120um@1Hz").shape, Shape::Square { hz: 1.0 });
        assert_eq!(one("sine:120um@100Hz").shape, Shape::Sine { hz: 100.0 });
        assert_eq!(one("sweep:20V@1-2000Hz/4s").seconds, Some(4.0));
        assert_eq!(one("ladder:60V/8,hold=2s").seconds, Some(32.0));
        let sequence =
            Spec::parse("zero@5s+multisine:20V@1-2000Hz,odd,periods=4,realisations=6,seed=7").expect("documented");
        assert_eq!(sequence.parts[0].seconds, Some(5.0));
        assert_eq!(sequence.parts[1].seconds, Some(24.0));
        assert_eq!(sequence.unit, Some(Unit::Volt));
        assert!(one("step:80um,shaped").shaped);
        assert_eq!(one("sine:20um@10Hz/2s").seconds, Some(2.0));
        assert_eq!(one("sine:20um@1e-3Hz").shape, Shape::Sine { hz: 1e-3 });
        let demagnetising = one("decaying-sine:60V@8Hz/2s");
        assert_eq!((demagnetising.shape, demagnetising.seconds), (Shape::DecayingSine { hz: 8.0 }, Some(2.0)));
        assert_eq!(one("sweep:20V@1e-3-2e1Hz/4s").shape, Shape::Sweep { hz: [1e-3, 20.0], log: false });
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, part) in [
            ("stp:80um", "unknown kind \"stp\""),
            ("step:80", "needs its unit"),
            ("step", "needs an amplitude"),
            ("sine:20um", "needs a frequency"),
            ("sine:20um@-5Hz", "greater than zero"),
            ("sweep:20V@2000-1Hz/4s", "upwards"),
            ("decaying-sine:60V@8Hz", "needs its duration"),
            ("step:80um+zero", "needs a length"),
            ("step:80um@1s+hold:2V", "mixes um and V"),
            ("step:80um,foo=3", "unknown option \"foo\""),
            ("ladder:60V/0,hold=2s", "levels"),
            ("sine:nanum@5Hz", "not a number"),
            ("step:80um@10Hz", "no frequency"),
            ("zero:80um", "no amplitude"),
            ("step:80um,shaped=no", "takes no value"),
            ("step:80um,for", "needs a value"),
            ("ladder:60V/8,hold=2s,for=3s", "as long as its levels"),
        ] {
            let message = Spec::parse(text).expect_err(text).to_string();
            assert!(message.contains(part) && !message.contains('\n'), "{text}: {message}");
        }
    }

    #[test]
    fn the_length_of_tables_is_known_before_they_are_made() {
        let shape = one("multisine:20V@10-90Hz,realisations=3").shape;
        let made = table(&shape, 1000.0).expect("valid").expect("a table");
        assert_eq!(table_samples(&shape, 1000.0), Some(made.iter().map(Vec::len).sum()));
        assert_eq!(table_samples(&one("sine:20um@10Hz").shape, 1000.0), None);
        assert_eq!(table_samples(&one("file:none.csv").shape, 1000.0), None);
    }

    #[cfg(unix)]
    #[test]
    fn what_is_no_file_or_has_no_end_is_refused_in_one_line() {
        let folder = std::env::temp_dir().join(format!("hysteron-samples-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let (pipe, long) = (folder.join("pipe"), folder.join("long.csv"));
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo");
        assert!(made.success());
        // A hole: it takes no room on the disk.
        File::create(&long).and_then(|file| file.set_len(MOST_FILE_BYTES + 1)).expect("room for a name");
        for (path, part) in [
            (pipe.as_path(), "is a folder, a pipe or a device: write the numbers to a file"),
            (Path::new("/dev/zero"), "is a folder, a pipe or a device"),
            (folder.as_path(), "is a folder, a pipe or a device"),
            (long.as_path(), "is longer than 20000000 numbers or 400000000 bytes: give a part of it"),
        ] {
            let refused = read_samples(path).expect_err("no file of numbers");
            assert!(refused.contains(part) && !refused.contains('\n'), "{refused}");
        }
        std::fs::remove_dir_all(&folder).expect("it is ours");
    }

    #[test]
    fn a_multisine_has_its_lines_and_no_others() {
        let shape = one("multisine:20V@4-40Hz,odd,seed=3").shape;
        let table = table(&shape, 1000.0).expect("valid").expect("a table").remove(0);
        assert_eq!(table.len(), 250);
        for line in 1..=20 {
            let (re, im) = table.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, &s)| {
                let phase = TAU * (line * k) as f64 / 250.0;
                (re + f64::from(s) * phase.cos(), im + f64::from(s) * phase.sin())
            });
            let size = re.hypot(im) / 125.0;
            // f32 samples leave 250 * 6e-8 at the most where no line is.
            assert_eq!(size > 1e-4, line <= 9 && line % 2 == 1, "line {line}: {size}");
        }
    }
}
