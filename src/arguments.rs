//! Arguments as typed; every number is checked here, so that the commands see only what can be meant.

mod boards;

pub use boards::{BoardArguments, BoardParametersCall, BoardStopCall, HilCall, RecordCall};

use clap::{Args, Parser, Subcommand};
use gap_diagnosis::identify::Hysterons;
use gap_diagnosis::identify::tfest::MOST_ORDER;
use plant_sim::log::ReadOptions;
use plant_sim::replay::Initial;
use plant_sim::spec::{Shape, Spec};
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

/// Simulate and identify piezo actuators with hysteresis, so that the simulation matches the bench.
#[derive(Parser)]
#[command(
    name = "hysteron",
    version,
    subcommand_help_heading = "Commands",
    args_conflicts_with_subcommands = true,
    after_help = "Without a command: a demonstration on a made bench, about a minute.
Example:
  hysteron simulate --plant models/thesis-phs.toml --command sine:60V@10Hz \\
    --rate 10000 --seconds 1 --out sine.csv
Exit codes: 0 done, 2 wrong call, 3 bad input file, 4 did not converge
or hardware fault."
)]
pub struct Arguments {
    /// Without a command: the seed that the made bench is drawn from; from the clock where not given
    #[arg(long)]
    pub seed: Option<u64>,
    #[command(subcommand)]
    pub command: Option<Command>,
}

#[derive(Subcommand)]
pub enum Command {
    /// Closed loop (the board's control law against the plant) or open loop: writes a log and a page
    Simulate(SimulateCall),
    /// Drive a plant with a log's command and see how far it is from the log: writes the prediction and a page
    Replay(ReplayCall),
    /// Fit a plant to logs: writes a model file and a page
    Identify(IdentifyCall),
    /// Where plant and logs differ, which effect makes the difference, how far it shrinks: writes findings, a plant and a page
    Diagnose(DiagnoseCall),
    /// What a bench may do beyond its nominal plant: all effects, or everything about one
    Effects(EffectsCall),
    /// The diagnosis tested on cases whose effect is withheld: writes a score and a page
    BlindCheck(BlindCheckCall),
    /// A controller from a wish, or --check of one: margins, poles, pictures: writes a controller file and a page
    Design(DesignCall),
    /// The thesis' tables and figures, printed beside recomputed, with its errata: writes a page
    Reproduce(ReproduceCall),
    /// The flash image on the virtual board; what a board is set to; its stop
    #[command(subcommand)]
    Board(BoardCommand),
    /// The control code on a board against the simulated plant, sample by sample: writes a run directory
    Hil(HilCall),
    /// The bench in a browser: watch, tune, record and diagnose a board in the loop
    Serve(ServeCall),
    /// Experiments on a bench that hangs on the board's own pins: writes a run directory
    Record(RecordCall),
    /// A log as another kind of file: CSV, NPY, MAT v5, and Parquet or MDF 4 where they were built in
    Export(ExportCall),
}

#[derive(Subcommand)]
pub enum BoardCommand {
    /// Run the image in a loop with the simulated plant: writes a log and a report
    Run(BoardRunCall),
    /// Open the image's line to a host, over TCP or as a serial port
    Serve(BoardServeCall),
    /// What a board is set to: shown, changed, kept in its flash
    Parameters(BoardParametersCall),
    /// Stop a board that drives its own pins
    Stop(BoardStopCall),
}

impl Command {
    /// How the result is shown, and the output; `None` for a command that only prints or sees to its files itself.
    pub fn outputs(&self) -> Option<(Option<&Show>, &Path)> {
        match self {
            Command::Simulate(call) => Some((Some(&call.show), &call.out)),
            Command::Replay(call) => Some((Some(&call.show), &call.out)),
            Command::Identify(call) => Some((Some(&call.show), &call.out)),
            Command::Board(BoardCommand::Run(call)) => Some((None, &call.out)),
            Command::Board(BoardCommand::Serve(_) | BoardCommand::Parameters(_) | BoardCommand::Stop(_)) => None,
            Command::Reproduce(call) => Some((None, &call.out)),
            Command::Export(call) => Some((None, &call.out)),
            Command::Design(call) => Some((Some(&call.show), &call.out)),
            // A diagnosis, a blind check and a run write into a directory.
            Command::Diagnose(_)
            | Command::Effects(_)
            | Command::BlindCheck(_)
            | Command::Hil(_)
            | Command::Serve(_)
            | Command::Record(_) => None,
        }
    }

