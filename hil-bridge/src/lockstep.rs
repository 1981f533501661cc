//! Hardware in the loop, one sample after the other: the simulated plant's measurement to the board, the board's drive to the plant.
//!
//! The plant moves only between an answer and the next sample, so that it does not matter how long an answer takes. What the board would do
//! in time is in the plant instead: the drive comes its latch after the sample. A sample that is lost on the link leaves the drive as it
//! was, as a missed latch does on a bench.

use crate::link::Link;
use crate::pins::samples_to_rest;
use crate::session::{Board, Session, SessionError};
use control_core::{AdcCode, DacCode, FaultCode, Limits, ModeName, Settings};
use plant_sim::experiment::{Bench, Setup};
use plant_sim::metrics::Limited;
use virtual_board::waveform::Waveform;
use wire::{Checked, InputSource, ParameterError, Parameters, Status, ToBoard};

/// How often a set is given back to a board that does not answer.
const ATTEMPTS: u32 = 3;

/// Why there is no run, or only a part of one.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum LockstepError<E> {
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error("the board refuses: {0}")]
    Parameters(ParameterError),
    #[error("the board is {mode}, driving its own pins: stop it first (`hysteron board stop`)")]
    Busy { mode: &'static str },
    #[error("the board is in a fault, {fault}: {advice}")]
    InFault { fault: String, advice: &'static str },
    #[error("the link carries every {every}th sample only: lower --rate to {most_hz:.0} Hz or less")]
    LinkTooSlow { every: u16, most_hz: f64 },
    /// What the caller does with a row failed.
    #[error("{0}")]
    Row(E),
}

/// A board that is ready to be armed.
#[derive(Clone, Debug)]
pub struct Ready {
    /// Who it is.
    pub board: Board,
    /// What it is set to.
    pub parameters: Parameters,
    /// The same, as its loop uses it.
    pub checked: Checked,
    /// From sample to drive, seconds.
    pub latency_s: f64,
}

/// One sample of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Which, from 0.
    pub index: usize,
    /// Displacement as the board's ADC has it.
    pub displacement_m: f64,
    /// Command as the board's DAC has it, from this sample's latch on.
    pub command_v: f64,
    /// Reference in use.
    pub reference_m: f64,
    /// Volts that the amplifier's monitor shows at this sample: the command of the one before. `None` where the plant is simulated here.
    pub monitor_v: Option<f64>,
    /// Which limits acted.
    pub limited_by: Limits,
    /// The sample or its answer was lost; everything but the displacement is that of the sample before.
    pub is_lost: bool,
}

impl Row {
    /// What holds before the first sample.
    pub const BEFORE: Row = Row {
        index: 0,
        displacement_m: 0.0,
        command_v: 0.0,
        reference_m: 0.0,
        monitor_v: None,
        limited_by: Limits::NONE,
        is_lost: false,
    };
}

/// How a run ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Samples whose exchange was lost.
    pub lost: Vec<usize>,
    /// Samples whose drive came too late for its latch.
    pub overruns: usize,
    /// Samples of a loop in real time that began more than half a sample late, and not because of the link: this machine was elsewhere.
    pub slips: usize,
    /// The fault that the board ended in.
    pub fault: Option<FaultCode>,
    /// What held drive or reference back.
    pub limited: Limited,
    /// Largest magnitude of the displacement at any sample, metres: of a simulated plant the true one, on a board's own pins what its sensor read.
    pub peak_m: f64,
}

/// What a board is to do.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// What the settings go over; the set in force where `None`.
    pub own: Option<Parameters>,
    /// Its law's settings; those of the set where `None`.
    pub settings: Option<&'a Settings>,
    /// Samples per second.
    pub rate_hz: f64,
    /// What it plays.
    pub waveform: &'a Waveform,
    /// The waveform is a reference, in metres; else a drive, in volts.
    pub is_closed_loop: bool,
    /// Where the displacement comes from.
    pub input: InputSource,
}

/// The handshake, the law's settings and the waveform of a reference over the bridge: everything up to arming.
///
/// # Errors
/// [`LockstepError`]; nothing has moved then.
pub fn prepare<L: Link, E>(
    session: &mut Session<L>,
    settings: &Settings,
    waveform: &Waveform,
    clear_fault: bool,
) -> Result<Ready, LockstepError<E>> {
    let rate_hz = f64::from(settings.rate_hz);
    let input = InputSource::Bridge;
    let task = Task { own: None, settings: Some(settings), rate_hz, waveform, is_closed_loop: true, input };
    prepare_task(session, &task, clear_fault)
}

