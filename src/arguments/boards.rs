//! Arguments of the commands that speak to a board: where it is, and what it is to do.

use super::{positive, share};
use clap::Args;
use hil_bridge::experiments::Set;
use hil_bridge::link::Place;
use std::path::PathBuf;
use std::time::Duration;

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron hil --board in-process --plant models/thesis-phs.toml \\
    --controller controllers/pi1.toml --reference step:80um --seconds 0.05 --out run
  hysteron hil --board serial:/dev/ttyACM0 --probe-link
The plant waits for the board, so that the same seed gives the same log.csv over
every link that loses nothing. run/ holds run.json, plant.toml, controller.toml,
log.csv (readable while it grows) and link.json. A board whose link loses
samples holds its drive; link.json names them.")]
pub struct HilCall {
    #[command(flatten)]
    pub at: BoardArguments,
    /// Plant, a model file
    #[arg(long, value_name = "P.toml", required_unless_present = "probe_link")]
    pub plant: Option<PathBuf>,
    /// Controller, a controller file
    #[arg(long, value_name = "C.toml", required_unless_present = "probe_link")]
    pub controller: Option<PathBuf>,
    /// What the displacement shall follow, such as step:80um; SPECs as in simulate, without `,shaped`
    #[arg(long, value_name = "SPEC", required_unless_present = "probe_link")]
    pub reference: Option<String>,
    /// Samples per second of the loop; must divide the board's clock
    #[arg(long, value_name = "HZ", default_value = "20000", value_parser = positive, allow_negative_numbers = true)]
    pub rate: f64,
    /// Length; the SPEC's own length where it has one
    #[arg(long, value_name = "S", value_parser = positive, allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Seed of the sensor's noise and of lost commands
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Run directory to write, empty or not there
    #[arg(long, value_name = "RUNDIR", required_unless_present = "probe_link")]
    pub out: Option<PathBuf>,
    /// Only measure the link: 10,000 samples to a board that stays idle; no run, so nothing that belongs to one
    #[arg(long, conflicts_with_all = ["controller", "reference", "seconds", "out", "link_faults", "paced"])]
    pub probe_link: bool,
    /// In real time: refused beyond 1 / (2 x the 99.9 % round trip), which is measured first; the drive acts half a sample late
    #[arg(long)]
    pub paced: bool,
    /// Leave a fault that the board is in
    #[arg(long)]
    pub clear_fault: bool,
    /// Damage frames on purpose while the loop runs: drop=0.01,delay=0.01,flip=0.01,reorder=0.01,stall=0.01
    #[arg(long, value_name = "KIND=SHARE,..")]
    pub link_faults: Option<String>,
    /// Print the outcome as JSON on standard output
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron record --board serial:/dev/ttyACM0 --set diagnosis --out monday
  hysteron record --board serial:/dev/ttyACM0 --set thesis \\
    --controller controllers/pi1.toml --controller controllers/pi2.toml --out loops
  hysteron record --board virtual --image nucleo-g474re \\
    --plant models/thesis-phs.toml --spec sine:60V@10Hz,for=1s --out run
A reference in um runs every controller given, within that controller's limits;
a command in V drives open loop, within the board's own. A set demagnetises
before each of its experiments. run/ holds run.json, copies of the files that
were read, link.json, and log.csv or 01-NAME.csv, ...: logs that replay,
identify and diagnose take as they are, readable while they grow. In process
the bench is --plant itself.")]
pub struct RecordCall {
    #[command(flatten)]
    pub at: BoardArguments,
    /// What to play, of finite length; several make several logs. SPECs as in simulate, without `,shaped`
    #[arg(long, value_name = "SPEC", required_unless_present = "set")]
    pub spec: Vec<String>,
    /// A set of experiments: thesis (step, square, sines, with every controller) or diagnosis (what tells effects apart)
    #[arg(long, value_name = "SET", conflicts_with = "spec")]
    pub set: Option<Set>,
    /// Every amplitude of a set times this
    #[arg(long, value_name = "SHARE", default_value = "1", conflicts_with = "spec", value_parser = share, allow_negative_numbers = true)]
    pub size: f64,
    /// Controller, a controller file, for what is a reference; may be given several times
    #[arg(long, value_name = "C.toml")]
    pub controller: Vec<PathBuf>,
    /// Plant, a model file: kept with the run. Refused are loops that are unstable with it, controllers whose limits lie beyond its rig's, and drives that take it there. The bench of a virtual board, and in process
    #[arg(long, value_name = "P.toml")]
    pub plant: Option<PathBuf>,
    /// Samples per second of the loop; must divide the board's clock
    #[arg(long, value_name = "HZ", default_value = "20000", value_parser = positive, allow_negative_numbers = true)]
    pub rate: f64,
    /// Corner of the filter between sensor and pin of a virtual board; none where not given
    #[arg(long = "anti-alias-hz", value_name = "HZ", value_parser = positive, allow_negative_numbers = true)]
    pub anti_alias: Option<f64>,
    /// Seed of a simulated sensor's noise and of lost commands
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Run directory to write, empty or not there
    #[arg(long, value_name = "RUNDIR")]
    pub out: PathBuf,
    /// Leave a fault that the board is in
    #[arg(long)]
    pub clear_fault: bool,
    /// Damage frames on purpose while an experiment runs: drop=0.01,delay=0.01,flip=0.01,reorder=0.01,stall=0.01
    #[arg(long, value_name = "KIND=SHARE,..")]
    pub link_faults: Option<String>,
    /// Print the outcome as JSON on standard output
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
#[command(after_help = "Examples:
  hysteron board parameters --board serial:/dev/ttyACM0
  hysteron board parameters --board serial:/dev/ttyACM0 \\
    --set amplifier_v_per_v=69 --set monitor_v_per_v=69 --save
Without anything to change it shows what is in force. Volts and metres of a
bench of your own: docs/wiring.md. What is set is checked as a whole, and only
an idle board takes it: what is refused changes nothing. hil, record and serve
put a controller's settings over these, its limits too, and leave the
calibration as it is. The board is one that stays behind the call: tcp: or
serial:.")]
pub struct BoardParametersCall {
    #[command(flatten)]
    pub at: BoardArguments,
    /// Sets a parameter, in the unit that its name ends in; may be repeated. Infinity is inf
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// The law of a controller file, at the board's own rate
    #[arg(long, value_name = "C.toml")]
    pub controller: Option<PathBuf>,
    /// Keep all that is then in force in the board's flash
    #[arg(long)]
    pub save: bool,
    /// Leave a fault that the board is in
    #[arg(long)]
    pub clear_fault: bool,
    /// Print the outcome as JSON on standard output; infinity is null
    #[arg(long)]
    pub json: bool,
}

#[derive(Args)]
#[command(after_help = "Example:
  hysteron board stop --board serial:/dev/ttyACM0
Takes the drive to 0 V as the board's own ramp does, and the amplifier's enable
off: for a board whose host has gone and that was told to wait for none
(link_timeout_s = inf), tcp: or serial:. The safety of a bench is its wired
stop.")]
pub struct BoardStopCall {
    #[command(flatten)]
    pub at: BoardArguments,
    /// Leave a fault that the board is in, or comes to
    #[arg(long)]
    pub clear_fault: bool,
}

/// Where a board is, and how it is reached.
#[derive(Args)]
pub struct BoardArguments {
    /// Where the board is: in-process (the law alone), virtual (--image), tcp:HOST:PORT or serial:PATH
    #[arg(long, value_name = "PLACE", default_value = "in-process")]
    pub board: Place,
    /// The flash image, for --board virtual
    #[arg(long, value_name = "IMAGE.elf")]
    pub image: Option<PathBuf>,
    /// Bits per second of a serial port
    #[arg(long, value_name = "BAUD", default_value_t = 3_000_000)]
    pub baud: u32,
    /// How long an answer may take; 100 on a serial port, 5000 on TCP, 50 of its own time on a virtual board
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u64).range(1..=600_000))]
    pub patience_ms: Option<u64>,
}

impl BoardArguments {
    /// How long an answer may take, if the call says it.
    pub fn patience(&self) -> Option<Duration> {
        self.patience_ms.map(Duration::from_millis)
    }
}