    /// Whether what it writes is a CSV whatever its name.
    pub fn writes_csv(&self) -> bool {
        matches!(self, Command::Simulate(_) | Command::Replay(_) | Command::Board(BoardCommand::Run(_)))
    }

    /// Every file that the command reads.
    pub fn inputs(&self) -> Vec<&Path> {
        match self {
            Command::Simulate(call) => {
                [&call.plant].into_iter().chain(call.drive.inputs()).map(PathBuf::as_path).collect()
            }
            Command::Board(BoardCommand::Run(call)) => {
                [&call.image, &call.plant].into_iter().chain(call.drive.inputs()).map(PathBuf::as_path).collect()
            }
            Command::Board(BoardCommand::Serve(call)) => vec![&call.image, &call.plant],
            Command::Board(BoardCommand::Parameters(call)) => call.controller.iter().map(PathBuf::as_path).collect(),
            Command::Board(BoardCommand::Stop(_)) => Vec::new(),
            Command::Design(call) => [&call.plant].into_iter().chain(&call.controller).map(PathBuf::as_path).collect(),
            Command::Replay(call) => vec![&call.plant, &call.log],
            Command::Export(call) => vec![&call.log],
            Command::Identify(call) => {
                call.plant.iter().chain(&call.logs).chain(&call.held_out).map(PathBuf::as_path).collect()
            }
            Command::Diagnose(call) => {
                let own = [&call.plant].into_iter().chain(&call.controller);
                own.chain(&call.logs).chain(&call.held_out).map(PathBuf::as_path).collect()
            }
            Command::Effects(_)
            | Command::BlindCheck(_)
            | Command::Reproduce(_)
            | Command::Hil(_)
            | Command::Serve(_)
            | Command::Record(_) => Vec::new(),
        }
    }
}

/// What a plant or a board is driven with.
#[derive(Args)]
pub struct Drive {
    /// Controller, a controller file; with --reference
    #[arg(long, value_name = "C.toml", requires = "reference")]
    pub controller: Option<PathBuf>,
    /// Closed loop: what the displacement shall follow, such as step:80um or sine:80um@50Hz
    #[arg(long, value_name = "SPEC", requires = "controller", conflicts_with = "command")]
    pub reference: Option<Spec>,
    /// Open loop: what to drive with, such as sine:60V@10Hz
    #[arg(long, value_name = "SPEC")]
    pub command: Option<Spec>,
}

impl Drive {
    /// The SPEC, of either loop.
    pub fn spec(&self) -> Option<&Spec> {
        self.reference.as_ref().or(self.command.as_ref())
    }

    /// Files that are read for it.
    fn inputs(&self) -> impl Iterator<Item = &PathBuf> {
        self.controller.iter().chain(spec_files(self.spec().into_iter()))
    }
}

/// Files that SPECs name.
pub fn spec_files<'a>(specs: impl Iterator<Item = &'a Spec>) -> impl Iterator<Item = &'a PathBuf> {
    specs.flat_map(|spec| &spec.parts).filter_map(|part| match &part.shape {
        Shape::File { path } => Some(path),
        _ => None,
    })
}

#[derive(Args)]
#[command(after_help = "Example, closed loop:
  hysteron simulate --plant models/thesis-phs.toml \\
    --controller controllers/pi1.toml --reference step:80um \\
    --rate 20000 --seconds 0.02 --out step.csv
Example, open loop:
  hysteron simulate --plant models/thesis-phs.toml --command sine:60V@10Hz \\
    --rate 10000 --seconds 1 --out sine.csv

