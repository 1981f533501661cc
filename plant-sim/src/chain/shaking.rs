//! What shakes the mass, in motion: over a span of given length each sinusoid's parabola is a turn of two that are known beforehand.

use super::Shake;
use super::lag::Moments;
use super::path::Piece;
use crate::exact::{Push, Spans};
use std::f64::consts::TAU;

/// The shakes with their parabolas.
pub(super) struct Shaking {
    shakes: Vec<(Shake, [[Push; 2]; 2])>,
}

impl Shaking {
    pub(super) fn new(shakes: &[Shake], spans: Spans) -> Self {
        let known = |shake: &Shake| (*shake, [0, 1].map(|span| cosine_and_sine(shake.hz, spans.duration_s(span))));
        Self { shakes: shakes.iter().map(known).collect() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.shakes.is_empty()
    }

    /// The force of all of them at one instant.
    pub(super) fn now_n(&self, time_s: f64) -> f64 {
        let one = |(Shake { hz, cos_n, sin_n }, _): &(Shake, _)| {
            let (sin, cos) = (TAU * hz * time_s).sin_cos();
            cos_n * cos + sin_n * sin
        };
        self.shakes.iter().map(one).sum()
    }

    /// The force of all of them over `span` from `from_s` on, as the parabola with the same three moments.
    pub(super) fn push(&self, span: usize, from_s: f64) -> Push {
        let mut sum = Push::default();
        for (Shake { hz, cos_n, sin_n }, parabolas) in &self.shakes {
            let (sin, cos) = (TAU * hz * from_s).sin_cos();
            let [cosine, sine] = parabolas[span];
            sum = sum.with(cosine.times(cos_n * cos + sin_n * sin)).with(sine.times(sin_n * cos - cos_n * sin));
        }
        sum
    }
}

/// The parabolas with the same three moments as cosine and sine of `hz`, from zero to `duration_s`.
fn cosine_and_sine(hz: f64, duration_s: f64) -> [Push; 2] {
    let [mut cosine, mut sine] = [Moments::default(); 2];
    for (t, weight) in (Piece { from_s: 0.0, to_s: duration_s }).nodes() {
        let (sin, cos) = (TAU * hz * t).sin_cos();
        cosine.add_node(t, weight, cos);
        sine.add_node(t, weight, sin);
    }
    [cosine, sine].map(|moments| {
        let [force_n, slope, curve] = if duration_s > 0.0 { moments.parabola(duration_s) } else { [0.0; 3] };
        Push { force_n, slope, curve }
    })
}
