//! The engine's thread: samples and pace. Beside it: [`orders`], the experiment [`set`], and what is [`publish`]ed.
//!
//! A chunk of samples lasts a few milliseconds, then orders are looked after: so a stop waits no longer than that. What takes longer (the margins of
//! a new set, a diagnosis) is done in threads beside this one. Where the link is slower than wall time
//! the loop runs as fast as it goes and says how fast that is; it never hurries afterwards to make up for it.

mod orders;
mod publish;
mod set;

use super::model::{Twin, judge, within_rig};
use super::{Order, Pass, Setting, Shared, StartError};
use crate::history::{CHANNELS, Column};
use crate::recorder::Recorder;
use control_core::{FaultCode, Generator, GeneratorState, ModeName, Segment};
use hil_bridge::link::Link;
use hil_bridge::lockstep::{LockstepError, Ready, Row, idle, is_safe, prepare, put_back, sample};
use hil_bridge::recording::MOST_ROWS;
use hil_bridge::run_directory::RunError;
use hil_bridge::session::{Session, SessionError};
use hil_bridge::statistics::Histogram;
use plant_sim::experiment::{Bench, Setup};
use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;
use virtual_board::waveform::Waveform;
use wire::{Parameters, Status, ToBoard};

/// Longest time between two looks at the orders.
const CHUNK: Duration = Duration::from_millis(8);
/// Values of a waveform that are made at once.
const AHEAD: usize = 256;
/// A loop that is behind wall time by so much has lost it, and does not run after it.
const BEHIND: Duration = Duration::from_millis(100);
/// How often the state of the moment is published.
const STATUS: Duration = Duration::from_millis(100);
/// How often the board is asked for its own account.
const ACCOUNT: Duration = Duration::from_millis(500);

type Conversation = Session<Box<dyn Link>>;
type BoardError = LockstepError<RunError>;
type Answer = oneshot::Sender<Result<String, String>>;

/// A board that answers, and the bench that it drives.
struct Line {
    session: Conversation,
    /// What it was set to before a controller's set was put over it.
    own: Parameters,
    ready: Ready,
    bench: Bench,
    /// Seed of the bench's noise.
    seed: u64,
    last: Row,
    mode: u8,
    account: Status,
}

impl Line {
    /// Whether nothing moves by itself: idle, or at 0 V because of a fault.
    fn is_at_rest(&self) -> bool {
        self.mode == ModeName::Idle as u8 || is_safe(self.mode, self.last.command_v)
    }
}

/// What plays.
struct Play {
    text: String,
    waveform: Waveform,
    is_closed_loop: bool,
}

/// A waveform that began while the loop ran: the board takes none then, so it is told every new value.
struct Hosted {
    waveform: Waveform,
    is_closed_loop: bool,
    state: GeneratorState,
    /// Values that were made ahead.
    ahead: VecDeque<f32>,
    told: Option<f32>,
}

impl Hosted {
    fn next(&mut self, rate_hz: f32) -> Option<f32> {
        if self.ahead.is_empty() {
            // A table is looked through as a segment is built, so that is not done for every sample.
            let segments = self.waveform.segments.iter();
            let built: Vec<Segment<'_>> =
                segments.filter_map(|segment| segment.build(rate_hz, &self.waveform.table).ok()).collect();
            let generator = Generator::new(&built);
            self.ahead.extend((0..AHEAD).map(|_| generator.next(&mut self.state)));
        }
        self.ahead.pop_front()
    }
}

/// Samples and wall time that belong together.
struct Pace {
    at: Instant,
    samples: u64,
    /// Samples and times of the last second, for the speed that is shown.
    marks: VecDeque<(Instant, u64)>,
}

struct Worker<'a> {
    setting: Setting,
    shared: &'a Arc<Shared>,
    orders: &'a mpsc::Receiver<Order>,
    line: Option<Line>,
    /// Why there is no line.
    lost: Option<String>,
    /// Of a board that was lost: its own set, and the one that it was left with.
    left: Option<[Parameters; 2]>,
    twin: Twin,
    play: Play,
    hosted: Option<Hosted>,
    undo: Vec<Parameters>,
    recorder: Option<Recorder>,
    passes: Vec<Pass>,
    /// Squared gap and rows since it was last taken.
    gap: (f64, u64),
    /// The same since each of the last statuses, for the number that is shown.
    recent_gap: VecDeque<(f64, u64)>,
    is_set_running: bool,
    is_set_stopped: bool,
    /// A new set's margins are being computed: what else is asked for meanwhile would meet a set that may be another one at once.
    is_judging: bool,
    samples: u64,
    pace: Pace,
    turn: Histogram,
    lamps: [Option<Instant>; 8],
    fault: Option<FaultCode>,
    published: Instant,
    asked: Instant,
    version: u64,
    events: u64,
    /// Statuses published: a page sees by it that the engine still works.
    statuses: u64,
    has_left: bool,
}

