//! `hysteron simulate`: closed or open loop, a log, metrics, a page.

use crate::arguments::SimulateCall;
use crate::commands::design::inverse;
use crate::commands::loops::{Free, judge};
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::page::{SimulationView, four_digits, simulation_page};
use plant_sim::controller::Controller;
use plant_sim::experiment::{Program, Recording, Setup, closed_loop_inverse, open_loop};
use plant_sim::log::{Column, Meta, Writer};
use plant_sim::metrics::{Limited, LoopMetrics, Task, loop_metrics};
use plant_sim::model::{Model, RigSection};
use plant_sim::spec::{Shape, Spec, Unit};

/// Rows that one call may make: 20 million are 0.6 GB in memory and 1 GB on disk.
const MOST_ROWS: f64 = 2e7;

pub fn simulate(call: &SimulateCall) -> Result<(), Failure> {
    let model = Model::read(&call.plant)?;
    let chain = model.chain();
    let mut warnings = output::about(&call.plant, model.warnings());
    let spec = call.drive.spec();
    let Some(spec) = spec else {
        return Err(Failure::call("nothing to drive with: give --controller and --reference, or --command"));
    };
    let program = Program::new(spec, call.rate)?;
    check_unit(call, &program)?;
    let samples = samples(call, &program)?;
    let start = model.start();
    let setup =
        Setup { chain: &chain, start: &start, rate_hz: call.rate, samples, latency_s: delay_s(call), seed: call.seed };
    let mut facts = Vec::new();
    let mut controller_name = None;
    let bar = output::bar(samples as u64, "simulating");
    let progress = |done: usize| bar.set_position(done as u64);
    let recording = match &call.drive.controller {
        Some(path) => {
            let controller = Controller::read(path)?;
            let mut settings = controller.settings(call.rate);
            if call.no_feedforward {
                settings.feedforward_v_per_m = 0.0;
            }
            controller_name = Some(output::file_name(path));
            let (assessment, warning) = judge(path, &settings, call.rate, delay_s(call), &chain, Free::Both)?;
            warnings.extend(warning);
            let least_db = assessment.gain_margin_db.value;
            let told = if least_db.is_finite() { format!("{least_db:.1} dB") } else { "unbounded".to_owned() };
            facts.push(("gain margin".to_owned(), told));
            let inverse =
                if call.no_feedforward { None } else { inverse(&controller, path, call.rate, delay_s(call))? };
            closed_loop_inverse(&setup, &settings, inverse.as_ref(), &program, &progress)?
        }
        None => open_loop(&setup, &program, &progress)?,
    };
    bar.finish_and_clear();

    let reference = (!recording.reference_m.is_empty()).then_some(recording.reference_m.as_slice());
    let mut metrics = loop_metrics(task(spec), recording.dt_s, reference, &recording.displacement_m);
    metrics.peak_v = recording.command_v.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let limited = Limited::of(recording.limited_by.iter().copied());
    (metrics.limited_samples, metrics.shaped_samples) = (limited.samples, limited.shaped_samples);
    warnings.extend(limited.warning(samples, call.drive.reference.is_some()));
    if metrics.shaped_samples > 0 {
        facts.push(("reference shaped".to_owned(), format!("{} samples", metrics.shaped_samples)));
    }
    if recording.limited_by.iter().any(|l| l.is_safe_state()) {
        warnings.push("the control law tripped and went to its safe state: see limited_by in the log".into());
    }
    if let (Task::Sine { hz, .. }, Some(_), None) = (task(spec), reference, metrics.gain) {
        warnings.push(format!(
            "the run is shorter than one period of {} Hz, so that it has no gain, phase or error: give --seconds {} or more",
            plain(hz),
            plain(1.0 / hz)
        ));
    }
    if let Some(rig) = &model.rig {
        warnings.extend(beyond_rig(rig, &recording));
    }
    write_log(call, &recording, controller_name)?;
    output::warn(&warnings);
    facts.splice(0..0, readable(&metrics));
    if call.show.json {
        output::line(&serde_json::json!(metrics).to_string());
    } else {
        output::facts(&facts);
        output::line(&format!("log: {}", call.out.display()));
    }
    if let Some(path) = output::page_path(&call.show, &call.out) {
        let page = page(call, &model, &recording, &facts, &warnings);
        output::save_page(&page, &path, call.show.json)?;
    }
    Ok(())
}

/// References are lengths and commands volts.
fn check_unit(call: &SimulateCall, program: &Program) -> Result<(), Failure> {
    match (call.drive.reference.is_some(), program.unit()) {
        (true, Some(Unit::Volt)) => Err(Failure::call("--reference is a displacement: give its amplitudes in um")),
        (false, Some(Unit::Micrometre)) => Err(Failure::call("--command is a voltage: give its amplitudes in V")),
        _ => Ok(()),
    }
}

fn samples(call: &SimulateCall, program: &Program) -> Result<usize, Failure> {
    let rows = match call.seconds {
        Some(seconds) => (seconds * call.rate).round(),
        None => {
            program.samples().ok_or_else(|| Failure::call("the SPEC has no length of its own: give --seconds"))? as f64
        }
    };
    if rows < 1.0 {
        return Err(Failure::call(format!("--seconds is shorter than one sample at {} Hz", plain(call.rate))));
    }
    if rows > MOST_ROWS {
        return Err(Failure::call(format!(
            "{} samples are more than the {MOST_ROWS:.0} that one call makes: lower --rate or --seconds",
            plain(rows)
        )));
    }
    if delay_s(call) * call.rate > rows {
        return Err(Failure::call(format!(
            "--delay-us {} is longer than the run of {} s, so that nothing would move: lower it",
            plain(call.delay_us),
            plain(rows / call.rate)
        )));
    }
    Ok(rows as usize)
}

