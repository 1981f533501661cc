//! `hysteron replay`: the logged command through a plant, row by row, so that a log of any length fits in memory.

use super::identify::MOST_ROWS;
use crate::arguments::ReplayCall;
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::identify::{IdentifyError, fit_start};
use gap_diagnosis::page::{ReplayView, four_digits, replay_page};
use gap_diagnosis::residual::{Autocorrelation, LAGS};
use indicatif::ProgressBar;
use plant_sim::chain::Chain;
use plant_sim::log::{self, Column, Log, Meta, Row, Writer};
use plant_sim::metrics::Score;
use plant_sim::model::Model;
use plant_sim::replay::{Commands, Initial, Start, Stream};
use std::collections::VecDeque;

/// Rows after the run-in that are kept in memory: for the fit of the start, for warnings, and for the residual's autocorrelation.
const HEAD_ROWS: usize = 200_000;
/// Rows of a run-in that are kept besides, where a start is fitted.
const MOST_RUN_IN: usize = MOST_ROWS - HEAD_ROWS;
/// Rows that the page keeps; beyond, every second one is dropped, and so on.
const PAGE_ROWS: usize = 400_000;
/// Rows whose commands are forgotten together.
const FORGET_ROWS: usize = 4096;

pub fn replay(call: &ReplayCall) -> Result<(), Failure> {
    let model = Model::read(&call.plant)?;
    let chain = model.chain();
    let mut warnings = output::about(&call.plant, model.warnings());
    let (mut head, is_whole) = head(call)?;
    warnings.extend(if is_whole { log::warnings(&head) } else { log::warnings_of_head(&head) });
    // The stand-in for a structure that the kind lacks would take newtons for volts or metres.
    let takes_force = model.kind.has_structure();
    if !takes_force && head.force_n.take().is_some() {
        warnings.push(super::logs::no_structure(&head.name, model.kind.name()));
    }
    let run_in = head.meta.run_in_rows(call.start.run_in, head.dt_s);
    let (start, _) = match call.start.initial {
        Initial::Relaxed => (Start::relaxed(&chain), 0.0),
        initial => fit_start(&chain, &head, initial, run_in, call.free_offset)?,
    };
    let spinner = output::spinner();
    let mut replay = Replay { call, chain: &chain, head: &head, start: &start, run_in, takes_force, spinner: &spinner };
    // A free offset is the mean of the whole residual, which is known only after a first pass over the log.
    let offset_m = if call.free_offset { replay.pass(0.0, |_, _| Ok(()))?.offset_m() } else { 0.0 };
    let meta = Meta { rate_hz: rate_hz(&head), ..Meta::default() };
    let mut writer = Writer::create(&call.out, &meta, &[Column::Time, Column::Displacement, Column::Predicted])?;
    let mut shown = Shown::new(run_in);
    let score = replay.pass(offset_m, |row, predicted_m| {
        writer.row(&[row.time_s, row.displacement_m, predicted_m])?;
        shown.add(row, predicted_m);
        Ok(())
    })?;
    if score.rows() == 0 {
        return Err(IdentifyError::run_in_too_long(&head, 0, run_in).into());
    }
    writer.finish()?;
    spinner.finish_and_clear();

    let (rms_m, fit_percent) = (score.rms_m(false), score.fit_percent(false));
    if fit_percent < 0.0 {
        warnings.push(format!(
            "the prediction is further from the log than a constant would be (fit {fit_percent:.0} %): \
             does this plant belong to this log, and are the units right?"
        ));
    }
    let facts = vec![
        ("fit".to_owned(), four_digits(fit_percent, "%")),
        ("rms".to_owned(), four_digits(rms_m * 1e6, "um")),
        ("rows scored".to_owned(), score.rows().to_string()),
        ("free offset".to_owned(), if call.free_offset { four_digits(offset_m * 1e6, "um") } else { "none".into() }),
    ];
    output::warn(&warnings);
    if call.show.json {
        let json = serde_json::json!({
            "rms_um": rms_m * 1e6,
            "fit_percent": fit_percent,
            "rows": score.rows(),
            "offset_um": offset_m * 1e6,
        });
        output::line(&json.to_string());
    } else {
        output::facts(&facts);
        output::line(&format!("prediction: {}", call.out.display()));
    }
    if let Some(path) = output::page_path(&call.show, &call.out) {
        let page = shown.page(call, &model, &facts, &warnings, fit_percent);
        output::save_page(&page, &path, call.show.json)?;
    }
    Ok(())
}