A SPEC is one of these, its amplitude in um (reference) or V (command):
  zero@5s  step:80um  hold:40V@5s  square:80um@1Hz  sine:100um@50Hz
  triangle:60V@1Hz  minor-loops:60V@1Hz  decaying-sine:60V@8Hz/2s
  sweep:20V@1-2000Hz/4s[,log]
  ladder:60V/8,hold=2s  file:PATH[,unit=V]
  multisine:20V@1-2000Hz,odd,periods=4,realisations=6,seed=7
or several of them joined by + into a sequence.
`,for=2s` is the length of a part that states none (not of a ladder). `,shaped` on
any part bounds rate and acceleration of all. Rise, overshoot and settling are
told of a lone step, gain and phase of a lone sine.")]
pub struct SimulateCall {
    /// Plant, a model file
    #[arg(long, value_name = "P.toml")]
    pub plant: PathBuf,
    #[command(flatten)]
    pub drive: Drive,
    /// Samples per second
    #[arg(long, value_name = "HZ", value_parser = positive, allow_negative_numbers = true)]
    pub rate: f64,
    /// Length; the SPEC's own length where it has one
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// From sampling to the new drive, any real number of microseconds
    #[arg(long, value_name = "D", default_value = "10", value_parser = not_negative, allow_negative_numbers = true)]
    pub delay_us: f64,
    /// Leave the feedforward out
    #[arg(long, conflicts_with = "command")]
    pub no_feedforward: bool,
    /// Seed of the sensor's noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Log to write
    #[arg(long, value_name = "LOG.csv")]
    pub out: PathBuf,
    #[command(flatten)]
    pub show: Show,
}

#[derive(Args)]
#[command(after_help = "Example, somebody else's log whose sensor has an arbitrary zero:
  hysteron replay --plant fitted.toml bench.csv \\
    --columns time=t_s,command=u_V,displacement=y_um \\
    --free-offset --run-in 2 --out prediction.csv")]
pub struct ReplayCall {
    /// Plant, a model file
    #[arg(long, value_name = "P.toml")]
    pub plant: PathBuf,
    /// Measured log (CSV, NPY or MAT v5)
    pub log: PathBuf,
    /// Prediction to write
    #[arg(long, value_name = "PRED.csv")]
    pub out: PathBuf,
    /// Take the mean of the residual out, where the sensor's zero is arbitrary
    #[arg(long)]
    pub free_offset: bool,
    #[command(flatten)]
    pub start: StartOptions,
    #[command(flatten)]
    pub read: ReadArguments,
    #[command(flatten)]
    pub show: Show,
}

#[derive(Args)]
#[command(after_help = "Example:
  hysteron identify --model phs --hysterons auto bench.csv \\
    --columns time=t_s,command=u_V,displacement=y_um \\
    --run-in 2 --out fitted.toml
Example, which kind of model explains the logs best:
  hysteron identify --compare steps.csv sines.csv --held-out other.csv \\
    --out best.toml")]