/// The delay in seconds. The decimal point is moved in the text, so that the log states the delay as it was asked for.
fn delay_s(call: &SimulateCall) -> f64 {
    let text = format!("{:e}", call.delay_us);
    let moved = text.split_once('e').and_then(|(digits, power)| {
        let power: i32 = power.parse().ok()?;
        format!("{digits}e{}", power - 6).parse().ok()
    });
    moved.unwrap_or(call.delay_us / 1e6)
}

/// A number in as few digits as identify it, with an exponent where it is very large or small.
fn plain(value: f64) -> String {
    if (1e-6..1e12).contains(&value) { value.to_string() } else { format!("{value:e}") }
}

/// Where the run left what the real rig stands, one line each.
fn beyond_rig(rig: &RigSection, recording: &Recording) -> Vec<String> {
    let [low, high] = rig.drive_v();
    let beyond = |v: &&f64| **v < low || **v > high;
    let mut warnings = Vec::new();
    let worst_v = recording.command_v.iter().filter(beyond).fold(0.0f64, |m, v| if v.abs() > m.abs() { *v } else { m });
    if worst_v != 0.0 {
        warnings.push(format!("the command reaches {worst_v:.1} V, beyond the rig's {low} .. {high} V"));
    }
    let (peak_um, most_um) = (recording.peak_m * 1e6, rig.displacement_max_um.value);
    if peak_um > most_um {
        warnings.push(format!("the displacement reaches {peak_um:.1} um; the rig stands {most_um} um"));
    }
    warnings
}

/// What the metrics are for: a single step or sine has figures of its own.
fn task(spec: &Spec) -> Task {
    match spec.parts.as_slice() {
        [part] => match part.shape {
            Shape::Step => Task::Step { height_m: part.amplitude },
            Shape::Sine { hz } => Task::Sine { amplitude_m: part.amplitude, hz },
            _ => Task::Other,
        },
        _ => Task::Other,
    }
}

fn write_log(call: &SimulateCall, recording: &Recording, controller: Option<String>) -> Result<(), Failure> {
    let mut meta = Meta {
        rate_hz: Some(call.rate),
        latency_s: delay_s(call),
        seed: Some(call.seed.to_string()),
        controller,
        ..Meta::default()
    };
    meta.other.insert("plant".into(), output::file_name(&call.plant));
    meta.other.insert("simulated_by".into(), format!("hysteron {}", env!("CARGO_PKG_VERSION")));
    let mut columns = vec![Column::Time, Column::Command, Column::Displacement];
    let closed = !recording.reference_m.is_empty();
    if closed {
        columns.push(Column::Reference);
    }
    columns.push(Column::LimitedBy);
    let mut writer = Writer::create(&call.out, &meta, &columns)?;
    let mut row = Vec::with_capacity(columns.len());
    for k in 0..recording.command_v.len() {
        row.clear();
        row.extend([k as f64 * recording.dt_s, recording.command_v[k], recording.displacement_m[k]]);
        if closed {
            row.push(recording.reference_m[k]);
        }
        row.push(f64::from(recording.limited_by[k].bits()));
        writer.row(&row)?;
    }
    Ok(writer.finish()?)
}

/// The metrics with units, those that have a meaning.
fn readable(metrics: &LoopMetrics) -> Vec<(String, String)> {
    let rows = [
        ("rise 10-90 %", metrics.rise_ms, "ms"),
        ("overshoot", metrics.overshoot_percent, "%"),
        ("settling to 2 %", metrics.settle_2_percent_ms, "ms"),
        ("rms error", metrics.rms_error_um, "um"),
        ("rms error of amplitude", metrics.rms_error_percent, "%"),
        ("gain", metrics.gain, ""),
        ("phase", metrics.phase_deg, "deg"),
        ("peak displacement", Some(metrics.peak_um), "um"),
        ("peak command", Some(metrics.peak_v), "V"),
    ];
    rows.into_iter()
        .filter_map(|(label, value, unit)| value.map(|v| (label.to_owned(), four_digits(v, unit))))
        .collect()
}

fn page(
    call: &SimulateCall,
    model: &Model,
    recording: &Recording,
    facts: &[(String, String)],
    warnings: &[String],
) -> gap_diagnosis::page::Page {
    let micro = |values: &[f64]| values.iter().map(|v| v * 1e6).collect::<Vec<f64>>();
    let time_s: Vec<f64> = (0..recording.command_v.len()).map(|k| k as f64 * recording.dt_s).collect();
    let reference_um = micro(&recording.reference_m);
    let closed = call.drive.controller.as_ref().map(|path| format!(" with {}", output::file_name(path)));
    simulation_page(&SimulationView {
        title: if closed.is_some() { "Closed-loop simulation" } else { "Open-loop simulation" },
        subtitle: &format!("{}{}, {} Hz", model.name, closed.as_deref().unwrap_or(""), call.rate),
        headline: "",
        time_s: &time_s,
        reference_um: closed.is_some().then_some(reference_um.as_slice()),
        displacement_um: &micro(&recording.displacement_m),
        command_v: &recording.command_v,
        error_um: None,
        metrics: facts,
        warnings,
        provenance: &output::provenance(Some(call.seed)),
    })
}
