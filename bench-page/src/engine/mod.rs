//! The engine: a thread that keeps the lockstep loop going at wall time or as fast as the link allows, and what others may see and ask of it.
//!
//! Others put an [`Order`] into a channel and get one answer; they read what the engine publishes: the samples ([`History`]) and two texts,
//! the state of the moment and what changes seldom. The engine never waits for a reader. What this does not do: know a page or a socket.

pub mod experiments;
mod model;
mod worker;

use crate::history::{CHANNELS, History};
use control_core::Settings;
use gap_diagnosis::diagnose::Diagnosis;
use hil_bridge::link::{Link, LinkError, Place};
use hil_bridge::lockstep::LockstepError;
use hil_bridge::run_directory::RunError;
use plant_sim::margins::MarginError;
use plant_sim::model::Model;
use serde::Serialize;
use serde_json::{Map, Value};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Duration;
use tokio::sync::oneshot;

/// Key, words and unit of each channel, in the order of [`crate::history::channel`].
pub const CHANNEL_TABLE: [(&str, &str, &str); CHANNELS] = [
    ("reference", "reference", "um"),
    ("displacement", "displacement", "um"),
    ("model", "plant's prediction", "um"),
    ("error", "error: reference - displacement", "um"),
    ("gap", "gap: displacement - prediction", "um"),
    ("drive", "drive", "V"),
];

/// Opens the link; called again when a lost board is asked back.
pub type Open = Box<dyn Fn() -> Result<Box<dyn Link>, LinkError> + Send>;

/// A plant with the file it comes from.
#[derive(Clone, Debug)]
pub struct Source {
    /// Name of the file.
    pub name: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// What they say.
    pub model: Model,
}

/// What is to be served.
pub struct Setting {
    /// Where the board is.
    pub place: Place,
    /// How it is reached.
    pub open: Open,
    /// How long an answer may take; as the link says where `None`.
    pub patience: Option<Duration>,
    /// Whether a fault that the board is in may be left at the start.
    pub clear_fault: bool,
    /// Samples per second of the loop.
    pub rate_hz: f64,
    /// Seed of the bench's noise.
    pub seed: u64,
    /// The plant that predicts.
    pub plant: Source,
    /// The bench that the board drives; the plant itself where there is no other.
    pub bench: Option<Source>,
    /// The controller's settings, and the name of their file.
    pub controller: (String, Settings),
    /// Name and content of a virtual board's flash image.
    pub image: Option<(String, Vec<u8>)>,
    /// Folder of the run directories and saved sets.
    pub runs: PathBuf,
}

