//! `hysteron board run`: the flash image on the virtual board, in a loop with the simulated plant: a log and a report.

use crate::arguments::BoardRunCall;
use crate::commands::link::in_fault;
use crate::commands::loops::{Free, judge};
use crate::failure::Failure;
use crate::output;
use control_core::{AdcCode, DacCode, FaultCode, Law, ModeName, Settings};
use hil_bridge::link::Place;
use hil_bridge::session::is_ours;
use plant_sim::controller::Controller;
use plant_sim::experiment::Program;
use plant_sim::log::{Column, Meta, Writer};
use plant_sim::metrics::Limited;
use plant_sim::model::Model;
use plant_sim::spec::Unit;
use serde_json::json;
use std::path::Path;
use virtual_board::run::{Experiment, Report, run};
use virtual_board::waveform::Waveform;
use virtual_board::{BenchSettings, Image};
use wire::{Checked, Converters, Parameters};

/// From the ADC's hold to the DAC's latch, in microseconds.
const LATENCY_S: f64 = 10e-6;

/// Rows that one call may make: at about real time, 100 s at 20 kHz.
const MOST_ROWS: f64 = 2e6;

/// Runs it.
pub fn board_run(call: &BoardRunCall) -> Result<(), Failure> {
    let image = Image::read(&call.image).map_err(|error| Failure::file(error.to_string()))?;
    let model = Model::read(&call.plant)?;
    let chain = model.chain();
    let spec = call.drive.spec();
    let Some(spec) = spec else {
        return Err(Failure::call("nothing to drive with: give --controller and --reference, or --command"));
    };
    let mut warnings = output::about(&call.plant, model.live_warnings());
    let is_closed_loop = call.drive.reference.is_some();
    let program = Program::new(spec, call.rate)?;
    match (is_closed_loop, program.unit()) {
        (true, Some(Unit::Volt)) => {
            return Err(Failure::call("--reference is a displacement: give its amplitudes in um"));
        }
        (false, Some(Unit::Micrometre)) => {
            return Err(Failure::call("--command is a voltage: give its amplitudes in V"));
        }
        _ => {}
    }
    let samples = match (call.seconds, program.samples()) {
        (Some(seconds), _) => (seconds * call.rate).round(),
        (None, Some(samples)) => samples as f64,
        (None, None) => return Err(Failure::call("the SPEC has no length of its own: give --seconds")),
    };
    if !(2.0..=MOST_ROWS).contains(&samples) {
        return Err(Failure::call(format!(
            "{samples} samples: a run has 2 to {MOST_ROWS}; change --seconds or --rate"
        )));
    }
    let (converters, default) = if image.has_external_converters() {
        (Converters::EXTERNAL_16BIT, Parameters::EXTERNAL_PI1)
    } else {
        (Converters::NUCLEO_G474RE, Parameters::NUCLEO_PI1)
    };
    let mut parameters = Parameters { rate_hz: call.rate as f32, ..default };
    if let Some(path) = &call.drive.controller {
        let settings = settings(path, call.rate)?;
        warnings.extend(loop_warnings(path, &settings, call.rate, LATENCY_S, &model, Free::Rate)?);
        parameters = parameters.with_settings(&settings);
    }
    let checked = parameters.check(&converters)?;
    let waveform = Waveform::new(spec, call.rate).map_err(|error| Failure::call(error.to_string()))?;
    let bench = BenchSettings {
        chain,
        start: model.start(),
        calibration: checked.calibration,
        seed: call.seed,
        anti_alias_hz: call.anti_alias,
        has_external_converters: image.has_external_converters(),
    };
    let experiment = Experiment { bench, parameters, waveform, is_closed_loop, samples: samples as u64 };
    let bar = output::bar(experiment.samples, "running the image");
    let report = run(&image, &experiment, &|done| bar.set_position(done))
        .map_err(|error| Failure::hardware(format!("virtual board: {error}")))?;
    bar.finish_and_clear();
    if !is_ours(&report.firmware) {
        let ours = env!("CARGO_PKG_VERSION");
        warnings.push(format!(
            "the image is of firmware {}, this program is {ours}: hil and record take only one of this release (cargo xtask firmware)",
            report.firmware
        ));
    }
    let limited = Limited::of(report.streamed.iter().map(|sample| sample.limited_by));
    if report.status.fault == 0 {
        warnings.extend(limited.warning(report.rows.len(), is_closed_loop));
    }
    write_log(call, &report, &checked)?;
    output::warn(&warnings);
    say(call, &report, &limited)?;
    match FaultCode::from_number(report.status.fault) {
        Some(fault) => Err(in_fault(fault, &call.out, &Place::Virtual)),
        None => Ok(()),
    }
}

/// The settings of a controller file for a board.
pub fn settings(path: &Path, rate_hz: f64) -> Result<Settings, Failure> {
    let controller = Controller::read(path)?;
    if controller.inverse.is_some() {
        return Err(Failure::call(format!(
            "{}: [inverse] runs in `hysteron simulate` only, boards have no room for it yet; remove the section",
            path.display()
        )));
    }
    let settings = controller.settings(rate_hz);
    Law::try_build(&settings).map_err(|error| Failure::call(format!("{}: {error}", path.display())))?;
    if settings.is_unlimited() {
        return Err(Failure::call(format!(
            "{}: limits, clamp and trip must be finite on a board: give it [limits], [reference] and [guard] in place of `unlimited = true`",
            path.display()
        )));
    }
    Ok(settings)
}

