//! The foreseen path of the mass over one sub-step, and how laws are integrated along it: in pieces on which they are smooth.

use super::Force;
use super::lag::Moments;

/// Displacement over a sub-step: coefficients of 1, t, t^2, t^3.
pub(super) struct Path(pub [f64; 4]);

/// Halvings that find a threshold on a path: to 1e-12 of a sub-step.
const HALVINGS: usize = 40;
/// Most pieces that a path is cut into.
const PIECES: usize = 12;
/// Presliding lengths that one piece covers at most: Gauss' rule is then right to 1e-9 of the force; with coarse laws to 1e-5.
const LENGTHS: f64 = 1.5;
const COARSE_LENGTHS: f64 = 4.0;

impl Path {
    /// The cubic through places and velocities at both ends.
    pub(super) fn between(from_m: f64, from_m_per_s: f64, to_m: f64, to_m_per_s: f64, duration_s: f64) -> Self {
        let t = duration_s;
        let mean = (to_m - from_m) / t;
        Self([
            from_m,
            from_m_per_s,
            (3.0 * mean - 2.0 * from_m_per_s - to_m_per_s) / t,
            (from_m_per_s + to_m_per_s - 2.0 * mean) / (t * t),
        ])
    }

    #[inline]
    pub(super) fn at(&self, t: f64) -> f64 {
        let [a, b, c, d] = self.0;
        a + t * (b + t * (c + t * d))
    }

    /// Velocity and acceleration.
    #[inline]
    pub(super) fn motion(&self, t: f64) -> [f64; 2] {
        let [_, b, c, d] = self.0;
        [b + t * (2.0 * c + t * 3.0 * d), 2.0 * c + t * 6.0 * d]
    }

    /// Moments of the displacement from the path's start.
    pub(super) fn moments(&self, t: f64) -> Moments {
        let [_, b, c, d] = self.0;
        let square = t * t;
        Moments {
            zeroth: square * (b / 2.0 + t * (c / 3.0 + t * d / 4.0)),
            first: square * t * (b / 3.0 + t * (c / 4.0 + t * d / 5.0)),
            second: square * square * (b / 4.0 + t * (c / 5.0 + t * d / 6.0)),
        }
    }

    /// Instants within (0, `t`) at which the velocity changes its sign, in order.
    fn turns(&self, t: f64) -> [Option<f64>; 2] {
        let [_, b, c, d] = self.0;
        let inside = |s: f64| (s > 0.0 && s < t).then_some(s);
        let root = (c * c - 3.0 * b * d).sqrt();
        if root.is_nan() {
            return [None; 2];
        }
        // Without cancellation: the roots of 3 d s^2 + 2 c s + b.
        let sum = -(c + root.copysign(c));
        let (one, other) = (inside(sum / (3.0 * d)), inside(b / sum));
        match (one, other) {
            (Some(x), Some(y)) if x > y => [Some(y), Some(x)],
            (None, y) => [y, None],
            pair => [pair.0, pair.1],
        }
    }
}

/// Where the laws have corners.
pub(super) struct Quadrature {
    thresholds_m: Vec<f64>,
    /// The shortest presliding length, infinite for none.
    presliding_m: f64,
    /// How many of it a piece covers at most.
    lengths: f64,
}

/// A piece of a path.
pub(super) struct Piece {
    pub from_s: f64,
    pub to_s: f64,
}

impl Piece {
    /// Instants and weights of Gauss' rule with four nodes.
    pub(super) fn nodes(&self) -> [(f64, f64); 4] {
        const INNER: (f64, f64) = (0.339_981_043_584_856_3, 0.652_145_154_862_546_1);
        const OUTER: (f64, f64) = (0.861_136_311_594_052_6, 0.347_854_845_137_453_85);
        let (middle, half) = (0.5 * (self.from_s + self.to_s), 0.5 * (self.to_s - self.from_s));
        [(-OUTER.0, OUTER.1), (-INNER.0, INNER.1), INNER, OUTER].map(|(node, w)| (middle + half * node, half * w))
    }
}

impl Quadrature {
    pub(super) fn of(forces: &[Force], is_coarse: bool) -> Self {
        let lengths = if is_coarse { COARSE_LENGTHS } else { LENGTHS };
        let mut quadrature = Self { thresholds_m: Vec::new(), presliding_m: f64::INFINITY, lengths };
        for force in forces {
            match *force {
                Force::OneSided { .. } => quadrature.thresholds_m.push(0.0),
                Force::Stop { at_m, .. } | Force::Pad { at_m, .. } => quadrature.thresholds_m.push(at_m),
                Force::Presliding { presliding_m, .. } => {
                    quadrature.presliding_m = quadrature.presliding_m.min(presliding_m.max(1e-15));
                }
                Force::Slider { slip_m, .. } | Force::Patch { slip_m, .. } => {
                    quadrature.presliding_m = quadrature.presliding_m.min(slip_m.max(1e-15))
                }
                Force::BoucWen(law) => quadrature.presliding_m = quadrature.presliding_m.min(law.length().max(1e-15)),
                _ => {}
            }
        }
        quadrature
    }

    /// Calls `piece` for every smooth piece of the path, in order.
    pub(super) fn along(&self, path: &Path, duration_s: f64, mut piece: impl FnMut(&Piece)) {
        let mut from_s = 0.0;
        if self.thresholds_m.is_empty() && self.presliding_m.is_infinite() {
            return piece(&Piece { from_s, to_s: duration_s });
        }
        for to_s in path.turns(duration_s).into_iter().flatten().chain([duration_s]) {
            // One way from here to there.
            let mut cuts = [to_s; PIECES];
            let mut count = 0;
            let (from_m, to_m) = (path.at(from_s), path.at(to_s));
            for &threshold_m in &self.thresholds_m {
                if (from_m - threshold_m) * (to_m - threshold_m) < 0.0 && count < PIECES - 1 {
                    cuts[count] = crossing(path, threshold_m, from_s, to_s);
                    count += 1;
                }
            }
            let lengths = (to_m - from_m).abs() / (self.lengths * self.presliding_m);
            let parts = (lengths.ceil() as usize).clamp(1, PIECES - count);
            for part in 1..parts {
                cuts[count] = from_s + (to_s - from_s) * part as f64 / parts as f64;
                count += 1;
            }
            cuts[..count].sort_by(f64::total_cmp);
            for &cut_s in &cuts[..=count.min(PIECES - 1)] {
                if cut_s > from_s {
                    piece(&Piece { from_s, to_s: cut_s });
                    from_s = cut_s;
                }
            }
            if from_s < to_s {
                piece(&Piece { from_s, to_s });
            }
            from_s = to_s;
        }
    }
}

fn crossing(path: &Path, threshold_m: f64, from_s: f64, to_s: f64) -> f64 {
    let (mut low, mut high) = (from_s, to_s);
    let rising = path.at(to_s) > threshold_m;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if (path.at(middle) > threshold_m) == rising { high = middle } else { low = middle }
    }
    0.5 * (low + high)
}