pub struct IdentifyCall {
    /// Model to fit: phs (hysterons), linear (hysterons without dead zones), transfer-function, or an actuator with another law of
    /// hysteresis
    #[arg(
        long,
        value_name = "KIND",
        value_parser = [
            "phs", "linear", "bouc-wen", "bouc-wen-static", "bouc-wen-oscillator", "dahl", "duhem", "maxwell-slip",
            "prandtl-ishlinskii", "preisach", "krasnoselskii-pokrovskii", "transfer-function",
        ],
        required_unless_present = "compare"
    )]
    pub model: Option<String>,
    /// Fit every kind and rank them by what was never fitted: --held-out logs, or the last 30 % of each log; --out gets the best
    #[arg(long, conflicts_with_all = ["model", "hysterons", "order"])]
    pub compare: bool,
    /// With --compare: logs that are never fitted; their first 30 % tells how they start, and the rest ranks
    #[arg(long, value_name = "LOG", num_args = 1.., requires = "compare")]
    pub held_out: Vec<PathBuf>,
    /// Poles and zeros of a transfer function, such as 4,3; where not given, the order that the logs call for
    #[arg(long, value_name = "N,M", value_parser = order)]
    pub order: Option<(usize, usize)>,
    /// Number of hysterons, or auto: as many as the logs call for; not with --plant, which has them
    #[arg(long, value_name = "N|auto", value_parser = hysterons, conflicts_with = "plant", default_value = "auto")]
    pub hysterons: Hysterons,
    /// Where the search starts, and the mass: a model file; without it the start is guessed from the logs
    #[arg(long, value_name = "P.toml")]
    pub plant: Option<PathBuf>,
    /// Weighed moving mass, where no --plant states it: displacement alone determines only ratios to it. Where not given,
    /// the thesis bender's 1.0148e-3
    #[arg(long, value_name = "KG", value_parser = positive, conflicts_with = "plant", allow_negative_numbers = true)]
    pub mass_kg: Option<f64>,
    /// Measured logs (CSV, NPY or MAT v5)
    #[arg(required = true)]
    pub logs: Vec<PathBuf>,
    /// Model file to write
    #[arg(long, value_name = "FITTED.toml")]
    pub out: PathBuf,
    /// Starts of the search
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub starts: u32,
    /// Seed of the starts
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    #[command(flatten)]
    pub start: StartOptions,
    #[command(flatten)]
    pub read: ReadArguments,
    #[command(flatten)]
    pub show: Show,
}

#[derive(Args)]
#[command(after_help = "Example:
  hysteron diagnose --plant nominal.toml steps.csv sines.csv multisine.csv \\
    --held-out other-day.csv --out diagnosis
writes diagnosis/diagnosis.json, diagnosis/augmented.toml (a plant that every
command takes) and diagnosis/report.html. Logs of several kinds say more than
long ones: steps, sines of several frequencies, a multisine, a hold.")]
pub struct DiagnoseCall {
    /// Nominal plant, a model file; its sigmas say how far its numbers may be off
    #[arg(long, value_name = "P.toml")]
    pub plant: PathBuf,
    /// Measured logs (CSV, NPY or MAT v5)
    #[arg(required = true, value_name = "LOG")]
    pub logs: Vec<PathBuf>,
    /// Logs that score the answer; their first 30 % tells how they start, and the rest is never fitted
    #[arg(long, value_name = "LOG", num_args = 1..)]
    pub held_out: Vec<PathBuf>,
    /// Directory to write into, made if it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Seed of the intervals' resampling
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Entries to strike out of the registry: what would be said without them?
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    pub without: Vec<String>,
    /// Controller whose tracking error is predicted with the nominal and with the diagnosed plant
    #[arg(long, value_name = "C.toml")]
    pub controller: Option<PathBuf>,
    /// What that controller shall follow
    #[arg(long, value_name = "SPEC", requires = "controller", default_value = "sine:40um@50Hz,for=0.2s")]
    pub reference: String,
    /// Print diagnosis.json on standard output
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub start: StartOptions,
    #[command(flatten)]
    pub read: ReadArguments,
}

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron effects
  hysteron effects creep
A model file carries an effect as [[effect]] with its id, its form and its
parameters; every command with --plant takes such a file.")]
pub struct EffectsCall {
    /// Identifier of one effect; without it, all are listed
    pub id: Option<String>,
    /// Print the whole registry as Markdown: docs/effects.md
    #[arg(long, conflicts_with = "id")]
    pub markdown: bool,
}

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron design --plant models/thesis-phs.toml --rate 40000 \\
    --settle-ms 5 --overshoot 2 --gain-margin-db 6 --out own.toml
  hysteron design --plant models/thesis-phs.toml --rate 40000 --inverse \\
    --settle-ms 5 --overshoot 2 --track --out own-inverse.toml
  hysteron design --check --plant models/thesis-phs.toml \\
    --controller controllers/pi1.toml --rate 20000 --out check.json