/// Refuses the loop of a controller file where it is unstable; what there is to warn of: small margins, and limits beyond what the rig stands.
pub fn loop_warnings(
    path: &Path,
    settings: &Settings,
    rate_hz: f64,
    latency_s: f64,
    model: &Model,
    free: Free,
) -> Result<Vec<String>, Failure> {
    let (_, thin) = judge(path, settings, rate_hz, latency_s, &model.chain(), free)?;
    let beyond = model.rig.iter().flat_map(|rig| rig.beyond(settings));
    Ok(thin.into_iter().chain(beyond.map(|beyond| format!("{}: {beyond}", path.display()))).collect())
}

fn write_log(call: &BoardRunCall, report: &Report, checked: &Checked) -> Result<(), Failure> {
    let calibration = &checked.calibration;
    let mut meta = Meta {
        rate_hz: Some(call.rate),
        latency_s: LATENCY_S,
        adc_lsb_m: Some(f64::from(calibration.displacement_m_per_code()).abs()),
        dac_lsb_v: Some(f64::from(calibration.drive_v_per_code()).abs()),
        controller: call.drive.controller.as_deref().map(output::file_name),
        firmware: Some(report.firmware.clone()),
        seed: Some(call.seed.to_string()),
        ..Meta::default()
    };
    meta.other.insert("plant".into(), output::file_name(&call.plant));
    meta.other.insert("board".into(), format!("{} (virtual)", report.board));
    let is_streamed = report.streamed.len() == report.rows.len();
    let mut columns = vec![Column::Time, Column::Command, Column::Displacement];
    if is_streamed {
        columns.extend([Column::Reference, Column::Drive, Column::LimitedBy]);
    }
    let mut writer = Writer::create(&call.out, &meta, &columns)?;
    for (k, row) in report.rows.iter().enumerate() {
        let mut values = vec![
            k as f64 / call.rate,
            f64::from(calibration.drive_v(DacCode(row.dac))),
            f64::from(calibration.displacement_m(AdcCode(row.adc))),
        ];
        if let (true, Some(sample)) = (is_streamed, report.streamed.get(k)) {
            values.extend([
                f64::from(sample.reference) * f64::from(report.reference_step_m),
                f64::from(checked.monitor_v(sample.monitor)),
                f64::from(sample.limited_by.bits()),
            ]);
        }
        writer.row(&values)?;
    }
    Ok(writer.finish()?)
}

/// The report, beside the log and on the terminal.
fn say(call: &BoardRunCall, report: &Report, limited: &Limited) -> Result<(), Failure> {
    let (cost, status) = (&report.cost, &report.status);
    let mean = cost.total_instructions as f64 / cost.count.max(1) as f64;
    let fault = FaultCode::from_number(status.fault).map_or("none", FaultCode::word);
    let value = json!({
        "schema": "hysteron-board-report-1",
        "board": report.board,
        "firmware": report.firmware,
        "image_bytes": report.image_bytes,
        "stack_bytes": { "used": report.stack_bytes.0, "there": report.stack_bytes.1 },
        "samples": report.rows.len(),
        "period_cycles": [report.period_cycles.0, report.period_cycles.1],
        "latch_cycles": [report.latch_cycles.0, report.latch_cycles.1],
        "instructions_per_interrupt": { "least": cost.instructions.0, "mean": mean, "most": cost.instructions.1 },
        "model_cycles_per_interrupt": { "least": cost.cycles.0, "most": cost.cycles.1 },
        "instructions_from_flash": cost.from_flash,
        "ready_max_cycles": status.ready_max_cycles,
        "overruns": status.overruns,
        "lost_samples": status.lost_samples,
        // Of a line that is too slow for all samples nothing is known of it.
        "limited_samples": (!report.streamed.is_empty()).then_some(limited.samples),
        "bad_frames": status.bad_frames,
        "fault": fault,
        "running": status.mode == ModeName::Running as u8,
        "resets": report.resets.len(),
        "peak_um": report.peak_m * 1e6,
        "log": report.log,
        "measured_on_silicon": false,
    });
    let path = output::report_path(&call.out);
    if let Some(path) = &path {
        output::save(path, format!("{value:#}\n").as_bytes())?;
    }
    if call.json {
        output::line(&value.to_string());
        return Ok(());
    }
    let pair = |(low, high): (u64, u64)| if low == high { low.to_string() } else { format!("{low} to {high}") };
    output::facts(&[
        ("board".into(), format!("{}, firmware {}", report.board, report.firmware)),
        ("samples".into(), report.rows.len().to_string()),
        ("period".into(), format!("{} cycles", pair(report.period_cycles))),
        ("sample to latch".into(), format!("{} cycles", pair(report.latch_cycles))),
        ("control interrupt".into(), format!("{mean:.0} instructions, at most {}", cost.instructions.1)),
        (
            "drive ready".into(),
            format!("{} cycles after the trigger at the latest (not measured on silicon)", status.ready_max_cycles),
        ),
        ("overruns, lost samples".into(), format!("{}, {}", status.overruns, status.lost_samples)),
        ("fault".into(), fault.replace('_', " ")),
        ("peak displacement".into(), format!("{:.2} um", report.peak_m * 1e6)),
    ]);
    output::line(&format!("log: {}", call.out.display()));
    if let Some(path) = &path {
        output::line(&format!("report: {}", path.display()));
    }
    Ok(())
}