/// As [`prepare`], for any task.
///
/// # Errors
/// [`LockstepError`]; nothing has moved then.
pub fn prepare_task<L: Link, E>(
    session: &mut Session<L>,
    task: &Task<'_>,
    clear_fault: bool,
) -> Result<Ready, LockstepError<E>> {
    let board = idle(session, clear_fault)?;
    let parameters = match task.own {
        Some(parameters) => parameters,
        None => session.parameters()?,
    };
    let parameters = match task.settings {
        Some(settings) => parameters.with_settings(settings),
        None => Parameters { rate_hz: task.rate_hz as f32, ..parameters },
    };
    let checked = parameters.check(&board.converters).map_err(LockstepError::Parameters)?;
    session.order(&ToBoard::SetParameters(parameters))?;
    task.waveform.send(task.is_closed_loop, |request| session.order(request))?;
    session.order(&ToBoard::Input(task.input))?;
    let latency_s = board.latency_s();
    Ok(Ready { board, parameters, checked, latency_s })
}

/// Gives a board its own set back, however a run ended: the limits of its controller are none of who comes next. In its fault a board takes another
/// law and no other rate; everybody sets that for himself, and it stays at `rate_hz` then, what it is set to.
///
/// # Errors
/// [`SessionError`]: the limits stay.
pub fn put_back<L: Link>(session: &mut Session<L>, own: Parameters, rate_hz: f32) -> Result<(), SessionError> {
    let mut give = |set: Parameters| {
        let mut done = session.order(&ToBoard::SetParameters(set));
        // Heard twice it is the same set.
        for _ in 1..ATTEMPTS {
            let Err(SessionError::Silent { .. }) = done else { break };
            done = session.order(&ToBoard::SetParameters(set));
        }
        done
    };
    match give(own) {
        Err(SessionError::Refused { .. }) => give(Parameters { rate_hz, ..own }),
        done => done,
    }
}

/// Measures a link: `samples` over the bridge to a board that stays idle. What came of it is in the session's statistics.
///
/// # Errors
/// [`LockstepError`]; nothing has moved then.
pub fn probe<L: Link, E>(session: &mut Session<L>, samples: u32) -> Result<Board, LockstepError<E>> {
    let board = idle(session, false)?;
    let checked = session.parameters()?.check(&board.converters).map_err(LockstepError::Parameters)?;
    session.order(&ToBoard::Input(InputSource::Bridge))?;
    let AdcCode(zero) = checked.calibration.adc_code(0.0);
    let monitor = checked.monitor_code(0.0, &board.converters);
    for _ in 0..samples {
        session.exchange(zero, monitor)?;
    }
    session.order(&ToBoard::Input(InputSource::Analog))?;
    Ok(board)
}

/// The handshake with a board that is idle then: out of a run over the bridge that its host did not end, and out of a fault, if that is allowed and
/// the board's own parameters and clock are those of its bench.
///
/// # Errors
/// [`LockstepError`]; one that drives its own pins goes on.
pub fn idle<L: Link, E>(session: &mut Session<L>, clear_fault: bool) -> Result<Board, LockstepError<E>> {
    let is_as_set = |fault| !matches!(fault, FaultCode::ParameterStore | FaultCode::Clock);
    idle_from(session, |fault| clear_fault && is_as_set(fault))
}

/// The same for who then sets the parameters, which may be those of the image.
///
/// # Errors
/// As [`idle`].
pub fn idle_to_set<L: Link, E>(session: &mut Session<L>, clear_fault: bool) -> Result<Board, LockstepError<E>> {
    idle_from(session, |fault| clear_fault && fault != FaultCode::Clock)
}

fn idle_from<L: Link, E>(
    session: &mut Session<L>,
    may_leave: impl Fn(FaultCode) -> bool,
) -> Result<Board, LockstepError<E>> {
    let board = session.greet()?;
    let status = session.status()?;
    if status.mode != ModeName::Idle as u8 {
        free(session, &board, &status, may_leave)?;
    }
    // Of a host that was killed; a board in process has no stream to stop.
    match session.stop_stream() {
        Ok(()) | Err(SessionError::Refused { .. }) => Ok(board),
        Err(error) => Err(error.into()),
    }
}

