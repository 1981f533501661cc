//! `hysteron record`: experiments on a bench that hangs on a board's own pins, one after the other, into a run directory.

use crate::arguments::{RecordCall, spec_files};
use crate::commands::board;
use crate::commands::link::{
    ended, faults, go_on, heed_signals, in_fault, interrupted, is_asked_to_end, leaving, link_facts, open, put_back,
    session,
};
use crate::commands::loops::{Free, within_rig};
use crate::failure::Failure;
use crate::output;
use control_core::{FaultCode, Settings};
use hil_bridge::experiments::{Experiment, demagnetising};
use hil_bridge::faulty::Faulty;
use hil_bridge::link::{Link, Place};
use hil_bridge::lockstep::{LockstepError, Outcome, Ready, Row, Task, idle, prepare_task, run_on};
use hil_bridge::pins;
use hil_bridge::recording::{Facts, MOST_ROWS, Recording};
use hil_bridge::run_directory::{RunError, check_place};
use hil_bridge::session::{Board, Session};
use plant_sim::experiment::{Bench, Program, Reach, Setup, open_loop_reach};
use plant_sim::model::Model;
use plant_sim::spec::{Spec, Unit};
use serde_json::json;
use std::path::PathBuf;
use virtual_board::waveform::Waveform;
use wire::{InputSource, Parameters};

/// Fewest rows that a log has, and the most.
const ROWS: std::ops::RangeInclusive<usize> = 16..=MOST_ROWS;

/// An experiment, ready to be played.
struct Played {
    program: Program,
    waveform: Waveform,
    samples: usize,
}

/// What is read before a board is spoken to.
struct Plan {
    experiments: Vec<Experiment>,
    played: Vec<Played>,
    before: Option<(String, Played)>,
    settings: Vec<Settings>,
    controllers: Vec<(String, Vec<u8>)>,
    reference_files: Vec<(String, Vec<u8>)>,
    /// What the board is set to, as soon as it was asked.
    own: Option<Parameters>,
}

/// How far it came.
#[derive(Default)]
struct Ending {
    /// Of each experiment that was begun.
    outcomes: Vec<Outcome>,
    /// How many samples of each there are, lost ones among them: after a fault fewer than were asked for.
    samples: Vec<usize>,
    /// The fault that came while demagnetising before the one that is next.
    before: Option<FaultCode>,
}

impl Ending {
    fn is_whole(&self) -> bool {
        self.before.is_none() && self.outcomes.iter().all(|outcome| outcome.fault.is_none())
    }
}

