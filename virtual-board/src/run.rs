//! One experiment on the virtual board, from handshake to report: what `hysteron board run` does.

use crate::bench::BenchSettings;
use crate::chip::{Reset, Row};
use crate::host::{BoardError, Heard, VirtualBoard};
use crate::image::Image;
use crate::machine::Cost;
use crate::waveform::Waveform;
use control_core::ModeName;
use wire::{Parameters, Sample, Status, ToBoard};

/// Samples between two signs of life to the board; it waits for 250 ms.
const PART: u64 = 1000;

/// What to run.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// The bench; its calibration is that of `parameters`.
    pub bench: BenchSettings,
    /// What the board is set to.
    pub parameters: Parameters,
    /// What it plays.
    pub waveform: Waveform,
    /// The waveform is a reference; else a drive.
    pub is_closed_loop: bool,
    /// Samples to record.
    pub samples: u64,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Report {
    /// The board's name and its firmware's version.
    pub board: String,
    /// See `board`.
    pub firmware: String,
    /// Samples from the first one of the running loop on.
    pub rows: Vec<Row>,
    /// What the board streamed of them: as many, or none where the link is too slow for all.
    pub streamed: Vec<Sample>,
    /// Step of [`Sample::reference`], in metres.
    pub reference_step_m: f32,
    /// The board's last account of itself.
    pub status: Status,
    /// Cost of the control interrupt while the loop ran.
    pub cost: Cost,
    /// Resets during the run, with their cycle.
    pub resets: Vec<(u64, Reset)>,
    /// Largest magnitude of the true displacement at any sample, in metres.
    pub peak_m: f64,
    /// What the image logged.
    pub log: Vec<String>,
    /// Bytes of stack used and there.
    pub stack_bytes: (u32, u32),
    /// Bytes of the image in flash.
    pub image_bytes: u32,
    /// Cycles from one sample to the next: fewest and most.
    pub period_cycles: (u64, u64),
    /// Cycles from a sample to its latch: fewest and most.
    pub latch_cycles: (u64, u64),
}

/// Runs `experiment` on `image`. `progress` is told the samples done.
///
/// # Errors
/// [`BoardError`]; a fault of the loop is none, the report's status says it.
pub fn run(image: &Image, experiment: &Experiment, progress: &dyn Fn(u64)) -> Result<Report, BoardError> {
    let mut board = VirtualBoard::new(image, &experiment.bench, step_cycles(f64::from(experiment.parameters.rate_hz)));
    let Heard::Identity { board: name, firmware, .. } = board.greet()? else {
        return Err(BoardError::Silent { request: "hello".into() });
    };
    board.order(&ToBoard::SetParameters(experiment.parameters))?;
    experiment.waveform.send(experiment.is_closed_loop, |request| board.order(request))?;
    let Heard::Identity { reference_step_m, .. } = board.ask(&ToBoard::Hello)? else {
        return Err(BoardError::Silent { request: "hello".into() });
    };
    let started = board.ask(&ToBoard::StreamStart { every: 1 })?;
    let is_whole = matches!(started, Heard::StreamStarted { every: 1, .. });
    board.order(&ToBoard::Arm)?;
    board.machine.forget_cost();
    let armed = board.machine.chip().rows.len();
    board.order(&ToBoard::Run)?;
    let mut done = 0;
    let mut log = board.logged();
    let wanted = experiment.samples + 20;
    while done < wanted {
        let part = PART.min(wanted - done);
        board.run_samples(part)?;
        done += part;
        board.status()?;
        log.extend(board.logged());
        progress(done.min(experiment.samples));
    }
    // The last block may still be on its way: it goes out when 48 samples are together.
    board.run_samples(100)?;
    let cost = board.machine.cost();
    let status = board.status()?;
    let (streamed, first) = gather(&board.unasked);
    let rows = std::mem::take(&mut board.machine.chip().rows);
    // Rows count from 0, the board's samples from 1.
    let begin = first.map_or(armed, |first| (first as usize).saturating_sub(1));
    let samples = experiment.samples as usize;
    let rows: Vec<Row> = rows.into_iter().skip(begin).take(samples).collect();
    let streamed = if is_whole && streamed.len() >= rows.len() { streamed } else { Vec::new() };
    let stack_bytes = board.machine.stack_bytes(image).unwrap_or_default();
    let chip = board.machine.chip();
    Ok(Report {
        board: name,
        firmware,
        reference_step_m,
        status,
        cost,
        resets: chip.resets.clone(),
        peak_m: chip.bench.peak_m,
        log,
        stack_bytes,
        image_bytes: image.loaded_bytes,
        period_cycles: span(rows.windows(2).map(|two| two[1].hold_cycle - two[0].hold_cycle)),
        latch_cycles: span(rows.iter().map(|row| row.latch_cycle - row.hold_cycle)),
        streamed: streamed.into_iter().take(rows.len()).collect(),
        rows,
    })
}

/// The streamed samples from the first one of the running loop on, as long as there is no gap, and that one's number.
fn gather(heard: &[Heard]) -> (Vec<Sample>, Option<u32>) {
    let mut samples = Vec::new();
    let mut first_running = None;
    let mut next = None;
    for heard in heard {
        let Heard::StreamBlock { first, every, samples: block, .. } = heard else { continue };
        for (k, sample) in block.iter().enumerate() {
            let number = first.wrapping_add(k as u32 * u32::from(*every));
            if first_running.is_none() && sample.flags.mode() == ModeName::Running as u8 {
                first_running = Some(number);
                next = Some(number);
            }
            if next == Some(number) {
                samples.push(*sample);
                next = Some(number.wrapping_add(u32::from(*every)));
            }
        }
    }
    (samples, first_running)
}

fn span(values: impl Iterator<Item = u64>) -> (u64, u64) {
    values.fold((u64::MAX, 0), |(low, high), value| (low.min(value), high.max(value)))
}

/// Cycles of the plant's step for a board that samples at `rate_hz`: the most that divides both the period and the time from sample to latch.
pub fn step_cycles(rate_hz: f64) -> u64 {
    common_divisor((crate::bench::CORE_HZ / rate_hz).round() as u64, 1700)
}

fn common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}