/// Finds the board, says so, and works until nobody can ask any more.
pub fn work(
    setting: Setting,
    shared: &Arc<Shared>,
    orders: &mpsc::Receiver<Order>,
    begun: &mpsc::Sender<Result<(), StartError>>,
) {
    match Worker::new(setting, shared, orders) {
        Ok(mut worker) => {
            worker.publish();
            // Whoever started us and is gone needs no engine.
            if begun.send(Ok(())).is_ok() {
                worker.work();
            }
        }
        Err(error) => {
            let _ = begun.send(Err(error));
        }
    }
}

impl<'a> Worker<'a> {
    fn new(
        setting: Setting,
        shared: &'a Arc<Shared>,
        orders: &'a mpsc::Receiver<Order>,
    ) -> Result<Worker<'a>, StartError> {
        let mut line = connect(&setting, setting.clear_fault, None)?;
        let twin = Twin::new(&setting.plant.model, setting.rate_hz, line.ready.latency_s);
        let judged = judge(&twin.chain, &setting.controller.1, line.ready.latency_s);
        if !matches!(judged, Ok(Ok(_))) {
            // The refusal is what there is to tell.
            let _ = put_back(&mut line.session, line.own, line.ready.parameters.rate_hz);
        }
        let warning = judged?.map_err(StartError::Unstable)?;
        let now = Instant::now();
        let mut worker = Worker {
            setting,
            shared,
            orders,
            line: Some(line),
            lost: None,
            left: None,
            twin,
            play: Play { text: "zero".to_owned(), waveform: Waveform::default(), is_closed_loop: true },
            hosted: None,
            undo: Vec::new(),
            recorder: None,
            passes: Vec::new(),
            gap: (0.0, 0),
            recent_gap: VecDeque::from([(0.0, 0)]),
            is_set_running: false,
            is_set_stopped: false,
            is_judging: false,
            samples: 0,
            pace: Pace { at: now, samples: 0, marks: VecDeque::new() },
            turn: Histogram::default(),
            lamps: [None; 8],
            fault: None,
            published: now,
            asked: now,
            version: 0,
            events: 0,
            statuses: 0,
            has_left: false,
        };
        worker.play = worker.laid_out("step:20um").unwrap_or(worker.play);
        worker.event(false, format!("{} is ready", worker.setting.place));
        // Whoever starts this has chosen the controller's file: it is warned of. A page's set is refused.
        let beyond = within_rig(&worker.setting.plant, &worker.setting.controller.1).err();
        for warning in [warning, beyond].into_iter().flatten() {
            worker.event(true, warning);
        }
        Ok(worker)
    }

    fn work(&mut self) {
        loop {
            let wait = self.wait();
            match self.orders.recv_timeout(wait) {
                Ok(order) => self.obey(order),
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => {
                    // Nobody is left to be told.
                    let _ = self.leave();
                    return;
                }
            }
            self.go_on();
            if self.has_left {
                return;
            }
        }
    }

    /// Orders that have come, samples that are due, the state of the moment.
    fn go_on(&mut self) {
        while let Ok(order) = self.orders.try_recv() {
            self.obey(order);
        }
        if self.has_left {
            return;
        }
        self.end_forgotten();
        if !self.is_resting() {
            let due = self.due();
            self.chunk(due);
        }
        self.look_at_diagnosis();
        if self.published.elapsed() >= STATUS {
            self.publish();
        }
    }

    /// Ends a recording of a board at rest that nobody looks at, and one as long as any: it would go on until the disk is full.
    fn end_forgotten(&mut self) {
        let Some(recorder) = &self.recorder else { return };
        let is_at_rest = self.line.as_ref().is_none_or(Line::is_at_rest);
        let is_seen = self.shared.watchers.load(Ordering::Relaxed) > 0;
        let is_long = recorder.rows >= MOST_ROWS;
        if is_long || is_at_rest && !is_seen && !self.is_set_running {
            let why = if is_long { "is as long as one may be" } else { "was left by every page" };
            self.event(false, format!("the recording {why}, and ends"));
            let _ = self.end_recording(None);
        }
    }

    /// Whether nothing has to move: no board, or one at rest that nobody looks at.
    fn is_resting(&self) -> bool {
        let Some(line) = &self.line else { return true };
        line.is_at_rest() && self.recorder.is_none() && self.shared.watchers.load(Ordering::Relaxed) == 0
    }

    /// Samples that wall time asks for.
    fn due(&mut self) -> u64 {
        let rate_hz = self.setting.rate_hz;
        let due = (self.pace.at.elapsed().as_secs_f64() * rate_hz) as u64 + self.pace.samples;
        let slack = (BEHIND.as_secs_f64() * rate_hz) as u64;
        // Behind, because the link is slow, or ahead, after a set that ran as fast as it could: wall time begins anew.
        if self.samples.abs_diff(due) > slack {
            self.begin_pace();
            return (CHUNK.as_secs_f64() * rate_hz) as u64;
        }
        due.saturating_sub(self.samples)
    }

    /// From here on samples belong to wall time.
    fn begin_pace(&mut self) {
        self.pace.at = Instant::now();
        self.pace.samples = self.samples;
    }

    /// Time until the next samples are due.
    fn wait(&mut self) -> Duration {
        if self.is_resting() {
            self.begin_pace();
            return STATUS;
        }
        if self.due() > 0 { Duration::ZERO } else { Duration::from_millis(2) }
    }

    /// Up to `samples` samples, as many as a chunk's time has room for; how many.
    fn chunk(&mut self, samples: u64) -> u64 {
        let begun = Instant::now();
        let mut columns = Vec::new();
        let mut done = 0;
        while done < samples {
            if begun.elapsed() >= CHUNK {
                break;
            }
            match self.sample() {
                Ok(column) => columns.push(column),
                Err(error) => {
                    self.lose(&error);
                    break;
                }
            }
            done += 1;
        }
        if done > 0 {
            self.turn.note(begun.elapsed() / done as u32);
        }
        {
            let mut history = self.shared.history();
            columns.iter().for_each(|column| history.push(column));
        }
        self.samples += done;
        let now = Instant::now();
        self.pace.marks.push_back((now, self.samples));
        while self.pace.marks.front().is_some_and(|(at, _)| now.duration_since(*at) > Duration::from_secs(1)) {
            self.pace.marks.pop_front();
        }
        self.look_at_board();
        done
    }

    /// One sample of board, bench and plant.
    fn sample(&mut self) -> Result<Column, SessionError> {
        self.tell()?;
        let Some(line) = &mut self.line else { return Ok(Column::of([f32::NAN; CHANNELS], 0)) };
        let (row, mode) = sample(&mut line.session, &line.ready, &mut line.bench, &line.last)?;
        line.mode = mode.unwrap_or(line.mode);
        let predicted_m = self.twin.read_m();
        line.bench.apply(row.command_v);
        self.twin.apply(row.command_v);
        line.last = row;
        let gap_m = row.displacement_m - predicted_m;
        self.gap = (self.gap.0 + gap_m * gap_m, self.gap.1 + 1);
        if let Some((sum_m2, rows)) = self.recent_gap.back_mut() {
            *sum_m2 += gap_m * gap_m;
            *rows += 1;
        }
        if !row.limited_by.is_empty() {
            let now = Instant::now();
            for (bit, lamp) in self.lamps.iter_mut().enumerate() {
                if row.limited_by.bits() >> bit & 1 == 1 {
                    *lamp = Some(now);
                }
            }
        }
        let follows = line.mode == ModeName::Running as u8 && is_closed_loop(self.hosted.as_ref(), &self.play);
        let um = |metres: f64| (metres * 1e6) as f32;
        let if_follows = |value| if follows { value } else { f32::NAN };
        let column = Column::of(
            [
                if_follows(um(row.reference_m)),
                um(row.displacement_m),
                um(predicted_m),
                if_follows(um(row.reference_m - row.displacement_m)),
                um(gap_m),
                row.command_v as f32,
            ],
            row.limited_by.bits(),
        );
        if let Some(recorder) = &mut self.recorder {
            let now = line.session.link().now();
            if let Err(error) = recorder.row(&row, now, line.session.statistics()) {
                let _ = self.end_recording(Some(&error.to_string()));
            }
        }
        Ok(column)
    }

    /// Tells the board the next value of a waveform that began while the loop ran, if it is another one.
    fn tell(&mut self) -> Result<(), SessionError> {
        let (Some(hosted), Some(line)) = (&mut self.hosted, &mut self.line) else { return Ok(()) };
        let Some(value) = hosted.next(line.ready.parameters.rate_hz) else { return Ok(()) };
        if hosted.told != Some(value) {
            let request = if hosted.is_closed_loop {
                ToBoard::Reference { reference_m: value }
            } else {
                ToBoard::Drive { drive_v: value }
            };
            match line.session.order(&request) {
                Ok(()) => hosted.told = Some(value),
                // Lost on the way: the next sample tells its own value.
                Err(SessionError::Silent { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Follows the board's mode; asks for its own account now and then.
    fn look_at_board(&mut self) {
        let Some(line) = &mut self.line else { return };
        let is_faulted = line.mode == ModeName::Fault as u8;
        if self.asked.elapsed() >= ACCOUNT || is_faulted != self.fault.is_some() {
            self.asked = Instant::now();
            match line.session.status() {
                Ok(account) => line.account = account,
                Err(error) => return self.lose(&error),
            }
            let fault = FaultCode::from_number(line.account.fault);
            if fault != self.fault {
                self.fault = fault;
                if let Some(fault) = fault {
                    if let Some(recorder) = &mut self.recorder {
                        recorder.fault(fault);
                    }
                    self.event(true, format!("fault: {}", fault.word().replace('_', " ")));
                }
            }
        }
        let is_running = self.line.as_ref().is_some_and(|line| line.mode == ModeName::Running as u8);
        if !is_running {
            self.hosted = None;
        }
    }

    fn line(&mut self) -> Result<&mut Line, String> {
        match &mut self.line {
            Some(line) => Ok(line),
            None => Err("there is no board: reconnect".to_owned()),
        }
    }

    fn parameters(&mut self) -> Result<Parameters, String> {
        self.line().map(|line| line.ready.parameters)
    }

    fn mode(&self) -> Option<ModeName> {
        let modes = [ModeName::Idle, ModeName::Armed, ModeName::Running, ModeName::Stopping, ModeName::Fault];
        self.line.as_ref().and_then(|line| modes.into_iter().find(|mode| *mode as u8 == line.mode))
    }

    /// Gives a board up that can't be spoken to. It ramps down by itself when it misses us.
    fn lose(&mut self, error: &SessionError) {
        let Some(line) = self.line.take() else { return };
        self.left = Some([line.own, line.ready.parameters]);
        self.hosted = None;
        self.lost = Some(error.to_string());
        if let Some(mut recorder) = self.recorder.take() {
            // Why it ended matters more than that this can't be written either.
            let _ = recorder.keep(line.session.statistics());
            self.event(true, format!("the recording ended after {} rows, which are there", recorder.rows));
        }
        self.event(true, error.to_string());
    }

    /// The end: the board is left at rest, with its own limits; else what it was left with.
    fn leave(&mut self) -> Result<(), String> {
        let _ = self.end_recording(None);
        let _ = self.stop("hysteron serve has ended");
        let settled = self.settle();
        let _ = self.order(&ToBoard::Input(wire::InputSource::Analog));
        let Some(line) = &mut self.line else {
            let why = self.lost.as_deref().unwrap_or("there is no board");
            return Err(format!(
                "the board was lost, and may keep the page's limits until it is reset or set anew (`hysteron board parameters`): {why}"
            ));
        };
        let kept = put_back(&mut line.session, line.own, line.ready.parameters.rate_hz).map_err(|error| {
            format!(
                "the board keeps the page's limits until it is reset or set anew (`hysteron board parameters`): {error}"
            )
        });
        // What moves is told before what is set.
        let left = settled.and(kept);
        if let Err(error) = &left {
            self.event(true, error.clone());
        }
        left
    }
}

/// Whether what plays is a reference.
fn is_closed_loop(hosted: Option<&Hosted>, play: &Play) -> bool {
    hosted.map_or(play.is_closed_loop, |hosted| hosted.is_closed_loop)
}

/// Opens the link and prepares the board; the bench at its start. One that comes back gets the law and limits that it was `left` with, and if it still
/// has that set, its own one is still to come.
fn connect(setting: &Setting, clear_fault: bool, left: Option<[Parameters; 2]>) -> Result<Line, BoardError> {
    let link = (setting.open)().map_err(SessionError::from)?;
    let mut session = Session::new(link).with_patience(setting.patience);
    // Idle first: of a board that does something else nothing is changed, and nothing put back.
    idle::<_, RunError>(&mut session, clear_fault)?;
    let found = session.parameters()?;
    let own = left.filter(|[_, last]| *last == found).map_or(found, |[own, _]| own);
    let settings = left.map_or(setting.controller.1, |[_, last]| last.settings());
    let prepared = prepare::<_, RunError>(&mut session, &settings, &Waveform::default(), false)
        .and_then(|ready| Ok((ready, session.status()?)));
    let (ready, account) = match prepared {
        Ok(prepared) => prepared,
        Err(error) => {
            // Why it can't be prepared matters more than that this can't be done either.
            let _ = put_back(&mut session, own, setting.rate_hz as f32);
            return Err(error);
        }
    };
    let seed = setting.seed;
    let bench = bench(setting, ready.latency_s, seed);
    Ok(Line { session, own, ready, bench, seed, last: Row::BEFORE, mode: account.mode, account })
}

fn bench(setting: &Setting, latency_s: f64, seed: u64) -> Bench {
    let model = &setting.bench.as_ref().unwrap_or(&setting.plant).model;
    let chain = model.chain();
    let start = model.start();
    Bench::new(&Setup { chain: &chain, start: &start, rate_hz: setting.rate_hz, samples: 0, latency_s, seed })
}

fn rms_um((sum_m2, rows): (f64, u64)) -> f64 {
    (sum_m2 / rows.max(1) as f64).sqrt() * 1e6
}