/// Runs it.
pub fn record(call: &RecordCall) -> Result<(), Failure> {
    let mut plan = plan(call)?;
    let model = call.plant.as_deref().map(Model::read).transpose()?;
    let plant_file = call.plant.as_deref().map(output::named).transpose()?;
    let image = call.at.image.as_deref().map(output::named).transpose()?;
    let faults = faults(call.link_faults.as_deref())?;
    if call.at.board == Place::InProcess && model.is_none() {
        return Err(Failure::call("--board in-process has no pins: give --plant, which is then the bench"));
    }
    check_place(&call.out)?;

    let link = open(&call.at, model.as_ref(), call.rate, call.seed, call.anti_alias)?;
    let mut session = session(&call.at, Faulty::new(link, faults.unwrap_or_default(), call.seed));
    let board = session.greet()?;
    let mut warnings = check(call, &plan, &board, model.as_ref())?;
    heed_signals()?;
    // Idle first: of a board that does something else nothing is changed, and nothing put back.
    idle::<_, RunError>(&mut session, call.clear_fault)?;
    // What drives in open loop does so within the board's own limits, whatever controller ran before it.
    let own = session.parameters()?;
    plan.own = Some(own);
    warnings.extend(wider_limits(call, &plan, &own));
    let samples: Vec<usize> = plan.played.iter().map(|played| played.samples).collect();
    let mut bench = model.as_ref().filter(|_| call.at.board == Place::InProcess).map(|model| {
        let chain = model.chain();
        let start = model.start();
        // Latency and length are the board's; all boards have the same converters in process.
        let latency_s = board.latency_s();
        Bench::new(&Setup { chain: &chain, start: &start, rate_hz: call.rate, samples: 0, latency_s, seed: call.seed })
    });
    let mut record_all = |session: &mut Session<Faulty<Box<dyn Link>>>| -> Result<(Ending, Vec<String>), Failure> {
        // Whatever the board refuses, it refuses before there is a directory and before anything moves.
        let mut parameters = Vec::new();
        for (experiment, played) in plan.experiments.iter().zip(&plan.played) {
            let ready = prepare(call, &plan, session, experiment.controller, played)?;
            if call.at.board != Place::InProcess {
                pins::check_stream::<_, RunError>(session, &ready)?;
            }
            parameters.push(ready.parameters);
        }
        let facts = Facts {
            place: &call.at.board,
            board: &board,
            image: image.as_ref().map(output::parts),
            plant: plant_file.as_ref().map(output::parts),
            controllers: &plan.controllers,
            reference_files: &plan.reference_files,
            experiments: &plan.experiments,
            samples: &samples,
            parameters: &parameters,
            set: call.set.map(|set| set.name()),
            before: plan.before.as_ref().map(|(spec, _)| spec.as_str()),
            rate_hz: call.rate,
            seed: call.seed,
            link_faults: call.link_faults.as_deref(),
        };
        let mut recording = Recording::create(&call.out, &facts)?;
        // Now that nothing is refused any more, and before anything moves.
        output::warn(&warnings);
        let played = play(call, &plan, &facts, session, bench.as_mut(), &mut recording, faults.is_some());
        let ending = match played {
            Ok(ending) => ending,
            Err(failure) => {
                // Why it ended matters more than that this can't be written either.
                let _ = recording.keep(session.statistics());
                return Err(failure);
            }
        };
        let names = recording.names().map(str::to_owned).collect();
        if ending.is_whole() {
            recording.finish(session.statistics())?;
        } else {
            // The fault matters more than that this can't be written either.
            let _ = recording.keep(session.statistics());
        }
        Ok((ending, names))
    };
    let done = record_all(&mut session);
    // Whatever came of it.
    let mut others: Vec<Parameters> = plan.settings.iter().map(|settings| own.with_settings(settings)).collect();
    others.push(Parameters { rate_hz: call.rate as f32, ..own });
    let ((ending, names), stays) = put_back(&mut session, own, &others, done)?;
    let limited = |((experiment, outcome), (name, samples)): ((&Experiment, &Outcome), (&String, &usize))| {
        let warning = outcome.limited.warning(*samples, experiment.controller.is_some());
        warning.filter(|_| outcome.fault.is_none()).map(|warning| format!("{name}: {warning}"))
    };
    let played = plan.experiments.iter().zip(&ending.outcomes).zip(names.iter().zip(&ending.samples));
    output::warn(&played.filter_map(limited).collect::<Vec<_>>());
    output::warn(stays.as_slice());
    say(call, &board, &session.statistics().json(), &names, &ending);
    verdict(call, &names, &ending)
}

