//! `hysteron hil`: the control code on a board against the simulated plant: a run directory, and what the link did.

use crate::arguments::{HilCall, spec_files};
use crate::commands::board;
use crate::commands::link::{ended, faults, go_on, heed_signals, in_fault, link_facts, open, put_back, session};
use crate::commands::loops::Free;
use crate::failure::Failure;
use crate::output;
use hil_bridge::faulty::Faulty;
use hil_bridge::link::Link;
use hil_bridge::lockstep::{Outcome, Row, idle, prepare, probe, run_on};
use hil_bridge::paced;
use hil_bridge::run_directory::{Facts, RunDirectory, RunError, check_place};
use hil_bridge::session::{Board, Session};
use hil_bridge::statistics::Statistics;
use plant_sim::chain::Chain;
use plant_sim::controller::Controller;
use plant_sim::experiment::{Bench, Program, Setup, sampled_loop};
use plant_sim::margins::assess;
use plant_sim::model::Model;
use plant_sim::spec::{Spec, Unit};
use serde_json::json;
use std::path::{Path, PathBuf};
use virtual_board::waveform::Waveform;

/// Samples of a probe: ten are slower than the 99.9 %.
const PROBES: u32 = 10_000;
/// Fewest rows that a log has, and the most that one call makes: 14 hours at 20 kHz, 50 GB.
const ROWS: std::ops::RangeInclusive<f64> = 16.0..=1e9;

/// Runs it.
pub fn hil(call: &HilCall) -> Result<(), Failure> {
    if call.probe_link {
        return probe_link(call);
    }
    let (Some(plant), Some(controller), Some(reference), Some(out)) =
        (&call.plant, &call.controller, &call.reference, &call.out)
    else {
        return Err(Failure::call("give --plant, --controller, --reference and --out, or --probe-link"));
    };
    let model = Model::read(plant)?;
    let chain = model.chain();
    let settings = board::settings(controller, call.rate)?;
    let spec = Spec::parse(reference)?;
    let program = Program::new(&spec, call.rate)?;
    if program.unit() == Some(Unit::Volt) {
        return Err(Failure::call("--reference is a displacement: give its amplitudes in um"));
    }
    let samples = match (call.seconds, program.samples()) {
        (Some(seconds), _) => (seconds * call.rate).round(),
        (None, Some(samples)) => samples as f64,
        (None, None) => return Err(Failure::call("the SPEC has no length of its own: give --seconds")),
    };
    if !ROWS.contains(&samples) {
        return Err(Failure::call(format!(
            "{samples} samples: a run has {} to {:e}; change --seconds or --rate",
            ROWS.start(),
            ROWS.end()
        )));
    }
    let waveform = Waveform::new(&spec, call.rate).map_err(|error| Failure::call(error.to_string()))?;
    let faults = faults(call.link_faults.as_deref())?;
    let (plant_file, controller_file) = (output::named(plant)?, output::named(controller)?);
    let image = call.at.image.as_deref().map(output::named).transpose()?;
    let reference_files = output::played(spec_files(std::iter::once(&spec)))?;
    check_place(out)?;

    let link =
        Faulty::new(open(&call.at, Some(&model), call.rate, call.seed, None)?, faults.unwrap_or_default(), call.seed);
    let mut session = session(&call.at, link);
    let board = session.greet()?;
    let latency_s = if call.paced { paced::latency_s(call.rate) } else { board.latency_s() };
    let mut warnings = output::about(plant, model.live_warnings());
    let free = if call.paced { Free::Neither } else { Free::Rate };
    warnings.extend(board::loop_warnings(controller, &settings, call.rate, latency_s, &model, free)?);
    heed_signals()?;
    // Idle first: of a board that does something else nothing is changed, and nothing put back.
    idle::<_, RunError>(&mut session, call.clear_fault)?;
    let own = session.parameters()?;
    let samples = samples as usize;
    let run = |session: &mut Session<Faulty<Box<dyn Link>>>| -> Result<(Outcome, usize, Vec<String>), Failure> {
        let mut ready = prepare::<_, RunError>(session, &settings, &waveform, false)?;
        let mut told = Vec::new();
        if call.paced {
            probe::<_, RunError>(session, PROBES)?;
            let asked = paced::check(session.statistics(), call.rate);
            let rate_hz = asked.map_or_else(|error| error.most_hz, |()| call.rate);
            told = loops(controller, rate_hz, paced::latency_s(rate_hz), &chain);
            if let Err(error) = asked {
                let loops = told.join(", ");
                return Err(Failure::call(format!("{error}; loops there: {loops}; lower --rate or leave --paced out")));
            }
            // The probe left the board idle, listening to its pins.
            ready = prepare::<_, RunError>(session, &settings, &waveform, false)?;
            ready.latency_s = latency_s;
        }
        let start = model.start();
        let setup = Setup { chain: &chain, start: &start, rate_hz: call.rate, samples, latency_s, seed: call.seed };
        let mut directory = RunDirectory::create(
            out,
            &Facts {
                place: &call.at.board,
                ready: &ready,
                image: image.as_ref().map(output::parts),
                plant: output::parts(&plant_file),
                controller: output::parts(&controller_file),
                reference,
                reference_files: &reference_files,
                rate_hz: call.rate,
                samples,
                seed: call.seed,
                is_paced: call.paced,
                link_faults: call.link_faults.as_deref().map(|faults| (faults, call.seed)),
            },
        )?;
        let bar = output::bar(samples as u64, "running the board");
        let report_every = (samples / 200).max(1);
        let mut rows = 0;
        let on_row = |session: &mut Session<_>, row: &Row| {
            rows = row.index + 1;
            if row.index.is_multiple_of(report_every) {
                bar.set_position(row.index as u64);
            }
            // Not before the loop runs: what starts it is not what such a run is about.
            let link: &mut Faulty<Box<dyn Link>> = session.link();
            link.switch(faults.is_some());
            let now = session.link().now();
            directory.row(row, now, session.statistics())?;
            go_on()
        };
        let mut bench = Bench::new(&setup);
        let played = if call.paced {
            paced::run(session, &ready, &mut bench, samples, on_row)
        } else {
            run_on(session, &ready, &mut bench, samples, on_row)
        };
        bar.finish_and_clear();
        let outcome = match played {
            Ok(outcome) => outcome,
            Err(error) => {
                // Why it ended matters more than that this can't be written either.
                let _ = directory.keep(session.statistics());
                return Err(ended(error, session, out));
            }
        };
        directory.finish(session.statistics(), &outcome)?;
        Ok((outcome, rows, told))
    };
    let done = run(&mut session);
    // Whatever came of it. A bad line made on purpose is none of the next call's either.
    session.link().switch(false);
    // After a fault there are fewer samples than were asked for.
    let ((outcome, samples, told), stays) = put_back(&mut session, own, &[own.with_settings(&settings)], done)?;
    if !outcome.lost.is_empty() {
        warnings.push(format!(
            "{} of {samples} samples were lost on the link, where the drive was held: another run gives other bits",
            outcome.lost.len()
        ));
    }
    if outcome.overruns > 0 {
        warnings.push(format!("{} of {samples} answers came too late: the drive was held", outcome.overruns));
    }
    if outcome.slips > 0 {
        warnings.push(format!(
            "{} of {samples} samples began late because this machine was busy: the plant's time stood still meanwhile",
            outcome.slips
        ));
    }
    if outcome.fault.is_none() {
        warnings.extend(outcome.limited.warning(samples, true));
    }
    warnings.extend(stays);
    output::warn(&warnings);
    if !call.json {
        told.iter().for_each(|line| output::line(line));
    }
    say(call, &board, session.statistics(), Some((&outcome, samples, out)));
    match outcome.fault {
        Some(fault) => Err(in_fault(fault, &out.join("log.csv"), &call.at.board)),
        None => Ok(()),
    }
}

