//! Hysteresis of the transducer: an operator driven by the voltage, whose force the drive's misses (equations (2.2), (2.3)).
//!
//! Under a held voltage its force is constant, so a step is exact. Along lines, parabolas and jumps between them it is put as the parabola
//! with the same three moments, integrated in pieces on which the voltage goes one way and the operator is smooth.

use super::lag::Moments;
use super::path::{Path, Piece};
use super::waveform::Stretch;
use crate::exact::Push;
use crate::operators::Law;

/// h follows the voltage; `force_n` h is what the drive's force misses.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveHysteresis {
    /// The operator from volts to h, a pure number.
    pub law: Law,
    /// Kh in newton.
    pub force_n: f64,
}

impl DriveHysteresis {
    /// The force under `drive_v` that was approached from the relaxed state one way.
    pub fn rest_n(&self, drive_v: f64) -> f64 {
        self.force_n * self.law.rest(drive_v)
    }
}

/// Most pieces one way.
const PIECES: usize = 64;

/// The same in motion.
pub(super) struct Transducer {
    part: DriveHysteresis,
    memory: Vec<f64>,
    at_v: f64,
    h: f64,
}

impl Transducer {
    pub(super) fn new(part: DriveHysteresis) -> Self {
        let memory = part.law.operator().relaxed();
        Self { part, memory, at_v: 0.0, h: 0.0 }
    }

    /// `drive_v` has been held ever before, approached one way.
    pub(super) fn rest_on(&mut self, drive_v: f64) {
        self.memory = self.part.law.operator().relaxed();
        (self.at_v, self.h) = (0.0, 0.0);
        self.move_to(drive_v);
    }

    /// The missing force over the `course` of the voltage, of `duration_s`; stretches may begin with a jump.
    pub(super) fn missing(&mut self, course: &[Stretch], duration_s: f64) -> Push {
        if let [stretch] = course
            && stretch.is_held()
        {
            self.move_to(stretch.from_v);
            return Push::held(self.now_n());
        }
        let (mut sum, mut done_s) = (Moments::default(), 0.0);
        for stretch in course {
            sum.add(self.along(stretch), done_s);
            done_s += stretch.duration_s;
        }
        let [force_n, slope, curve] = sum.parabola(duration_s);
        Push { force_n, slope, curve }
    }

    /// Moments of the missing force over one stretch.
    fn along(&mut self, stretch: &Stretch) -> Moments {
        let Stretch { from_v, slope, curve, to_v, duration_s } = *stretch;
        self.move_to(from_v);
        if stretch.is_held() {
            let (held_n, t) = (self.now_n(), duration_s);
            return Moments { zeroth: held_n * t, first: held_n * t * t / 2.0, second: held_n * t * t * t / 3.0 };
        }
        let mut sum = Moments::default();
        let path = Path([from_v, slope, 0.5 * curve, 0.0]);
        let turn_s = if curve == 0.0 { f64::INFINITY } else { -slope / curve };
        let ends = if turn_s > 0.0 && turn_s < duration_s { [turn_s, duration_s] } else { [duration_s; 2] };
        let mut from_s = 0.0;
        for to_s in ends {
            let mut pieces = 0;
            while from_s < to_s {
                pieces += 1;
                let piece =
                    Piece { from_s, to_s: if pieces < PIECES { self.smooth_until(&path, from_s, to_s) } else { to_s } };
                for (t, weight) in piece.nodes() {
                    self.move_to(path.at(t));
                    sum.add_node(t, weight, self.now_n());
                }
                // Rounding must not be a reversal.
                self.move_to(if piece.to_s < duration_s { path.at(piece.to_s) } else { to_v });
                from_s = piece.to_s;
            }
        }
        sum
    }

    /// The missing force now.
    pub(super) fn now_n(&self) -> f64 {
        self.part.force_n * self.h
    }

    /// When `path`, which goes one way from `from_s` to `to_s`, leaves the stretch on which the operator is smooth; `to_s` at the latest.
    fn smooth_until(&self, path: &Path, from_s: f64, to_s: f64) -> f64 {
        let whole_v = path.at(to_s) - path.at(from_s);
        let by_v = self.part.law.operator().smooth_v(&self.memory, self.at_v, whole_v);
        if by_v >= whole_v.abs() {
            return to_s;
        }
        // by = b t + c t^2 with b and c at `from_s`, the root without cancellation.
        let (by_v, [slope, curve]) = (by_v.copysign(whole_v), path.motion(from_s));
        let root = (slope * slope + 2.0 * curve * by_v).max(0.0).sqrt().copysign(whole_v);
        let until_s = from_s + 2.0 * by_v / (slope + root);
        if until_s > from_s { until_s.min(to_s) } else { to_s }
    }

    fn move_to(&mut self, drive_v: f64) {
        if drive_v != self.at_v {
            let operator = self.part.law.operator();
            operator.pass(&mut self.memory, self.at_v, drive_v);
            self.at_v = drive_v;
            self.h = operator.h(&self.memory, drive_v);
        }
    }
}
