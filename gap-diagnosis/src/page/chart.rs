//! One chart: what is drawn, thinned at once, and its JSON for the script in the page.
//!
//! Colours mean the same on every page ([`Ink`]); widths, fonts and behaviour live in `assets/page.js` and `assets/page.css`.

use serde::Serialize;

use super::number::{count, four_digits, rounded};
use super::thin::{Spacing, decimate, thin_path};

/// Rows (or path entries) a chart keeps at most: five per screen pixel of a wide window, since linked charts share their rows.
const N_POINTS: usize = 6000;
/// A loop needs more: it is drawn in the plane, not along a line.
const N_PATH_POINTS: usize = 16_000;

/// An axis: what it shows and in which unit (empty for a pure number).
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Axis {
    label: String,
    unit: String,
    log: bool,
}

impl Axis {
    /// A linear axis.
    pub fn new(label: &str, unit: &str) -> Self {
        Self { label: label.to_owned(), unit: unit.to_owned(), log: false }
    }

    /// A logarithmic axis; values that are not positive are left out.
    pub fn log(label: &str, unit: &str) -> Self {
        Self { log: true, ..Self::new(label, unit) }
    }

    pub(super) fn unit(&self) -> &str {
        &self.unit
    }

    /// As on paper: `displacement, µm`.
    pub(super) fn title(&self) -> String {
        match self.unit.as_str() {
            "" => self.label.clone(),
            unit => format!("{}, {unit}", self.label),
        }
    }
}

/// What a curve stands for; it fixes colour (Okabe-Ito), width and dashes, so that blue is the model on every page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ink {
    /// What the bench did: broad and pale, drawn first, so that a model on top of it leaves both visible.
    Measured,
    /// What was asked for: dashed.
    Reference,
    /// What the model did: thin, blue.
    Model,
    /// What is left: vermillion.
    Error,
    /// Volts: green.
    Drive,
    /// Anything else: purple.
    Extra,
    /// A second anything else: orange, dashed.
    Other,
}

impl Ink {
    pub(super) fn class(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Reference => "reference",
            Self::Model => "model",
            Self::Error => "error",
            Self::Drive => "drive",
            Self::Extra => "extra",
            Self::Other => "other",
        }
    }
}

/// A named column over the chart's common x.
#[derive(Debug, Clone, Copy)]
pub struct Series<'a> {
    /// For the legend.
    pub name: &'a str,
    /// Its meaning.
    pub ink: Ink,
    /// One value per x; NaN leaves a gap.
    pub values: &'a [f64],
}

/// A named path of a loop plot, in the order in which it was run through.
#[derive(Debug, Clone, Copy)]
pub struct Loop<'a> {
    /// For the legend.
    pub name: &'a str,
    /// Its meaning.
    pub ink: Ink,
    /// Horizontal, e.g. the command.
    pub x: &'a [f64],
    /// Vertical, e.g. the displacement.
    pub y: &'a [f64],
}

/// One of several charts over the same time, see [`Chart::linked_over_time`].
#[derive(Debug, Clone)]
pub struct Panel<'a> {
    /// Heading.
    pub title: &'a str,
    /// What to look for.
    pub caption: &'a str,
    /// Vertical axis.
    pub y: Axis,
    /// One value per time.
    pub series: Vec<Series<'a>>,
}

/// A chart, ready for [`Page::chart`](super::Page::chart).
#[derive(Debug, Clone)]
pub struct Chart {
    title: String,
    caption: String,
    x: Axis,
    y: Axis,
    content: Content,
    is_wide: bool,
    is_low: bool,
    link: Option<String>,
    /// Half-width of the region in which a white residual stays.
    band: Option<f64>,
    n_samples: usize,
    /// Of so many rows one is among the samples.
    stride: usize,
}

/// What of a log a page was given: of a long one, every `stride`-th row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kept {
    /// Rows of the log.
    pub rows: usize,
    /// From one row given to the next; 1 is all of them.
    pub stride: usize,
}

impl Kept {
    /// All of `rows`.
    pub fn all(rows: usize) -> Self {
        Self { rows, stride: 1 }
    }
}

impl Default for Kept {
    fn default() -> Self {
        Self::all(0)
    }
}

#[derive(Debug, Clone)]
enum Content {
    /// Columns over a common ascending x.
    Columns { mark: Mark, spacing: Spacing, x: Vec<f64>, curves: Vec<Curve> },
    /// Each curve with its own x, in any order; NaN pairs lift the pen.
    Paths(Vec<(Vec<f64>, Curve)>),
}