/// To idle: out of a run over the bridge that its host did not end, and out of a fault, if that is allowed.
fn free<L: Link, E>(
    session: &mut Session<L>,
    board: &Board,
    status: &Status,
    may_leave: impl Fn(FaultCode) -> bool,
) -> Result<(), LockstepError<E>> {
    let fault = FaultCode::from_number(status.fault);
    if let Some(fault) = fault.filter(|fault| !may_leave(*fault)) {
        return Err(in_fault(fault));
    }
    let is_bridged = status.input == InputSource::Bridge;
    if fault.is_none() {
        if !is_bridged {
            let words = ["idle", "armed", "running", "stopping", "in its fault mode"];
            return Err(LockstepError::Busy { mode: words.get(usize::from(status.mode)).unwrap_or(&"busy") });
        }
        if status.mode != ModeName::Stopping as u8 {
            session.stop()?;
        }
    }
    if is_bridged {
        // Over the bridge only the host's samples move the ramp on. Nothing hangs on them: the DAC is at its safe level.
        let parameters = session.parameters()?;
        let checked = parameters.check(&board.converters).map_err(LockstepError::Parameters)?;
        let AdcCode(zero) = checked.calibration.adc_code(0.0);
        let (mut drive_v, mut is_at_rest) = (0.0, false);
        for _ in 0..samples_to_rest(&parameters) {
            let monitor = checked.monitor_code(drive_v, &board.converters);
            let Some(drive) = session.exchange(zero, monitor)? else { continue };
            drive_v = drive.drive_v;
            is_at_rest = is_safe(drive.mode, f64::from(drive_v)) || drive.mode == ModeName::Idle as u8;
            if is_at_rest {
                break;
            }
        }
        if !is_at_rest {
            return Err(SessionError::NotAtRest.into());
        }
    }
    if fault.is_some() {
        session.order(&ToBoard::ClearFault)?;
    }
    Ok(())
}

/// Whether a board in this mode has come to 0 V because of a fault.
pub fn is_safe(mode: u8, command_v: f64) -> bool {
    mode == ModeName::Fault as u8 && command_v == 0.0
}

fn in_fault<E>(fault: FaultCode) -> LockstepError<E> {
    let advice = match fault {
        FaultCode::ParameterStore => {
            "what it had stored can't be read, and it has its image's numbers, the sensor's too: give it yours with `hysteron board parameters --clear-fault --set .. --save`"
        }
        FaultCode::Clock => "its crystal does not run, and its clock may be 1 % off: mend it, then reset the board",
        _ => "see to its cause, then repeat the call with --clear-fault",
    };
    LockstepError::InFault { fault: fault.word().replace('_', " "), advice }
}

/// Starts the loop of a prepared board in its two actions. A fault that is there once it is armed, such as an open stop chain, is told by its name
/// and not as the action that is refused for it.
pub(crate) fn start<L: Link, E>(session: &mut Session<L>) -> Result<(), LockstepError<E>> {
    let started = session.order(&ToBoard::Arm).and_then(|()| session.order(&ToBoard::Run));
    if let Err(SessionError::Refused { .. }) = &started
        && let Some(fault) = FaultCode::from_number(session.status()?.fault)
    {
        return Err(in_fault(fault));
    }
    Ok(started?)
}

/// Runs a prepared board against the plant; `setup`'s latency is [`Ready::latency_s`]. Each row is given to `on_row` as it is made; if that fails,
/// the board is stopped and the failure returned. The board ends idle or in its fault, at 0 V; after a fault the rows end where 0 V are reached.
///
/// # Errors
/// [`LockstepError`]. A fault of the board is none, the outcome says it.
pub fn run<L: Link, E>(
    session: &mut Session<L>,
    ready: &Ready,
    setup: &Setup<'_>,
    on_row: impl FnMut(&mut Session<L>, &Row) -> Result<(), E>,
) -> Result<Outcome, LockstepError<E>> {
    run_on(session, ready, &mut Bench::new(setup), setup.samples, on_row)
}