/// The rate that a log states, or that of its times where they contradict it: the prediction's times are rounded by it.
fn rate_hz(log: &Log) -> Option<f64> {
    let agrees = |rate_hz: f64| (rate_hz * log.dt_s - 1.0).abs() < 1e-9;
    log.meta.rate_hz.map(|stated_hz| if agrees(stated_hz) { stated_hz } else { log.dt_s.recip() })
}

/// The beginning of the log, with the run-in where the start is fitted to what comes after it; and whether it is the whole log.
fn head(call: &ReplayCall) -> Result<(Log, bool), Failure> {
    let mut reader = log::open(&call.log, &call.read.options())?;
    let mut head = Log { name: output::file_name(&call.log), ..Log::default() };
    let force = reader.has(Column::Force);
    let mut force_n = Vec::new();
    let is_fitted = call.start.initial != Initial::Relaxed;
    let run_in = if is_fitted { reader.meta().run_in_rows(call.start.run_in, reader.dt_s()) } else { 0 };
    for row in reader.by_ref().take(run_in.min(MOST_RUN_IN) + HEAD_ROWS) {
        let row = row?;
        if head.command_v.is_empty() {
            head.time_start_s = row.time_s;
        }
        head.command_v.push(row.command_v);
        head.displacement_m.push(row.displacement_m);
        force_n.push(row.force_n.unwrap_or(0.0));
    }
    // A log that ends before that is whole.
    if run_in > MOST_RUN_IN && head.command_v.len() == MOST_RUN_IN + HEAD_ROWS {
        return Err(Failure::call(format!(
            "{}: a run-in of {} s is {run_in} rows, more than the {MOST_RUN_IN} that are kept: cut the log or shorten --run-in",
            head.name,
            run_in as f64 * reader.dt_s()
        )));
    }
    head.dt_s = reader.dt_s();
    head.meta = reader.meta().clone();
    head.force_n = force.then_some(force_n);
    let is_whole = reader.next().transpose()?.is_none();
    Ok((head, is_whole))
}

struct Replay<'a> {
    call: &'a ReplayCall,
    chain: &'a Chain,
    head: &'a Log,
    start: &'a Start,
    run_in: usize,
    takes_force: bool,
    spinner: &'a ProgressBar,
}

impl Replay<'_> {
    /// Reads the log once, predicts every row, and hands both to `sink`; the score leaves the run-in out.
    fn pass(
        &mut self,
        offset_m: f64,
        mut sink: impl FnMut(&Row, f64) -> Result<(), Failure>,
    ) -> Result<Score, Failure> {
        let mut reader = log::open(&self.call.log, &self.call.read.options())?;
        let meta = &self.head.meta;
        // The head knows the sampling interval better than the first rows do, whose printed times are rounded.
        let mut stream = Stream::new(self.chain, self.head.dt_s, meta, self.start);
        let mut score = Score::default();
        let mut rows = 0usize;
        // Rows that are read but not yet replayed, and what the stream needs to know.
        let mut window: VecDeque<Row> = VecDeque::new();
        let mut known = Known::default();
        loop {
            let [from, to] = stream.needs();
            known.forget(from);
            while known.end() < to.max(rows + 1)
                && let Some(mut row) = reader.next().transpose()?
            {
                row.force_n = row.force_n.filter(|_| self.takes_force);
                known.add(&row);
                window.push_back(row);
            }
            let Some(row) = window.pop_front() else {
                return Ok(score);
            };
            let predicted_m = offset_m + stream.next_m(known.commands());
            if rows >= self.run_in {
                score.add(row.displacement_m, predicted_m);
            }
            sink(&row, predicted_m)?;
            rows += 1;
            if rows.is_multiple_of(100_000) {
                self.spinner.set_message(format!("replaying, {rows} rows"));
            }
        }
    }
}