/// What becomes of the loop with each of the controllers that lie beside `controller`, at this rate and delay.
fn loops(controller: &Path, rate_hz: f64, latency_s: f64, chain: &Chain) -> Vec<String> {
    let folder = controller.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    files.sort();
    let verdict = |path: &PathBuf| {
        // What lies there and is no controller, or none for this rate, is nobody's concern here.
        let settings = Controller::read(path).ok()?.settings(rate_hz);
        let law = sampled_loop(&settings, rate_hz, latency_s, chain);
        let told =
            assess(&chain.linear_regions().ok()?, &law).map_or_else(|error| error.to_string(), |a| a.to_string());
        Some(format!("{} {told}", output::file_name(path)))
    };
    files.iter().filter(|path| path.extension().is_some_and(|end| end == "toml")).filter_map(verdict).collect()
}

fn probe_link(call: &HilCall) -> Result<(), Failure> {
    let model = call.plant.as_deref().map(Model::read).transpose()?;
    let mut session = session(&call.at, open(&call.at, model.as_ref(), call.rate, call.seed, None)?);
    if call.clear_fault {
        idle::<_, RunError>(&mut session, true)?;
    }
    let board = probe::<_, RunError>(&mut session, PROBES)?;
    say(call, &board, session.statistics(), None);
    Ok(())
}

fn say(call: &HilCall, board: &Board, statistics: &Statistics, run: Option<(&Outcome, usize, &Path)>) {
    let mut link = statistics.json();
    if call.json {
        let mut value = json!({ "board": board.board, "firmware": board.firmware, "link": link.take() });
        if let Some((outcome, samples, _)) = run {
            value["samples"] = samples.into();
            value["lost_samples"] = outcome.lost.len().into();
            value["overruns"] = outcome.overruns.into();
            value["slips"] = outcome.slips.into();
            value["limited_samples"] = outcome.limited.samples.into();
            value["fault"] = outcome.fault.map_or("none", |fault| fault.word()).into();
            value["peak_um"] = (outcome.peak_m * 1e6).into();
        }
        return output::line(&value.to_string());
    }
    let mut facts = vec![("board".to_owned(), format!("{}, firmware {}", board.board, board.firmware))];
    facts.extend(link_facts(&link));
    if let (None, Some(hz)) = (run, statistics.paced_hz()) {
        facts.push(("in real time at most".to_owned(), format!("{hz:.0} Hz, half of 1 / (99.9 % round trip)")));
    }
    if let Some((outcome, samples, _)) = run {
        facts.push(("samples".to_owned(), samples.to_string()));
        facts.push(("peak displacement".to_owned(), format!("{:.2} um", outcome.peak_m * 1e6)));
    }
    output::facts(&facts);
    if let Some((_, _, out)) = run {
        output::line(&format!("run: {}", out.display()));
    }
}