/// Why there is no engine.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum StartError {
    #[error(transparent)]
    Board(#[from] LockstepError<RunError>),
    #[error("the margins of this plant can't be computed: {0}")]
    Margins(#[from] MarginError),
    #[error("{0}")]
    Unstable(String),
    #[error("the engine's thread can't be started: {0}")]
    Thread(#[source] std::io::Error),
    #[error("the engine ended before it began")]
    Ended,
}

/// What may be asked of the engine.
#[derive(Debug)]
pub enum Wish {
    /// First action towards a running loop.
    Arm,
    /// Second action.
    Run,
    /// Ramp to 0 V, or disarm; ends an experiment set.
    Stop(&'static str),
    /// Leave the fault mode.
    ClearFault,
    /// Play this SPEC: from the next run on, or at once where the loop runs.
    Play(String),
    /// Put these values (the page's units) in force, all at one sample.
    Apply(Map<String, Value>),
    /// The parameters before the last change.
    Undo,
    /// Save the set in force under this name.
    Save(String),
    /// Put a saved set in force.
    Load(String),
    /// Record into a directory of this name.
    Record(String),
    /// End the recording.
    EndRecord,
    /// Run the experiment set; the second action, as `Run` is.
    Experiments,
    /// Diagnose the last pass of the set.
    Diagnose,
    /// The diagnosed plant becomes the one that predicts.
    AddEffect,
    /// Ask a lost board back.
    Reconnect,
    /// The end: the drive ramps down, the board is left idle, the engine ends.
    Leave,
}

/// A wish and whom to answer: `Ok` with a line to show, `Err` with a line that says what to do.
#[derive(Debug)]
pub struct Order {
    /// What.
    pub wish: Wish,
    /// Where the answer goes.
    pub answer: oneshot::Sender<Result<String, String>>,
}

/// Something that happened.
#[derive(Clone, Debug, Serialize)]
pub struct Event {
    /// Number, from 1.
    pub number: u64,
    /// Simulated seconds since the start.
    pub time_s: f64,
    /// Whether somebody should look.
    pub is_warning: bool,
    /// In words.
    pub text: String,
}

/// One pass of the experiment set: how far the plant is from the bench.
#[derive(Clone, Debug, Serialize)]
pub struct Pass {
    /// From 1.
    pub number: usize,
    /// The plant that predicted.
    pub plant: String,
    /// Rms of displacement minus prediction over all experiments, micrometres.
    pub gap_rms_um: f64,
    /// The same on those held out.
    pub held_out_rms_um: f64,
    /// Folder of its runs.
    pub folder: String,
    /// Name and rms of each experiment.
    pub experiments: Vec<(String, f64)>,
}

/// Work that takes its time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Task {
    /// In words.
    pub what: String,
    /// 0 to 1.
    pub share: f64,
}

/// A diagnosis and where its files are.
#[derive(Clone, Debug)]
pub struct Found {
    /// What was found.
    pub diagnosis: Arc<Diagnosis>,
    /// The report's page.
    pub report: Arc<str>,
    /// Part of the report's address that nobody guesses; whoever may see the page is told it.
    pub ticket: String,
    /// Directory of `report.html`, `diagnosis.json` and `augmented.toml`.
    pub folder: PathBuf,
    /// Whether its plant is the one that predicts now.
    pub is_in_use: bool,
}

/// What the engine publishes.
pub struct Shared {
    history: Mutex<History>,
    status: Mutex<Arc<str>>,
    state: Mutex<(u64, Arc<str>)>,
    events: Mutex<Vec<Event>>,
    task: Mutex<Option<Task>>,
    found: Mutex<Option<Found>>,
    diagnosing: Mutex<Option<Result<(), String>>>,
    /// Pages that look.
    pub watchers: AtomicUsize,
    version: AtomicU64,
}

/// A thread that panicked while it held a lock has left whole values behind: they are replaced, never edited in part.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Default for Shared {
    fn default() -> Shared {
        Shared {
            history: Mutex::default(),
            status: Mutex::new("{}".into()),
            state: Mutex::new((0, "{}".into())),
            events: Mutex::default(),
            task: Mutex::default(),
            found: Mutex::default(),
            diagnosing: Mutex::default(),
            watchers: AtomicUsize::new(0),
            version: AtomicU64::new(1),
        }
    }
}

impl Shared {
    /// Says what takes its time.
    pub(crate) fn set_task(&self, task: Option<Task>) {
        *lock(&self.task) = task;
    }

    /// What takes its time.
    pub(crate) fn task(&self) -> Option<Task> {
        lock(&self.task).clone()
    }

    /// How a diagnosis ended, to be asked once.
    pub(crate) fn take_ended(&self) -> Option<Result<(), String>> {
        lock(&self.diagnosing).take()
    }

    /// The end of a diagnosis.
    pub(crate) fn set_found(&self, found: Result<Found, String>) {
        let ended = found.map(|found| *lock(&self.found) = Some(found));
        *lock(&self.diagnosing) = Some(ended);
        self.touch();
    }

    /// The samples; to be held briefly, the engine waits for it.
    pub fn history(&self) -> MutexGuard<'_, History> {
        lock(&self.history)
    }

    /// The state of the moment, as JSON.
    pub fn status(&self) -> Arc<str> {
        lock(&self.status).clone()
    }

    /// What changes seldom, as JSON, and the number of its version.
    pub fn state(&self) -> (u64, Arc<str>) {
        lock(&self.state).clone()
    }

    /// The last diagnosis.
    pub fn found(&self) -> Option<Found> {
        lock(&self.found).clone()
    }

    /// Says that what changes seldom has changed.
    fn touch(&self) {
        self.version.fetch_add(1, Ordering::Relaxed);
    }
}

/// The engine, from outside.
#[derive(Clone)]
pub struct Engine {
    orders: mpsc::SyncSender<Order>,
    /// What it publishes.
    pub shared: Arc<Shared>,
    /// Folder of the run directories.
    pub runs: PathBuf,
    /// Samples per second.
    pub rate_hz: f64,
}

/// Orders that may wait: twice as many as all pages together may leave here, so that a stop of the server's own finds room. Whoever
/// asks for more is told so.
const WAITING: usize = 1024;

impl Engine {
    /// Finds the board, prepares it and starts the thread.
    ///
    /// # Errors
    /// [`StartError`]; nothing has moved then.
    pub fn start(setting: Setting) -> Result<Engine, StartError> {
        let (orders, waiting) = mpsc::sync_channel(WAITING);
        let shared = Arc::new(Shared::default());
        let (runs, rate_hz) = (setting.runs.clone(), setting.rate_hz);
        let (begun, outcome) = mpsc::channel();
        let published = shared.clone();
        // Links need not be Send, so the thread opens its own.
        std::thread::Builder::new()
            .name("engine".into())
            .spawn(move || worker::work(setting, &published, &waiting, &begun))
            .map_err(StartError::Thread)?;
        outcome.recv().map_err(|_| StartError::Ended)??;
        Ok(Engine { orders, shared, runs, rate_hz })
    }

    /// Asks the engine for something; its answer, in words. The order is on its way when this returns, whether or not its answer is
    /// waited for: so orders stay in the sequence in which they were asked, and a stop is never left unsent.
    ///
    /// # Errors
    /// The line that says why not.
    pub fn ask(&self, wish: Wish) -> impl Future<Output = Result<String, String>> + Send + use<> {
        let (answer, answered) = oneshot::channel();
        let sent = self.orders.try_send(Order { wish, answer }).map_err(|error| match error {
            mpsc::TrySendError::Full(_) => "the engine is busy: try again",
            mpsc::TrySendError::Disconnected(_) => GONE,
        });
        async move {
            match sent {
                Ok(()) => answered.await.unwrap_or_else(|_| Err(GONE.to_owned())),
                Err(error) => Err(error.to_owned()),
            }
        }
    }
}

const GONE: &str = "the engine has ended: start `hysteron serve` again";