Limits and shaping are those of --controller, or of controllers/pi1.toml
within the plant's [rig].")]
pub struct DesignCall {
    /// Check the controller instead of designing one; --out gets the findings as JSON
    #[arg(
        long,
        requires = "controller",
        conflicts_with_all = ["settle_ms", "overshoot", "step_um", "gain_margin_db", "phase_margin_deg", "inverse"]
    )]
    pub check: bool,
    /// Plant, a model file
    #[arg(long, value_name = "P.toml")]
    pub plant: PathBuf,
    /// Controller to check, or whose limits and shaping the design takes; refused where they lie beyond the plant's rig
    #[arg(long, value_name = "C.toml")]
    pub controller: Option<PathBuf>,
    /// Samples per second
    #[arg(long, value_name = "HZ", default_value = "20000", value_parser = positive, allow_negative_numbers = true)]
    pub rate: f64,
    /// From sampling to the new drive, any real number of microseconds
    #[arg(long, value_name = "D", default_value = "10", value_parser = not_negative, allow_negative_numbers = true)]
    pub delay_us: f64,
    /// Wish: time until a step stays within 2 %, its shaping included
    #[arg(long, value_name = "MS", default_value = "5", value_parser = positive, allow_negative_numbers = true)]
    pub settle_ms: f64,
    /// Wish: most overshoot of that step, in percent
    #[arg(long, value_name = "PERCENT", default_value = "2", value_parser = not_negative, allow_negative_numbers = true)]
    pub overshoot: f64,
    /// Height of that step
    #[arg(long, value_name = "UM", default_value = "80", value_parser = positive, allow_negative_numbers = true)]
    pub step_um: f64,
    /// Wish: least gain margin, up or down
    #[arg(long, value_name = "DB", default_value = "6", value_parser = not_negative, allow_negative_numbers = true)]
    pub gain_margin_db: f64,
    /// Wish: least phase margin
    #[arg(long, value_name = "DEGREES", default_value = "40", value_parser = not_negative, allow_negative_numbers = true)]
    pub phase_margin_deg: f64,
    /// Feedforward that inverts the plant, hysterons included; simulation only so far, boards refuse it
    #[arg(long)]
    pub inverse: bool,
    /// Also run 80 um sines of 1 to 150 Hz through the loop: rms error
    #[arg(long)]
    pub track: bool,
    /// Controller file to write, or findings with --check
    #[arg(long, value_name = "OUT")]
    pub out: PathBuf,
    #[command(flatten)]
    pub show: Show,
}

#[derive(Args)]
#[command(after_help = "Example:
  hysteron reproduce --out thesis.html
