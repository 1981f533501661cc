//! A drive in motion: commands go in, volts at the actuator come out as one parabola per sub-step.
//!
//! Within a sub-step the true output may jump, ramp and decay. The parabola keeps its first three moments, so what it lacks is
//! orthogonal to every parabola, and the plant, which answers over a sub-step almost like a mass, hardly feels it: of a jump of 60 V
//! within 50 us 0.3 nm.

use super::drive::Output;
use super::lag::{LagState, Moments};
use super::{Drive, Held, Lag, Late};
use std::collections::VecDeque;

/// The drive's state.
pub(super) struct Waveform {
    output: Output,
    /// Its output changes with the command alone.
    is_flat: bool,
    delay_s: f64,
    sample_s: f64,
    /// Commands on their way and the sample each was given in, the oldest first.
    underway: VecDeque<(u64, Held)>,
    /// The command that acts and for how long it has.
    acting: Held,
    age_s: f64,
    slewed_v: f64,
    lag: LagState,
    late: LagState,
    sample: u64,
}

impl Waveform {
    pub(super) fn new(drive: &Drive, sample_s: f64, delay_s: f64) -> Self {
        let mut waveform = Self {
            output: Output::new(drive),
            is_flat: !drive.has_memory(),
            delay_s,
            sample_s,
            underway: VecDeque::new(),
            acting: Held::zero_order(0.0),
            age_s: 0.0,
            slewed_v: 0.0,
            lag: LagState::default(),
            late: LagState::default(),
            sample: 0,
        };
        waveform.rest_on(0.0);
        waveform
    }

    /// `drive_v` has been commanded ever before.
    pub(super) fn rest_on(&mut self, drive_v: f64) {
        self.acting = Held::zero_order(drive_v);
        self.slewed_v = self.output.at_v(drive_v);
        self.lag = LagState::at(self.slewed_v);
        self.late = LagState::at(self.slewed_v);
    }

    /// Volts now.
    pub(super) fn now_v(&self) -> f64 {
        let share = self.output.drive.late.map_or(0.0, |late| late.share);
        self.lag.value() + share * (self.late.value() - self.lag.value())
    }

    /// Takes the command of the sample that begins.
    pub(super) fn push(&mut self, command: Held) {
        self.underway.push_back((self.sample, command));
    }

    /// The sample is over.
    pub(super) fn end_sample(&mut self) {
        self.sample += 1;
    }

    /// The output between `from_s` and `from_s + duration_s` of the present sample: volts, slope and second derivative at its start.
    pub(super) fn parabola(&mut self, from_s: f64, duration_s: f64) -> [f64; 3] {
        // A held command behind a drive without memory is a constant until the next one arrives.
        if self.is_flat && self.acting.slope_v_per_s == 0.0 && self.arrival_s(from_s) >= duration_s {
            self.age_s += duration_s;
            return [self.now_v(), 0.0, 0.0];
        }
        let mut sum = Moments::default();
        let mut done_s = 0.0;
        loop {
            let arrival_s = self.arrival_s(from_s);
            // A command that comes within rounding of a sub-step's start comes at its start.
            if arrival_s <= done_s + 1e-9 * duration_s {
                if let Some((_, held)) = self.underway.pop_front() {
                    (self.acting, self.age_s) = (held, (done_s - arrival_s).max(0.0));
                }
                continue;
            }
            let until_s = arrival_s.min(duration_s);
            self.hold(done_s, until_s - done_s, &mut sum);
            done_s = until_s;
            if done_s >= duration_s {
                break;
            }
        }
        let [start_v, slope, curve] = sum.parabola(duration_s);
        // Rounding leaves slopes of 1e-13 of a held value, which would only cost the engine its fast path.
        let flat = (slope.abs() + curve.abs() * duration_s) * duration_s <= 1e-12 * start_v.abs();
        if flat { [start_v, 0.0, 0.0] } else { [start_v, slope, curve] }
    }