/// The rows of a log that its stream may still ask for.
#[derive(Default)]
struct Known {
    first: usize,
    command_v: Vec<f64>,
    force_n: Vec<f64>,
}

impl Known {
    fn end(&self) -> usize {
        self.first + self.command_v.len()
    }

    fn add(&mut self, row: &Row) {
        self.command_v.push(row.command_v);
        self.force_n.push(row.force_n.unwrap_or(0.0));
    }

    /// Rows before `from` are no longer needed; they go once they are many, because what stays is moved. The last one stays: it is held at the log's end.
    fn forget(&mut self, from: usize) {
        let old = from.saturating_sub(self.first).min(self.command_v.len().saturating_sub(1));
        if old > FORGET_ROWS.max(self.command_v.len() / 2) {
            self.command_v.drain(..old);
            self.force_n.drain(..old);
            self.first += old;
        }
    }

    fn commands(&self) -> Commands<'_> {
        Commands { first: self.first, command_v: &self.command_v, force_n: Some(&self.force_n) }
    }
}

/// What the page shows: every `stride`-th row, and the first residuals.
struct Shown {
    stride: usize,
    rows: usize,
    run_in: usize,
    time_s: Vec<f64>,
    command_v: Vec<f64>,
    measured_um: Vec<f64>,
    predicted_um: Vec<f64>,
    residual_m: Vec<f64>,
}

impl Shown {
    fn new(run_in: usize) -> Self {
        let empty = Vec::new;
        Self {
            stride: 1,
            rows: 0,
            run_in,
            time_s: empty(),
            command_v: empty(),
            measured_um: empty(),
            predicted_um: empty(),
            residual_m: empty(),
        }
    }

    fn add(&mut self, row: &Row, predicted_m: f64) {
        let scored = self.rows >= self.run_in;
        if scored && self.residual_m.len() < HEAD_ROWS {
            self.residual_m.push(row.displacement_m - predicted_m);
        }
        if self.rows.is_multiple_of(self.stride) {
            self.time_s.push(row.time_s);
            self.command_v.push(row.command_v);
            self.measured_um.push(if scored { row.displacement_m * 1e6 } else { f64::NAN });
            self.predicted_um.push(predicted_m * 1e6);
        }
        self.rows += 1;
        if self.time_s.len() > PAGE_ROWS {
            self.stride *= 2;
            for column in [&mut self.time_s, &mut self.command_v, &mut self.measured_um, &mut self.predicted_um] {
                let mut index = 0;
                column.retain(|_| {
                    index += 1;
                    index % 2 == 1
                });
            }
        }
    }

    fn page(
        &self,
        call: &ReplayCall,
        model: &Model,
        facts: &[(String, String)],
        warnings: &[String],
        fit_percent: f64,
    ) -> gap_diagnosis::page::Page {
        let correlation = Autocorrelation::of(&self.residual_m, LAGS);
        let mut warnings = warnings.to_vec();
        if self.stride > 1 {
            warnings.push(format!("the log is long: the plots show every {}th row", self.stride));
        }
        let log = output::file_name(&call.log);
        replay_page(&ReplayView {
            title: "Replay",
            subtitle: &format!("{} on {log}", model.name),
            headline: &format!("The plant explains {fit_percent:.2} % of {log}."),
            time_s: &self.time_s,
            kept: gap_diagnosis::page::Kept { rows: self.rows, stride: self.stride },
            command_v: &self.command_v,
            measured_um: &self.measured_um,
            predicted_um: &self.predicted_um,
            autocorrelation: &correlation.correlation,
            n_residuals: self.residual_m.len(),
            spectrum: None,
            metrics: facts,
            warnings: &warnings,
            provenance: &output::provenance(None),
        })
    }
}