takes some ten seconds. Exit code 4 if a number comes out otherwise and is no
known erratum.")]
pub struct ReproduceCall {
    /// Page to write
    #[arg(long, value_name = "PAGE.html", default_value = "report.html")]
    pub out: PathBuf,
    /// Print every number as JSON on standard output
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
#[command(after_help = "Example:
  cargo xtask firmware
  hysteron board run target/firmware-rustup/thumbv7em-none-eabihf/release/nucleo-g474re \\
    --plant models/thesis-phs.toml --controller controllers/pi1.toml \\
    --reference step:80um --rate 20000 --seconds 0.05 --out step.csv
Beside the log it writes LOG.board.json: cycles, overruns, faults.
SPECs are those of `hysteron simulate`, without `,shaped`.")]
pub struct BoardRunCall {
    /// The flash image, an ELF file that `cargo xtask firmware` built
    #[arg(value_name = "IMAGE.elf")]
    pub image: PathBuf,
    /// Plant, a model file
    #[arg(long, value_name = "P.toml")]
    pub plant: PathBuf,
    #[command(flatten)]
    pub drive: Drive,
    /// Samples per second; must divide 170 MHz
    #[arg(long, value_name = "HZ", default_value = "20000", value_parser = positive, allow_negative_numbers = true)]
    pub rate: f64,
    /// Length; the SPEC's own length where it has one
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Corner of the filter between sensor and pin; none where not given
    #[arg(long = "anti-alias-hz", value_name = "HZ", value_parser = positive, allow_negative_numbers = true)]
    pub anti_alias: Option<f64>,
    /// Seed of the sensor's noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Log to write
    #[arg(long, value_name = "LOG.csv")]
    pub out: PathBuf,
    /// Print the report as JSON on standard output
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron board serve nucleo-g474re --plant models/thesis-phs.toml
  hysteron board serve nucleo-g474re --plant models/thesis-phs.toml --pty
The first line printed says where a host finds the board. It sees what it would
see on the board's serial line, at the board's own baud rate. One host at a
time; one that goes leaves the board as it is. Ends by itself after --seconds
of the board's time, else when it is stopped.")]
pub struct BoardServeCall {
    /// The flash image, an ELF file that `cargo xtask firmware` built
    #[arg(value_name = "IMAGE.elf")]
    pub image: PathBuf,
    /// Plant, a model file
    #[arg(long, value_name = "P.toml")]
    pub plant: PathBuf,
    /// Where to listen; port 0 takes a free one. Whoever reaches it can drive the board
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:0", conflicts_with = "pty")]
    pub listen: SocketAddr,
    /// A pseudo-terminal instead, which a host opens like a serial port
    #[arg(long)]
    pub pty: bool,
    /// How time passes: real (as the clock's, or slower), or lockstep (only while a request is answered, so that the same requests give
    /// the same bytes)
    #[arg(long, default_value = "real", value_parser = ["real", "lockstep"])]
    pub pace: String,
    /// Samples per second that the host will set; must divide 170 MHz
    #[arg(long, value_name = "HZ", default_value = "20000", value_parser = positive, allow_negative_numbers = true)]
    pub rate: f64,
    /// Stop after so much of the board's time
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Corner of the filter between sensor and pin; none where not given
    #[arg(long = "anti-alias-hz", value_name = "HZ", value_parser = positive, allow_negative_numbers = true)]
    pub anti_alias: Option<f64>,
    /// Seed of the sensor's noise and of lost commands
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron export run/log.csv --out log.mat
  hysteron export bench.csv --columns time=t_s,command=u_V,displacement=y_um \\
    --out bench.npy
MATLAB gets a variable a column and one for each metadatum. NPY has no room for
metadata. .parquet and .mf4 need a program built with --features parquet,mf4.")]
pub struct ExportCall {
    /// Log to read (CSV, NPY or MAT v5)
    pub log: PathBuf,
    /// Log to write; its ending says the kind: .csv, .npy, .mat, .parquet, .mf4
    #[arg(long, value_name = "LOG.mat")]
    pub out: PathBuf,
    #[command(flatten)]
    pub read: ReadArguments,
}

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron serve --plant models/thesis-phs.toml --controller controllers/pi1.toml
  hysteron serve --plant nominal.toml --bench bench.toml --controller controllers/pi1.toml --runs monday
  hysteron serve --board serial:/dev/ttyACM0 --plant models/thesis-phs.toml --controller controllers/pi1.toml
The first line printed is the page's address, with a token that is new at each
start: open it in a browser on this machine. Nothing is loaded from elsewhere.
The plant waits for the board (lockstep) and follows wall time as far as the
link lets it; the page says how far. --bench is a plant that differs from
--plant, say by an [[effect]]: what a diagnosis on the page is to find.
Escape on the page stops; the safety of a real bench is its wired stop.")]
pub struct ServeCall {
    #[command(flatten)]
    pub at: BoardArguments,
    /// Plant that predicts, a model file
    #[arg(long, value_name = "P.toml")]
    pub plant: PathBuf,
    /// Plant in the bench's place, a model file; --plant where not given
    #[arg(long, value_name = "BENCH.toml")]
    pub bench: Option<PathBuf>,
    /// Controller, a controller file
    #[arg(long, value_name = "C.toml")]
    pub controller: PathBuf,
    /// Samples per second of the loop; must divide the board's clock
    #[arg(long, value_name = "HZ", default_value = "20000", value_parser = positive, allow_negative_numbers = true)]
    pub rate: f64,
    /// Seed of the sensor's noise and of lost commands
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder for recordings, saved sets and diagnoses; made where it is not there
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub runs: PathBuf,
    /// Port of the page; 0 takes a free one
    #[arg(long, value_name = "PORT", default_value_t = 7411)]
    pub port: u16,
    /// Address to listen at; beyond loopback, whoever can read the network can read the token
    #[arg(long, value_name = "IP", default_value = "127.0.0.1")]
    pub listen: IpAddr,
    /// Leave a fault that the board is in
    #[arg(long)]
    pub clear_fault: bool,
}

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron blind-check --quick --seed 1 --out check
  hysteron blind-check --verify check
On two machines, then together:
  hysteron blind-check --seed 1 --shard 1/2 --out part1
  hysteron blind-check --seed 1 --shard 2/2 --out part2
  hysteron blind-check --merge part1 part2 --out check
A run that was stopped goes on with the same call. docs/blind-check.md says
how it is done, and how a lab does it with its own logs (--manifest).")]
pub struct BlindCheckCall {
    /// Seed of the list and of every case
    #[arg(long)]
    pub seed: Option<u64>,
    /// Directory to write to
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// 40 cases of all kinds instead of 712; not with --scale
    #[arg(long, conflicts_with = "scale")]
    pub quick: bool,
    /// So many times as many cases
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub scale: u32,
    /// Only so many cases from the top of the list, which is shuffled
    #[arg(long, value_name = "N")]
    pub first: Option<usize>,
    /// How much data a case has: short (4 s) or full (11 s)
    #[arg(long, default_value = "short", value_parser = ["short", "full"])]
    pub size: String,
    /// Which forms and nuisances; the report split is opened once per release
    #[arg(long, default_value = "develop", value_parser = ["develop", "calibrate", "report"])]
    pub split: String,
    /// Diagnose again with the true entry struck out; not with --shard
    #[arg(long)]
    pub leave_one_out: bool,
    /// Make the proposed experiment where several effects are left, and diagnose again; not with --shard
    #[arg(long)]
    pub active: bool,
    /// Diagnoses at a time; as many as there are cores where not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub jobs: Option<u16>,
    /// Only the I-th of N parts
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<Shard>,
    /// Put parts together and score them
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with_all = ["seed", "shard", "quick", "first"])]
    pub merge: Vec<PathBuf>,
    /// Repeat labels and score of a run from what it left, and say whether they agree
    #[arg(long, value_name = "DIR", conflicts_with_all = ["seed", "out", "merge", "manifest"])]
    pub verify: Option<PathBuf>,
    /// Measured logs whose label is sealed, instead of made cases
    #[arg(long, value_name = "FILE.toml", conflicts_with_all = ["seed", "shard", "merge", "quick", "leave_one_out", "active"])]
    pub manifest: Option<PathBuf>,
    /// Book of the openings of the report split; blind/openings.csv where that folder is
    #[arg(long, value_name = "FILE.csv")]
    pub openings: Option<PathBuf>,
    /// What the program was built from, for score and book: the output of git describe
    #[arg(long, value_name = "TEXT", default_value = "unknown")]
    pub commit: String,
    /// Program that diagnoses, called as this one; for tests and comparisons
    #[arg(long, value_name = "PROGRAM", hide = true)]
    pub program: Option<PathBuf>,
}

/// A part of a run.
#[derive(Clone, Copy, Debug)]
pub struct Shard {
    /// Which, from 1.
    pub part: usize,
    /// Of how many.
    pub of: usize,
}

impl Shard {
    /// Whether the case at this place of the list is in it.
    pub fn holds(self, at: usize) -> bool {
        at % self.of == self.part - 1
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.part, self.of)
    }
}

