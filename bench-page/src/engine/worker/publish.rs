//! What the engine says of itself: events, the state of the moment, and what changes seldom.

use super::orders::SETS;
use super::{Worker, is_closed_loop, rms_um};
use crate::engine::{Event, lock};
use crate::{diagnosis, parameters, runs};
use control_core::{Limits, ModeName};
use hil_bridge::statistics::Histogram;
use serde_json::{Value, json};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Events that are kept.
const EVENTS: usize = 200;
/// A limit's lamp stays on for so long after the limit acted, for a person to see it.
const LAMP: Duration = Duration::from_millis(400);
/// Statuses that the gap which is shown is taken over: half a second.
const RECENT: usize = 5;

impl Worker<'_> {
    /// Simulated seconds per second, over the last one.
    fn speed(&self) -> Option<f64> {
        let (first, last) = (self.pace.marks.front()?, self.pace.marks.back()?);
        let wall_s = last.0.duration_since(first.0).as_secs_f64();
        let is_fresh = last.0.elapsed() < Duration::from_secs(1);
        (wall_s > 0.1 && is_fresh).then(|| (last.1 - first.1) as f64 / self.setting.rate_hz / wall_s)
    }

    /// Notes an event and returns its words.
    pub(super) fn say(&mut self, text: String) -> String {
        self.event(false, text.clone());
        text
    }

    pub(super) fn event(&mut self, is_warning: bool, text: String) {
        if let Some(recorder) = &mut self.recorder
            && let Err(error) = recorder.event(&text)
        {
            let _ = self.end_recording(Some(&error.to_string()));
        }
        self.events += 1;
        let event = Event { number: self.events, time_s: self.samples as f64 / self.setting.rate_hz, is_warning, text };
        let mut events = lock(&self.shared.events);
        events.push(event);
        let surplus = events.len().saturating_sub(EVENTS);
        events.drain(..surplus);
        drop(events);
        self.shared.touch();
    }

    pub(super) fn publish(&mut self) {
        self.published = Instant::now();
        self.statuses += 1;
        let lamps = self.lamps.iter().enumerate().filter(|(_, lamp)| lamp.is_some_and(|at| at.elapsed() < LAMP));
        let limits = lamps.fold(0, |bits, (bit, _)| bits | 1 << bit);
        let words: Vec<&str> = Limits::from_bits(limits).words().collect();
        let recent = self.recent_gap.iter().fold((0.0, 0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        self.recent_gap.push_back((0.0, 0));
        if self.recent_gap.len() > RECENT {
            self.recent_gap.pop_front();
        }
        let follows = self.mode() == Some(ModeName::Running) && is_closed_loop(self.hosted.as_ref(), &self.play);
        let link = self.line.as_ref().map(|line| line.session.statistics());
        let status = json!({
            "kind": "status",
            "number": self.statuses,
            "mode": self.mode().map_or("no board", ModeName::word),
            "lost": self.lost,
            "fault": self.fault.map(|fault| fault.word().replace('_', " ")),
            "limits": words,
            "time_s": self.samples as f64 / self.setting.rate_hz,
            "samples": self.samples,
            "speed": self.speed(),
            "now": self.line.as_ref().map(|line| json!({
                "reference_um": follows.then_some(line.last.reference_m * 1e6),
                "displacement_um": line.last.displacement_m * 1e6,
                "drive_v": line.last.command_v,
            })),
            "gap_rms_um": (recent.1 > 0).then(|| rms_um(recent)),
            "resting": self.is_resting(),
            "is_set_running": self.is_set_running,
            "recording": self.recorder.as_ref().map(|r| json!({
                "path": r.path.display().to_string(),
                "rows": r.rows,
                "seconds": r.rows as f64 / self.setting.rate_hz,
            })),
            "task": self.shared.task(),
            "link": link.map(|link| link.json()),
            "round_trips": link.map(|link| bins(&link.round_trip)),
            "turns": bins(&self.turn),
            "board": self.line.as_ref().map(|line| json!({
                "overruns": line.account.overruns,
                "lost_samples": line.account.lost_samples,
                "bad_frames": line.account.bad_frames,
                "ready_max_cycles": line.account.ready_max_cycles,
            })),
        });
        *lock(&self.shared.status) = status.to_string().into();
        self.publish_state();
    }

    /// What changes seldom; made anew only when it has changed.
    fn publish_state(&mut self) {
        let version = self.shared.version.load(Ordering::Relaxed);
        if version == self.version && version > 0 {
            return;
        }
        self.version = version;
        let state = json!({
            "kind": "state",
            "play": { "text": self.play.text, "is_closed_loop": self.play.is_closed_loop, "is_hosted": self.hosted.is_some() },
            "parameters": self.line.as_ref().map(|line| Value::Object(parameters::values(&line.ready.parameters))),
            "undo": self.undo.len(),
            "plant": self.plant_name(),
            "bench": self.setting.bench.as_ref().map(|bench| bench.name.clone()),
            "board": self.line.as_ref().map(|line| json!({ "name": line.ready.board.board, "firmware": line.ready.board.firmware })),
            "passes": self.passes,
            "sets": runs::sets(&self.setting.runs.join(SETS)),
            "found": self.shared.found().map(|found| diagnosis::summary(&found)),
            "events": *lock(&self.shared.events),
        });
        *lock(&self.shared.state) = (version, state.to_string().into());
    }
}

/// A histogram for the page: upper ends in microseconds and counts, eight columns a decade.
fn bins(histogram: &Histogram) -> Value {
    let mut bins: Vec<(i32, u64)> = Vec::new();
    for (time, count) in histogram.buckets() {
        let bin = (8.0 * (time.as_secs_f64() * 1e6).max(1e-3).log10()).ceil() as i32;
        match bins.last_mut() {
            Some((last, sum)) if *last == bin => *sum += count,
            _ => bins.push((bin, count)),
        }
    }
    bins.into_iter().map(|(bin, count)| json!([10_f64.powf(f64::from(bin) / 8.0), count])).collect()
}