/// Reads the call's files and lays out what is to be played.
fn plan(call: &RecordCall) -> Result<Plan, Failure> {
    let mut plan = Plan {
        experiments: Vec::new(),
        played: Vec::new(),
        before: None,
        settings: Vec::new(),
        controllers: Vec::new(),
        reference_files: Vec::new(),
        own: None,
    };
    let mut stems = Vec::new();
    for path in &call.controller {
        let stem = path.file_stem().map_or_else(|| output::file_name(path), |s| s.to_string_lossy().into_owned());
        if stems.contains(&stem) {
            return Err(Failure::call(format!("--controller: two are called {stem}; rename one")));
        }
        plan.settings.push(board::settings(path, call.rate)?);
        plan.controllers.push(output::named(path)?);
        stems.push(stem);
    }
    match call.set {
        Some(set) => {
            plan.experiments = set.experiments(call.rate, &stems, call.size);
            let before = demagnetising(call.size);
            let played = lay_out(&before, call.rate)?;
            plan.before = Some((before, played));
        }
        None => {
            for (number, text) in call.spec.iter().enumerate() {
                let unit = Spec::parse(text)?.unit;
                let name =
                    |what: &str| if call.spec.len() > 1 { format!("{what}-{}", number + 1) } else { what.into() };
                if unit == Some(Unit::Micrometre) {
                    if stems.is_empty() {
                        return Err(Failure::call(format!("{text} is a displacement: give --controller")));
                    }
                    for (index, stem) in stems.iter().enumerate() {
                        let name = name(stem);
                        plan.experiments.push(Experiment { name, spec: text.clone(), controller: Some(index) });
                    }
                } else {
                    plan.experiments.push(Experiment { name: name("drive"), spec: text.clone(), controller: None });
                }
            }
        }
    }
    if !stems.is_empty() && plan.experiments.iter().all(|experiment| experiment.controller.is_none()) {
        return Err(Failure::call("--controller: nothing that is played is a reference, in um: leave it out"));
    }
    if plan.experiments.is_empty() {
        return Err(Failure::call("this set is nothing but loops: give --controller, once for each"));
    }
    let mut specs = Vec::new();
    for experiment in &plan.experiments {
        plan.played.push(lay_out(&experiment.spec, call.rate)?);
        specs.push(Spec::parse(&experiment.spec)?);
    }
    plan.reference_files = output::played(spec_files(specs.iter()))?;
    Ok(plan)
}

fn lay_out(text: &str, rate_hz: f64) -> Result<Played, Failure> {
    let spec = Spec::parse(text)?;
    let program = Program::new(&spec, rate_hz)?;
    let Some(samples) = program.samples() else {
        return Err(Failure::call(format!("{text} has no length of its own: add `,for=2s` to its last part")));
    };
    if !ROWS.contains(&samples) {
        return Err(Failure::call(format!(
            "{text}: {samples} samples; a log has {} to {}: change its length or --rate",
            ROWS.start(),
            ROWS.end()
        )));
    }
    let waveform = Waveform::new(&spec, rate_hz).map_err(|error| Failure::call(format!("{text}: {error}")))?;
    Ok(Played { program, waveform, samples })
}

/// Refuses loops that can't be stable or may go beyond what the stage stands, and drives that would; what there is to warn of.
fn check(call: &RecordCall, plan: &Plan, board: &Board, model: Option<&Model>) -> Result<Vec<String>, Failure> {
    let (Some(model), Some(path)) = (model, &call.plant) else {
        let loops = plan.settings.first().map(|_| "whether the loops are stable").into_iter();
        let unchecked: Vec<&str> = loops.chain(["whether the stage stands what is played"]).collect();
        return Ok(vec![format!("no --plant: {} was not checked", unchecked.join(" and "))]);
    };
    let mut warnings = output::about(path, model.live_warnings());
    let latency_s = board.latency_s();
    for (path, settings) in call.controller.iter().zip(&plan.settings) {
        warnings.extend(board::loop_warnings(path, settings, call.rate, latency_s, model, Free::Rate)?);
    }
    let Some(rig) = &model.rig else {
        warnings.push("--plant has no [rig]: whether the stage stands what is played was not checked".into());
        return Ok(warnings);
    };
    // A trip stops the drive, and no mass at once: what drives far in open loop must not begin.
    let (chain, most_um) = (model.chain(), rig.displacement_max_um.value);
    let start = model.start();
    let experiments =
        plan.experiments.iter().zip(&plan.played).filter(|(experiment, _)| experiment.controller.is_none());
    let driven = experiments.map(|(experiment, played)| (&experiment.spec, played));
    let before = plan.before.iter().map(|(spec, played)| (spec, played));
    for (spec, Played { program, samples, .. }) in before.chain(driven) {
        let (samples, seed) = (*samples, call.seed);
        let setup = Setup { chain: &chain, start: &start, rate_hz: call.rate, samples, latency_s, seed };
        let Reach { command_v, peak_m } = open_loop_reach(&setup, program)?;
        if !rig.stands(command_v) {
            let ([low_v, high_v], [lowest_v, highest_v]) = (command_v, rig.drive_v());
            return Err(Failure::call(format!(
                "{spec}: it would drive from {low_v:.1} to {high_v:.1} V, and the [rig] of --plant stands {lowest_v} to {highest_v} V: lower the volts (a set's with --size)"
            )));
        }
        let peak_um = 1e6 * peak_m;
        if peak_um > most_um {
            return Err(Failure::call(format!(
                "{spec}: it would take the stage to {peak_um:.0} um, and the [rig] of --plant stands {most_um} um: lower the volts (a set's with --size)"
            )));
        }
    }
    for (path, settings) in call.controller.iter().zip(&plan.settings) {
        within_rig(path, rig, settings)?;
    }
    Ok(warnings)
}