#[derive(Debug, Clone)]
struct Curve {
    name: String,
    ink: Ink,
    values: Vec<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Mark {
    Lines,
    Bars,
    Points,
    Paths,
}

/// What `page.js` reads.
#[derive(Serialize)]
struct Drawing<'a> {
    mark: Mark,
    x: &'a Axis,
    y: &'a Axis,
    link: Option<&'a str>,
    band: Option<f64>,
    series: Vec<Key<'a>>,
    data: Vec<Vec<f64>>,
}

#[derive(Serialize)]
struct Key<'a> {
    name: &'a str,
    ink: Ink,
}

impl Chart {
    /// Columns over time, drawn as lines. `caption` says what to look for.
    ///
    /// # Panics
    /// If a series is not as long as `time_s`; so do the other constructors.
    pub fn over_time(title: &str, caption: &str, time_s: &[f64], y: Axis, series: &[Series<'_>]) -> Self {
        let mark = Mark::Lines;
        let mut chart = Self::columns(title, caption, Axis::new("time", "s"), time_s, y, series, mark, Spacing::Even);
        chart.is_wide = true;
        chart
    }

    /// Charts over one time axis that zoom together, the first taller than the others.
    ///
    /// They keep the same rows, so that at one cursor a residual reads as the difference of the two curves above it.
    pub fn linked_over_time(key: &str, time_s: &[f64], panels: &[Panel<'_>]) -> Vec<Self> {
        let columns: Vec<&[f64]> =
            panels.iter().flat_map(|panel| panel.series.iter().map(|series| series.values)).collect();
        let rows = if columns.is_empty() { Vec::new() } else { decimate(&columns, N_POINTS, Spacing::Even) };
        let pick = |column: &[f64]| -> Vec<f64> { rows.iter().map(|&row| column[row]).collect() };
        let time_kept_s = pick(time_s);
        panels
            .iter()
            .enumerate()
            .map(|(panel_idx, panel)| {
                let kept: Vec<Vec<f64>> = panel.series.iter().map(|series| pick(series.values)).collect();
                let series: Vec<Series<'_>> =
                    panel.series.iter().zip(&kept).map(|(series, values)| Series { values, ..*series }).collect();
                let mut chart = Self::over_time(panel.title, panel.caption, &time_kept_s, panel.y.clone(), &series);
                chart.n_samples = time_s.len();
                chart.is_low = panel_idx > 0;
                chart.linked(key)
            })
            .collect()
    }

    /// Paths in the plane: hysteresis loops, displacement over reference.
    pub fn loops(title: &str, caption: &str, x: Axis, y: Axis, loops: &[Loop<'_>]) -> Self {
        let mut n_samples = 0;
        let paths = loops
            .iter()
            .map(|run| {
                n_samples = n_samples.max(run.x.len());
                thinned_path(run.x, run.y, run.name, run.ink, N_PATH_POINTS / loops.len().max(1))
            })
            .collect();
        Self::new(title, caption, x, y, Content::Paths(paths), n_samples)
    }

    /// Bars over a lag or a number, with the region `±band` in which 99 % of them stay if there is nothing to find.
    pub fn bars_with_band(
        title: &str,
        caption: &str,
        x: Axis,
        y: Axis,
        x_values: &[f64],
        series: Series<'_>,
        band: f64,
    ) -> Self {
        let mut chart = Self::columns(title, caption, x, x_values, y, &[series], Mark::Bars, Spacing::Even);
        chart.band = Some(band);
        chart
    }

    /// Lines over a logarithmic frequency axis. Make `y` logarithmic too for an amplitude spectrum.
    pub fn spectrum(title: &str, caption: &str, frequency_hz: &[f64], y: Axis, series: &[Series<'_>]) -> Self {
        let x = Axis::log("frequency", "Hz");
        Self::columns(title, caption, x, frequency_hz, y, series, Mark::Lines, Spacing::Logarithmic)
    }

    /// Separate marks over an ascending x, e.g. one per start of a fit.
    pub fn points(title: &str, caption: &str, x: Axis, y: Axis, x_values: &[f64], series: &[Series<'_>]) -> Self {
        Self::columns(title, caption, x, x_values, y, series, Mark::Points, Spacing::Even)
    }

    /// Ties the x axis and the cursor to every other chart of the page with the same `key`: zoom one, zoom all.
    pub fn linked(mut self, key: &str) -> Self {
        self.link = Some(key.to_owned());
        self
    }

    /// What the chart was given is only this of a log; its note says so.
    pub fn of(mut self, kept: Kept) -> Self {
        if kept.stride > 1 {
            (self.n_samples, self.stride) = (kept.rows, kept.stride);
        }
        self
    }

    /// Half the height, for a companion such as the drive below the displacement.
    pub fn low(mut self) -> Self {
        self.is_low = true;
        self
    }

    /// The full width of the page (time charts have it anyway).
    pub fn wide(mut self) -> Self {
        self.is_wide = true;
        self
    }

    fn new(title: &str, caption: &str, x: Axis, y: Axis, content: Content, n_samples: usize) -> Self {
        Self {
            title: title.to_owned(),
            caption: caption.to_owned(),
            x,
            y,
            content,
            is_wide: false,
            is_low: false,
            link: None,
            band: None,
            n_samples,
            stride: 1,
        }
    }

    #[expect(clippy::too_many_arguments, reason = "the one place where every kind of column chart is put together")]
    fn columns(
        title: &str,
        caption: &str,
        x: Axis,
        x_values: &[f64],
        y: Axis,
        series: &[Series<'_>],
        mark: Mark,
        spacing: Spacing,
    ) -> Self {
        assert!(
            series.iter().all(|column| column.values.len() == x_values.len()),
            "{title}: every series has one value per x"
        );
        // A logarithm has no place for zero (the constant term of a spectrum) nor for what is below it.
        let is_x_drawn = |value: f64| value.is_finite() && (!x.log || value > 0.0);
        let rows: Vec<usize> = (0..x_values.len()).filter(|&row| is_x_drawn(x_values[row])).collect();
        let is_y_drawn = |value: f64| value.is_finite() && (!y.log || value > 0.0);
        let curves: Vec<Curve> = series
            .iter()
            .map(|column| Curve {
                name: column.name.to_owned(),
                ink: column.ink,
                values: rows
                    .iter()
                    .map(|&row| if is_y_drawn(column.values[row]) { column.values[row] } else { f64::NAN })
                    .collect(),
            })
            .collect();
        let x_drawn: Vec<f64> = rows.iter().map(|&row| x_values[row]).collect();
        let content = thinned_columns(&x_drawn, &curves, mark, spacing, N_POINTS);
        Self::new(title, caption, x, y, content, rows.len())
    }

    /// The data for the script and the number of samples in them, with `1/divisor` of the points: a page with many charts draws each a little coarser.
    pub(super) fn json(&self, divisor: usize) -> (String, usize) {
        let (mark, data, curves): (Mark, Vec<Vec<f64>>, Vec<&Curve>);
        let coarser;
        let content = if divisor > 1 {
            coarser = self.content.thinned(divisor);
            &coarser
        } else {
            &self.content
        };
        match content {
            Content::Columns { mark: columns_mark, x, curves: columns, .. } => {
                mark = *columns_mark;
                // Ten digits of time: a microsecond in an hour.
                let mut all = vec![x.iter().map(|&value| rounded(value, 10)).collect()];
                all.extend(columns.iter().map(|curve| single_precision(&curve.values)));
                data = all;
                curves = columns.iter().collect();
            }
            Content::Paths(paths) => {
                mark = Mark::Paths;
                data = paths
                    .iter()
                    .flat_map(|(x, curve)| [single_precision(x), single_precision(&curve.values)])
                    .collect();
                curves = paths.iter().map(|(_, curve)| curve).collect();
            }
        }
        let drawing = Drawing {
            mark,
            x: &self.x,
            y: &self.y,
            link: self.link.as_deref(),
            band: self.band.map(|band| rounded(band, 7)),
            series: curves.iter().map(|curve| Key { name: &curve.name, ink: curve.ink }).collect(),
            data,
        };
        // serde_json writes NaN as null, which is what the script takes for a gap.
        let json = serde_json::to_string(&drawing).expect("numbers and strings always serialise");
        (json, content.n_drawn())
    }

    pub(super) fn is_wide(&self) -> bool {
        self.is_wide
    }

    /// The figure; `json` goes into it as data. `escape` is the page's.
    pub(super) fn html(
        &self,
        chart_idx: usize,
        is_wide: bool,
        (json, n_drawn): &(String, usize),
        escape: fn(&str) -> String,
    ) -> String {
        let mut classes = String::from("chart");
        if is_wide {
            classes += " wide";
        }
        if self.is_low {
            classes += " low";
        }
        let names: Vec<(&str, Ink)> = match &self.content {
            Content::Columns { curves, .. } => curves.iter().map(|curve| (curve.name.as_str(), curve.ink)).collect(),
            Content::Paths(paths) => paths.iter().map(|(_, curve)| (curve.name.as_str(), curve.ink)).collect(),
        };
        let mut keys = format!("<span class=\"key x\">{} <output></output></span>", escape(&self.x.label));
        for (series_idx, (name, ink)) in names.iter().enumerate() {
            keys += &format!(
                "<span class=\"key\"><button type=\"button\" aria-pressed=\"true\" data-series=\"{}\" title=\"show or hide\"><i class=\"swatch {}{}\"></i>{}</button> <output></output></span>",
                series_idx + 1,
                ink.class(),
                match &self.content {
                    Content::Columns { mark: Mark::Points, .. } if series_idx == 0 => " dot full",
                    Content::Columns { mark: Mark::Points, .. } => " dot",
                    _ => "",
                },
                escape(name)
            );
        }
        if let Some(band) = self.band {
            keys += &format!(
                "<span class=\"key\"><i class=\"swatch band\"></i>99 % region, ±{}</span>",
                escape(&four_digits(band, &self.y.unit))
            );
        }
        let note = if self.stride > 1 {
            // Of 400 000 samples and more, so that fewer are always drawn.
            format!(
                " <span class=\"note\">{} samples, of which one in {} was looked at and {} are drawn; a peak of a few samples may be missing.</span>",
                count(self.n_samples),
                count(self.stride),
                count(*n_drawn)
            )
        } else if *n_drawn < self.n_samples {
            format!(
                " <span class=\"note\">{} samples, {} drawn; every peak is kept.</span>",
                count(self.n_samples),
                count(*n_drawn)
            )
        } else {
            String::new()
        };
        format!(
            "<figure class=\"{classes}\" id=\"chart-{chart_idx}\">\n\
             <h3 id=\"chart-{chart_idx}-title\">{title}</h3>\n\
             <div class=\"legend\">{keys}</div>\n\
             <p class=\"y-title\">{y_title}</p>\n\
             <div class=\"plot\" tabindex=\"0\" role=\"group\" aria-roledescription=\"chart\" aria-labelledby=\"chart-{chart_idx}-title chart-{chart_idx}-caption\"></div>\n\
             <p class=\"x-title\">{x_title}</p>\n\
             <figcaption><span id=\"chart-{chart_idx}-caption\">{caption}</span>{note}</figcaption>\n\
             <p class=\"spoken\" aria-live=\"polite\"></p>\n\
             <script type=\"application/json\">{json}</script>\n\
             </figure>\n",
            title = escape(&self.title),
            y_title = escape(&self.y.title()),
            x_title = escape(&self.x.title()),
            caption = escape(&self.caption),
        )
    }
}

impl Content {
    /// Samples of the fullest curve; where the pen lifts is not one.
    fn n_drawn(&self) -> usize {
        match self {
            Self::Columns { x, .. } => x.len(),
            Self::Paths(paths) => {
                paths.iter().map(|(x, _)| x.iter().filter(|value| value.is_finite()).count()).max().unwrap_or(0)
            }
        }
    }

    fn thinned(&self, divisor: usize) -> Self {
        match self {
            Self::Columns { mark, spacing, x, curves } => {
                thinned_columns(x, curves, *mark, *spacing, N_POINTS / divisor)
            }
            Self::Paths(paths) => {
                let n_points = N_PATH_POINTS / paths.len().max(1) / divisor;
                Self::Paths(
                    paths
                        .iter()
                        .map(|(x, curve)| thinned_path(x, &curve.values, &curve.name, curve.ink, n_points))
                        .collect(),
                )
            }
        }
    }
}

fn thinned_columns(x: &[f64], curves: &[Curve], mark: Mark, spacing: Spacing, n_points: usize) -> Content {
    let columns: Vec<&[f64]> = curves.iter().map(|curve| curve.values.as_slice()).collect();
    let kept = decimate(&columns, n_points, spacing);
    let pick = |column: &[f64]| -> Vec<f64> { kept.iter().map(|&row| column[row]).collect() };
    Content::Columns {
        mark,
        spacing,
        x: pick(x),
        curves: curves.iter().map(|curve| Curve { values: pick(&curve.values), ..curve.clone() }).collect(),
    }
}

fn thinned_path(x: &[f64], y: &[f64], name: &str, ink: Ink, n_points: usize) -> (Vec<f64>, Curve) {
    let path = thin_path(x, y, n_points.max(500));
    let pick =
        |column: &[f64]| -> Vec<f64> { path.iter().map(|step| step.map_or(f64::NAN, |idx| column[idx])).collect() };
    (pick(x), Curve { name: name.to_owned(), ink, values: pick(y) })
}

fn single_precision(values: &[f64]) -> Vec<f64> {
    values.iter().map(|&value| rounded(value, 7)).collect()
}
