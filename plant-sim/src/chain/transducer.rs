//! Hysteresis of the transducer: a Bouc-Wen law driven by the voltage, whose force the drive's misses (equations (2.2), (2.3)).
//!
//! Under a held voltage its force is constant, so a step is exact. Along a line or a parabola it is put as the parabola with the same
//! three moments, integrated in pieces on which the voltage goes one way and the law hardly bends.

use super::lag::Moments;
use super::path::{Path, Piece};
use crate::bouc_wen::BoucWen;
use crate::exact::Push;

/// h follows the voltage; `force_n` h is what the drive's force misses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveHysteresis {
    /// The law from volts to h, a pure number.
    pub law: BoucWen,
    /// Kh in newton.
    pub force_n: f64,
}

impl DriveHysteresis {
    /// The force under `drive_v` that was approached from the relaxed state one way.
    pub fn rest_n(&self, drive_v: f64) -> f64 {
        self.force_n * self.law.after(0.0, drive_v)
    }
}

/// Lengths of the law that one piece covers at most: four nodes are then right to 1e-12.
const LENGTHS: f64 = 0.5;
/// Most pieces one way.
const PIECES: f64 = 64.0;

/// The same in motion.
pub(super) struct Transducer {
    part: DriveHysteresis,
    h: f64,
    at_v: f64,
}

impl Transducer {
    pub(super) fn new(part: DriveHysteresis) -> Self {
        Self { part, h: 0.0, at_v: 0.0 }
    }

    /// `drive_v` has been held ever before, approached one way.
    pub(super) fn rest_on(&mut self, drive_v: f64) {
        self.h = self.part.law.after(0.0, drive_v);
        self.at_v = drive_v;
    }

    /// The missing force over `duration_s` of the voltage `start_v + slope t + curve t^2 / 2`, which may begin with a jump.
    pub(super) fn missing(&mut self, [start_v, slope, curve]: [f64; 3], duration_s: f64) -> Push {
        self.move_to(start_v);
        if slope == 0.0 && curve == 0.0 {
            return Push::held(self.part.force_n * self.h);
        }
        let path = Path([start_v, slope, 0.5 * curve, 0.0]);
        let turn_s = if curve == 0.0 { f64::INFINITY } else { -slope / curve };
        let ends = if turn_s > 0.0 && turn_s < duration_s { [turn_s, duration_s] } else { [duration_s; 2] };
        let mut sum = Moments::default();
        let mut from_s = 0.0;
        for to_s in ends {
            if to_s <= from_s {
                continue;
            }
            let lengths = (path.at(to_s) - path.at(from_s)).abs() / (LENGTHS * self.part.law.length());
            let count = lengths.ceil().clamp(1.0, PIECES);
            for part in 1..=count as u32 {
                let piece_end_s = from_s + (to_s - from_s) * f64::from(part) / count;
                let piece_start_s = from_s + (to_s - from_s) * f64::from(part - 1) / count;
                for (t, weight) in (Piece { from_s: piece_start_s, to_s: piece_end_s }).nodes() {
                    self.move_to(path.at(t));
                    let force_n = self.part.force_n * self.h;
                    sum.zeroth += weight * force_n;
                    sum.first += weight * t * force_n;
                    sum.second += weight * t * t * force_n;
                }
                self.move_to(path.at(piece_end_s));
            }
            from_s = to_s;
        }
        let [force_n, slope, curve] = sum.parabola(duration_s);
        Push { force_n, slope, curve }
    }

    /// The missing force now.
    pub(super) fn now_n(&self) -> f64 {
        self.part.force_n * self.h
    }

    fn move_to(&mut self, drive_v: f64) {
        if drive_v != self.at_v {
            self.h = self.part.law.after(self.h, drive_v - self.at_v);
            self.at_v = drive_v;
        }
    }
}