/// Controllers whose limits, which hold while their loops run, are wider than what the board itself is set to.
fn wider_limits(call: &RecordCall, plan: &Plan, own: &Parameters) -> Vec<String> {
    let told = |of: &Parameters| {
        let [clamp_um, trip_um] = [of.reference_max_m, of.trip_m].map(|m| m * 1e6);
        let Parameters { drive_min_v, drive_max_v, slew_v_per_s, .. } = of;
        format!("{drive_min_v} to {drive_max_v} V, {slew_v_per_s} V/s, clamp {clamp_um:.2} um and trip {trip_um:.2} um")
    };
    let wider = |(path, settings): (&PathBuf, &Settings)| {
        let set = own.with_settings(settings);
        let is_wider = set.drive_min_v < own.drive_min_v
            || [
                [set.drive_max_v, own.drive_max_v],
                [set.slew_v_per_s, own.slew_v_per_s],
                [set.reference_max_m, own.reference_max_m],
                [set.trip_m, own.trip_m],
            ]
            .iter()
            .any(|[set, own]| set > own);
        is_wider.then(|| {
            format!(
                "{}: its limits, {}, hold in closed loop in place of the board's narrower ones, {}",
                path.display(),
                told(&set),
                told(own)
            )
        })
    };
    call.controller.iter().zip(&plan.settings).filter_map(wider).collect()
}

fn prepare<L: Link>(
    call: &RecordCall,
    plan: &Plan,
    session: &mut Session<L>,
    controller: Option<usize>,
    played: &Played,
) -> Result<Ready, LockstepError<RunError>> {
    let task = Task {
        own: plan.own,
        settings: controller.map(|index| &plan.settings[index]),
        rate_hz: call.rate,
        waveform: &played.waveform,
        is_closed_loop: controller.is_some(),
        input: if call.at.board == Place::InProcess { InputSource::Bridge } else { InputSource::Analog },
    };
    prepare_task(session, &task, false)
}

/// Plays and writes down one experiment after the other; a fault ends it early.
fn play<L: Link>(
    call: &RecordCall,
    plan: &Plan,
    facts: &Facts<'_>,
    session: &mut Session<Faulty<L>>,
    mut bench: Option<&mut Bench>,
    recording: &mut Recording,
    is_faulty: bool,
) -> Result<Ending, Failure> {
    let total: usize = plan.played.iter().map(|played| played.samples).sum();
    let bar = output::bar(total as u64, "recording");
    let mut ending = Ending::default();
    let mut done = 0;
    for (index, (experiment, played)) in plan.experiments.iter().zip(&plan.played).enumerate() {
        if let Some((_, before)) = &plan.before {
            let ready = prepare(call, plan, session, None, before)?;
            let demagnetised = run(session, &ready, bench.as_deref_mut(), before.samples, |_, _| go_on());
            ending.before = demagnetised.map_err(|error| ended(error, session, &call.out))?.fault;
            if ending.before.is_some() {
                break;
            }
        }
        // Nothing moves any more for who was asked to end meanwhile.
        if is_asked_to_end() {
            return Err(interrupted(session, &call.out));
        }
        let ready = prepare(call, plan, session, experiment.controller, played)?;
        recording.begin(index, &ready, facts)?;
        let mut rows = 0;
        let outcome = run(session, &ready, bench.as_deref_mut(), played.samples, |session, row| {
            rows = row.index + 1;
            if row.index.is_multiple_of(1000) {
                bar.set_position((done + row.index) as u64);
            }
            // Not before the loop runs: what starts it is not what such a run is about.
            session.link().switch(is_faulty);
            let now = session.link().now();
            recording.row(index, row, now, session.statistics())?;
            go_on()
        });
        session.link().switch(false);
        let outcome = outcome.map_err(|error| ended(error, session, &call.out))?;
        recording.end(index, session.statistics(), &outcome)?;
        done += played.samples;
        let is_over = outcome.fault.is_some();
        // The last ones may be lost.
        ending.samples.push(outcome.lost.last().map_or(rows, |lost| rows.max(lost + 1)));
        ending.outcomes.push(outcome);
        if is_over {
            break;
        }
    }
    bar.finish_and_clear();
    Ok(ending)
}