#[derive(Args)]
pub struct StartOptions {
    /// State at the log's first row: relaxed, rest (an equilibrium, which one is fitted) or fit
    #[arg(long, value_name = "STATE", default_value = "rest")]
    pub initial: Initial,
    /// Seconds at the start that are simulated but neither fitted nor scored
    #[arg(long, value_name = "S", value_parser = not_negative, allow_negative_numbers = true)]
    pub run_in: Option<f64>,
}

#[derive(Args)]
pub struct ReadArguments {
    /// The log's own column names: time=t_s,command=u_V,displacement=y_um
    #[arg(long, value_name = "NAME=COLUMN,..", value_delimiter = ',', value_parser = pair)]
    pub columns: Vec<(String, String)>,
    /// SI value of one unit of a column: displacement=1e-6 for micrometres
    #[arg(long, value_name = "NAME=FACTOR,..", value_delimiter = ',', value_parser = factor)]
    pub scale: Vec<(String, f64)>,
    /// Sampling rate, for a log without a time column; where it has one, instead of that
    #[arg(long = "rate", value_name = "HZ", value_parser = positive, allow_negative_numbers = true)]
    pub rate_hz: Option<f64>,
}

#[derive(Args)]
pub struct Show {
    /// Print the result as JSON on standard output
    #[arg(long)]
    pub json: bool,
    /// Page to write; beside the output where not given
    #[arg(long, value_name = "PAGE.html", conflicts_with = "no_page")]
    pub page: Option<PathBuf>,
    /// Write no page
    #[arg(long)]
    pub no_page: bool,
}

