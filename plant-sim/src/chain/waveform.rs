//! A drive in motion: commands go in, volts at the actuator come out as one parabola per sub-step.
//!
//! Within a sub-step the true output may jump, ramp and decay. The parabola keeps its first three moments, so what it lacks is
//! orthogonal to every parabola, and the plant, which answers over a sub-step almost like a mass, hardly feels it: of a jump of 60 V
//! within 50 us 0.3 nm. An operator that remembers where the voltage has been would remember the parabola's swings beyond a jump: it is
//! given the course itself, stretch by stretch.

use super::drive::Output;
use super::lag::{LagState, Moments};
use super::{Drive, Growth, Held, Lag, Late};
use std::collections::VecDeque;

/// A part of a time constant over which a parabola follows what lags: of 60 V to some millivolts.
const BENT: f64 = 0.25;
/// Most stretches of one piece; the last takes what is left, in which little moves.
const MOST_STRETCHES: usize = 32;
/// Volts below which a stretch is held, in parts of one volt and of what it is: rounding.
const LEVEL: f64 = 1e-12;

/// A stretch of the true output: `from_v + slope t + curve t^2 / 2`, which ends on `to_v`. The next one may begin elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    pub from_v: f64,
    pub slope: f64,
    pub curve: f64,
    pub to_v: f64,
    pub duration_s: f64,
}

impl Stretch {
    pub(super) fn held(drive_v: f64, duration_s: f64) -> Self {
        Self { from_v: drive_v, slope: 0.0, curve: 0.0, to_v: drive_v, duration_s }
    }

    pub(super) fn line(from_v: f64, slope: f64, to_v: f64, duration_s: f64) -> Self {
        Self { from_v, slope, curve: 0.0, to_v, duration_s }
    }

    /// The parabola between two ends with this mean.
    fn bent(from_v: f64, to_v: f64, mean_v: f64, duration_s: f64) -> Self {
        let bow_v = 12.0 * (0.5 * (from_v + to_v) - mean_v);
        let rise_v = to_v - from_v - 0.5 * bow_v;
        if rise_v.abs() + bow_v.abs() <= LEVEL * (1.0 + from_v.abs()) {
            return Self::held(from_v, duration_s);
        }
        Self { from_v, slope: rise_v / duration_s, curve: bow_v / (duration_s * duration_s), to_v, duration_s }
    }

    pub(super) fn is_held(&self) -> bool {
        self.slope == 0.0 && self.curve == 0.0
    }
}

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
    /// The course over the sub-step that was put as a parabola last, where somebody asks for it.
    course: Option<Vec<Stretch>>,
}

impl Waveform {
    pub(super) fn new(drive: &Drive, sample_s: f64, delay_s: f64, keeps_course: bool) -> Self {
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
            course: keeps_course.then(Vec::new),
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
        self.course.iter_mut().for_each(Vec::clear);
        let mut arrival_s = self.take_arrived(from_s, 0.0, duration_s);
        // A held command behind a drive without memory is a constant until the next one arrives.
        if self.is_flat && self.acting.slope_v_per_s == 0.0 && arrival_s >= duration_s {
            self.age_s += duration_s;
            let held_v = self.output.at_v(self.acting.start_v);
            self.lag = LagState::at(held_v);
            self.course.iter_mut().for_each(|course| course.push(Stretch::held(held_v, duration_s)));
            return [held_v, 0.0, 0.0];
        }
        let mut sum = Moments::default();
        let mut done_s = 0.0;
        while done_s < duration_s {
            let until_s = arrival_s.min(duration_s);
            self.hold(done_s, until_s - done_s, &mut sum);
            done_s = until_s;
            arrival_s = self.take_arrived(from_s, done_s, duration_s);
        }
        let [start_v, slope, curve] = sum.parabola(duration_s);
        // Rounding leaves slopes of 1e-13 of a held value, which would only cost the engine its fast path.
        let flat = (slope.abs() + curve.abs() * duration_s) * duration_s <= 1e-12 * start_v.abs();
        if flat { [start_v, 0.0, 0.0] } else { [start_v, slope, curve] }
    }