/// Through the board's pins, or with the plant of a bench in process.
fn run<L: Link>(
    session: &mut Session<Faulty<L>>,
    ready: &Ready,
    bench: Option<&mut Bench>,
    samples: usize,
    on_row: impl FnMut(&mut Session<Faulty<L>>, &Row) -> Result<(), RunError>,
) -> Result<Outcome, LockstepError<RunError>> {
    match bench {
        Some(bench) => run_on(session, ready, bench, samples, on_row),
        None => pins::run(session, ready, samples, on_row),
    }
}

/// A log with a hole, or a board in its fault, is no success.
fn verdict(call: &RecordCall, names: &[String], ending: &Ending) -> Result<(), Failure> {
    let outcomes = &ending.outcomes;
    if let (Some(fault), Some(name)) = (ending.before, names.get(outcomes.len())) {
        return Err(Failure::hardware(format!(
            "the board is in {fault}, at 0 V: it came while demagnetising before {}, which was not begun; {}",
            call.out.join(name).display(),
            leaving(&call.at.board)
        )));
    }
    let last = outcomes.last().zip(names.get(outcomes.len().saturating_sub(1)));
    if let Some((Some(fault), name)) = last.map(|(outcome, name)| (outcome.fault, name)) {
        return Err(in_fault(fault, &call.out.join(name), &call.at.board));
    }
    // In process a lost sample is a row like any other, whose drive was held.
    let has_holes = call.at.board != Place::InProcess;
    let holed = outcomes.iter().zip(names).find(|(outcome, _)| has_holes && !outcome.lost.is_empty());
    match holed {
        Some((outcome, name)) => Err(Failure::hardware(format!(
            "{} of the samples of {} were lost on the link, which identify and diagnose will not take: link.json names them; record again over a better one",
            outcome.lost.len(),
            call.out.join(name).display()
        ))),
        None => Ok(()),
    }
}

fn say(call: &RecordCall, board: &Board, link: &serde_json::Value, names: &[String], ending: &Ending) {
    let Ending { outcomes, samples, .. } = ending;
    if call.json {
        let log = |((name, outcome), samples): ((&String, &Outcome), &usize)| {
            json!({
                "log": name,
                "samples": samples,
                "lost_samples": outcome.lost.len(),
                "overruns": outcome.overruns,
                "limited_samples": outcome.limited.samples,
                "fault": outcome.fault.map_or("none", |fault| fault.word()),
                "peak_um": outcome.peak_m * 1e6,
            })
        };
        let logs: Vec<_> = names.iter().zip(outcomes).zip(samples).map(log).collect();
        let value = json!({ "board": board.board, "firmware": board.firmware, "link": link, "logs": logs });
        return output::line(&value.to_string());
    }
    let mut facts = vec![("board".to_owned(), format!("{}, firmware {}", board.board, board.firmware))];
    for ((name, outcome), samples) in names.iter().zip(outcomes).zip(samples) {
        let told = format!(
            "{samples} samples, {} lost, {} late, at most {:.2} um",
            outcome.lost.len(),
            outcome.overruns,
            outcome.peak_m * 1e6
        );
        facts.push((name.clone(), told));
    }
    facts.extend(link_facts(link));
    output::facts(&facts);
    output::line(&format!("run: {}", call.out.display()));
}