impl ReadArguments {
    /// Options for the reader.
    pub fn options(&self) -> ReadOptions {
        ReadOptions {
            columns: self.columns.iter().cloned().collect(),
            scale: self.scale.iter().cloned().collect(),
            rate_hz: self.rate_hz,
        }
    }
}

fn number(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| "not a finite number".to_owned())
}

fn positive(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v > 0.0 { Ok(v) } else { Err("must be greater than zero".into()) })
}

fn not_negative(text: &str) -> Result<f64, String> {
    number(text).and_then(|v| if v >= 0.0 { Ok(v) } else { Err("must not be negative".into()) })
}

fn share(text: &str) -> Result<f64, String> {
    positive(text).and_then(|v| if v <= 1.0 { Ok(v) } else { Err("must not be greater than 1".into()) })
}

fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(part, of)| Some((part.parse().ok()?, of.parse().ok()?)));
    match parts {
        Some((part, of)) if 1 <= part && part <= of => Ok(Shard { part, of }),
        _ => Err("a part of a whole, such as 2/5".into()),
    }
}

fn pair(text: &str) -> Result<(String, String), String> {
    text.split_once('=')
        .map(|(a, b)| (a.trim().to_owned(), b.trim().to_owned()))
        .ok_or_else(|| "needs NAME=VALUE".into())
}

fn factor(text: &str) -> Result<(String, f64), String> {
    let (name, value) = pair(text)?;
    Ok((name, number(&value)?))
}

fn order(text: &str) -> Result<(usize, usize), String> {
    let pair = text.split_once(',').and_then(|(n, m)| Some((n.trim().parse().ok()?, m.trim().parse().ok()?)));
    match pair {
        Some((n, m)) if (1..=MOST_ORDER).contains(&n) && m < n => Ok((n, m)),
        _ => Err(format!("poles and fewer zeros, such as 4,3; at most {MOST_ORDER} poles")),
    }
}

fn hysterons(text: &str) -> Result<Hysterons, String> {
    match text {
        "auto" => Ok(Hysterons::Auto),
        _ => text
            .parse()
            .ok()
            .filter(|n| *n <= plant_sim::chain::MAX_HYSTERONS)
            .map(Hysterons::Fixed)
            .ok_or_else(|| format!("a number from 0 to {} or auto", plant_sim::chain::MAX_HYSTERONS)),
    }
}