    /// Volts between which the output lies from `from_s` to `from_s + duration_s` of the present sample, if they are known before
    /// [`Waveform::parabola`]: behind a drive without memory while commands are held.
    pub(super) fn between_v(&self, from_s: f64, duration_s: f64) -> Option<[f64; 2]> {
        if !self.is_flat || self.acting.slope_v_per_s != 0.0 {
            return None;
        }
        let [mut first_v, mut last_v] = [self.now_v(); 2];
        for (given, held) in &self.underway {
            let arrival_s = self.arrival_of_s(*given, from_s);
            if held.slope_v_per_s != 0.0 {
                return None;
            }
            let comes_v = self.output.at_v(held.start_v);
            if arrival_s <= 1e-9 * duration_s {
                [first_v, last_v] = [comes_v; 2];
            } else if arrival_s < duration_s {
                last_v = comes_v;
            }
        }
        Some([first_v, last_v])
    }

    /// When the next command arrives, from `from_s` of the present sample on.
    fn arrival_s(&self, from_s: f64) -> f64 {
        self.underway.front().map_or(f64::INFINITY, |(given, _)| self.arrival_of_s(*given, from_s))
    }

    /// The same of the command that sample `given` gave.
    fn arrival_of_s(&self, given: u64, from_s: f64) -> f64 {
        self.delay_s - (self.sample - given) as f64 * self.sample_s - from_s
    }

    /// The acting command over `duration_s`, which begins `at_s` into the sub-step.
    fn hold(&mut self, at_s: f64, duration_s: f64, sum: &mut Moments) {
        let at = |age_s: f64| self.output.at_v(self.acting.start_v + self.acting.slope_v_per_s * age_s);
        let from_v = at(self.age_s);
        self.age_s += duration_s;
        let slope = if self.acting.slope_v_per_s == 0.0 { 0.0 } else { (at(self.age_s) - from_v) / duration_s };
        if self.output.drive.slew_v_per_s.min(self.output.drive.slew_down_v_per_s) == f64::INFINITY {
            return sum.add(self.pass(from_v, slope, duration_s), at_s);
        }
        let (mut line_v, mut done_s) = (from_v, 0.0);
        while done_s < duration_s {
            let phase_s = self.chase([line_v, slope], at_s + done_s, duration_s - done_s, sum);
            line_v += slope * phase_s;
            done_s += phase_s;
        }
    }

    /// Ramps towards the line `from_v + slope t`, or follows it as far as the limits let it, for `duration_s` or until it meets the line or gets to
    /// zero, beyond which another limit may hold. Returns how long that was.
    fn chase(&mut self, [from_v, slope]: [f64; 2], at_s: f64, duration_s: f64, sum: &mut Moments) -> f64 {
        let Drive { slew_v_per_s, slew_down_v_per_s, discharge_ratio, .. } = self.output.drive;
        let apart = from_v - self.slewed_v;
        let rises = apart > 0.0 || apart == 0.0 && slope > 0.0;
        let goes_back = if rises { self.slewed_v < 0.0 } else { self.slewed_v > 0.0 };
        let most = if rises { slew_v_per_s } else { slew_down_v_per_s } * if goes_back { discharge_ratio } else { 1.0 };
        let ramp = if rises { most } else { -most };
        let is_steep = slope.abs() > most;
        let rate = if apart == 0.0 && !is_steep { slope } else { ramp };
        let closes = rate - slope;
        let meeting_s = if apart * closes > 0.0 { apart / closes } else { f64::INFINITY };
        let has_end = goes_back && discharge_ratio != 1.0 && rate != 0.0;
        let zero_s = if has_end { -self.slewed_v / rate } else { f64::INFINITY };
        let phase_s = meeting_s.min(zero_s).min(duration_s);
        if phase_s > 0.0 {
            sum.add(self.pass(self.slewed_v, rate, phase_s), at_s);
        }
        self.slewed_v = if phase_s == meeting_s || apart == 0.0 && !is_steep {
            from_v + slope * phase_s
        } else if phase_s == zero_s {
            0.0
        } else {
            self.slewed_v + rate * phase_s
        };
        phase_s
    }

    fn pass(&mut self, from_v: f64, slope: f64, duration_s: f64) -> Moments {
        let Drive { lag, lag_growth, late, .. } = self.output.drive;
        let input = [from_v, slope, 0.0, 0.0];
        let rest = self.lag.pass_grown(lag, lag_growth, input, duration_s);
        match late {
            Some(Late { share, time_constant_s }) => {
                let late = self.late.pass(Some(Lag::First { time_constant_s }), input, duration_s);
                rest.mixed(late, share)
            }
            None => rest,
        }
    }
}