    /// The course behind [`Waveform::parabola`]'s last answer; empty where it is not kept.
    pub(super) fn course(&self) -> &[Stretch] {
        self.course.as_deref().unwrap_or_default()
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

    /// Takes the commands that have arrived when `done_s` of a sub-step of `duration_s` is over, which begins at `from_s` of the present sample; returns
    /// when the next one does. One that comes within rounding of then comes then, but not at the sub-step's end: that is the next one's start.
    fn take_arrived(&mut self, from_s: f64, done_s: f64, duration_s: f64) -> f64 {
        while done_s < duration_s
            && let Some((given, held)) = self.underway.front().copied()
        {
            let arrival_s = self.arrival_of_s(given, from_s);
            if arrival_s > done_s + 1e-9 * duration_s {
                return arrival_s;
            }
            self.underway.pop_front();
            (self.acting, self.age_s) = (held, (done_s - arrival_s).max(0.0));
        }
        f64::INFINITY
    }

    /// When the command arrives that sample `given` gave, from `from_s` of the present sample on.
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

    /// The line `from_v + slope t` through what lags, and its course where that is kept.
    fn pass(&mut self, from_v: f64, slope: f64, duration_s: f64) -> Moments {
        if self.course.is_none() {
            return self.lagging(from_v, slope, duration_s);
        }
        let (lags, stretch_s) = self.stretch_s();
        let (mut sum, mut done_s) = (Moments::default(), 0.0);
        for count in 1..=MOST_STRETCHES {
            let left_s = duration_s - done_s;
            let is_last = count == MOST_STRETCHES || stretch_s >= left_s;
            let of_s = if is_last { left_s } else { stretch_s };
            let input_v = from_v + slope * done_s;
            let begins_v = self.begins_v(input_v);
            let moments = self.lagging(input_v, slope, of_s);
            let ends_v = self.now_v();
            let stretch = if lags {
                Stretch::bent(begins_v, ends_v, moments.zeroth / of_s, of_s)
            } else {
                Stretch::line(begins_v, slope, ends_v, of_s)
            };
            self.course.iter_mut().for_each(|course| course.push(stretch));
            sum.add(moments, done_s);
            done_s += of_s;
            if is_last {
                break;
            }
        }
        sum
    }

    /// Whether anything lags, and for how long a parabola follows it. A lag that grows is taken as it is where a piece begins, which shorter
    /// pieces would change: it is left whole.
    fn stretch_s(&self) -> (bool, f64) {
        let Drive { lag, lag_growth, late, .. } = &self.output.drive;
        let late = late.map(|late| Lag::First { time_constant_s: late.time_constant_s });
        let acting = || [*lag, late].into_iter().flatten().filter(|lag| lag.acts());
        let time_s = |lag: Lag| match lag {
            Lag::First { time_constant_s } => time_constant_s,
            Lag::Second { natural_rad_per_s, .. } => 1.0 / natural_rad_per_s,
        };
        let is_even = *lag_growth == Growth::NONE;
        let shortest_s = acting().map(time_s).filter(|_| is_even).fold(f64::INFINITY, f64::min);
        (acting().next().is_some(), BENT * shortest_s)
    }

    /// The output where an input of `input_v` begins to act: what lags has not moved yet.
    fn begins_v(&self, input_v: f64) -> f64 {
        let Drive { lag, late, .. } = &self.output.drive;
        let behind_v = |lag: Option<Lag>, state: &LagState| {
            if lag.is_some_and(Lag::acts) { state.value() } else { input_v }
        };
        let rest_v = behind_v(*lag, &self.lag);
        late.map_or(rest_v, |Late { share, time_constant_s }| {
            rest_v + share * (behind_v(Some(Lag::First { time_constant_s }), &self.late) - rest_v)
        })
    }

    fn lagging(&mut self, from_v: f64, slope: f64, duration_s: f64) -> Moments {
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