/// As [`run`], with a plant that goes on from where it is: how several experiments follow one another.
///
/// # Errors
/// As [`run`].
pub fn run_on<L: Link, E>(
    session: &mut Session<L>,
    ready: &Ready,
    bench: &mut Bench,
    samples: usize,
    on_row: impl FnMut(&mut Session<L>, &Row) -> Result<(), E>,
) -> Result<Outcome, LockstepError<E>> {
    let at_once =
        |session: &mut Session<L>, bench: &mut Bench, last: &Row, _: &mut Outcome| sample(session, ready, bench, last);
    play(session, ready, bench, samples, at_once, on_row)
}

/// The loop of a run, whenever its samples are due: `next` makes the row after the one it is given, numbered as it, and tells the mode, as [`sample`].
pub(crate) fn play<L: Link, E>(
    session: &mut Session<L>,
    ready: &Ready,
    bench: &mut Bench,
    samples: usize,
    mut next: impl FnMut(&mut Session<L>, &mut Bench, &Row, &mut Outcome) -> Result<(Row, Option<u8>), SessionError>,
    mut on_row: impl FnMut(&mut Session<L>, &Row) -> Result<(), E>,
) -> Result<Outcome, LockstepError<E>> {
    let mut outcome = Outcome::default();
    start(session)?;
    let mut last = Row::BEFORE;
    for index in 0..samples {
        let (row, mode) = next(session, bench, &Row { index, ..last }, &mut outcome)?;
        outcome.peak_m = outcome.peak_m.max(bench.moved_m().abs());
        if row.is_lost {
            outcome.lost.push(index);
        } else {
            outcome.limited.count(row.limited_by);
        }
        if let Err(error) = on_row(session, &row) {
            // The first failure is the one to tell.
            let _ = end(session, ready, bench, &row);
            return Err(LockstepError::Row(error));
        }
        bench.apply(row.command_v);
        last = row;
        if mode.is_some_and(|mode| is_safe(mode, row.command_v)) {
            break;
        }
    }
    outcome.fault = FaultCode::from_number(session.status()?.fault);
    end(session, ready, bench, &last)?;
    Ok(outcome)
}

/// One sample for whoever keeps the loop going by hand: reads the plant and asks the board. The row, numbered as `last`, and the mode
/// that the board answered, if it did. [`Bench::apply`] of the row's command moves the plant on.
///
/// # Errors
/// [`SessionError`].
pub fn sample<L: Link>(
    session: &mut Session<L>,
    ready: &Ready,
    bench: &mut Bench,
    last: &Row,
) -> Result<(Row, Option<u8>), SessionError> {
    let calibration = &ready.checked.calibration;
    let AdcCode(displacement) = calibration.adc_code(bench.read_m() as f32);
    let monitor = ready.checked.monitor_code(bench.held_v() as f32, &ready.board.converters);
    let displacement_m = f64::from(calibration.displacement_m(AdcCode(displacement)));
    Ok(match session.exchange(displacement, monitor)? {
        Some(drive) => {
            let row = Row {
                index: last.index,
                displacement_m,
                command_v: f64::from(calibration.drive_v(DacCode(drive.code))),
                reference_m: f64::from(drive.reference_m),
                monitor_v: None,
                limited_by: drive.limited_by,
                is_lost: false,
            };
            (row, Some(drive.mode))
        }
        None => (Row { displacement_m, is_lost: true, ..*last }, None),
    })
}

/// Stops the loop and goes on until the board is at 0 V, so that the next run finds it idle. One that does not come there is an error.
pub(crate) fn end<L: Link>(
    session: &mut Session<L>,
    ready: &Ready,
    bench: &mut Bench,
    last: &Row,
) -> Result<(), SessionError> {
    // In its fault mode the board is on its way already.
    let is_faulted = session.status()?.fault != 0;
    if !is_faulted {
        session.stop()?;
    }
    let mut last = *last;
    for _ in 0..samples_to_rest(&ready.parameters) {
        let (row, mode) = sample(session, ready, bench, &last)?;
        if mode == Some(ModeName::Idle as u8) {
            // A convenience for whoever comes next, who does the same: not worth a failure on a bad line.
            return match session.order(&ToBoard::Input(InputSource::Analog)) {
                Err(SessionError::Silent { .. }) => Ok(()),
                done => done,
            };
        }
        if mode.is_some_and(|mode| is_safe(mode, row.command_v)) {
            return Ok(());
        }
        bench.apply(row.command_v);
        last = row;
    }
    Err(SessionError::NotAtRest)
}
