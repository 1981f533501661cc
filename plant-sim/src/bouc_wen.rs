//! The Bouc-Wen law: equations (2.1) to (2.3) of the thesis. What it drives and is driven by is [`crate::chain`]'s business.
//!
//! ```text
//! h' = A x' - beta |x'| h |h|^(n-1) - gamma x' |h|^n                                        (2.1)
//! actuator:    h driven by the voltage, M y'' = -k y - b y' + Kv V - Kh h - Fext, n = 1     (2.2)
//! static:      y = dp V - h, h driven by the voltage                                        (2.3)
//! oscillator:  M y'' + b y' + k y + h = F, h driven by the displacement (Noel and Schoukens' benchmark, 2016)
//! ```
//!
//! | letter | meaning | field |
//! | --- | --- | --- |
//! | A | slope at h = 0: units of h per unit of x | `amplitude` |
//! | beta, gamma | loop shape, 1/(unit of x) times (unit of h)^(1-n) | `beta`, `gamma` |
//! | n | smoothness, >= 1 | `exponent` |
//!
//! h follows x, whatever the rate. While x goes one way, y = h in the direction of motion obeys dy/d|x| = A - (gamma + beta sign y) |y|^n.
//! For n = 1 that is two exponentials, exact over any distance; for other n an embedded Runge-Kutta pair holds 1e-12.
//! beta + gamma > 0 softens while loading, = 0 is straight, < 0 hardens.

/// Parameters of the law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoucWen {
    /// A.
    pub amplitude: f64,
    /// beta.
    pub beta: f64,
    /// gamma.
    pub gamma: f64,
    /// n, at least 1.
    pub exponent: f64,
}

/// The shape of a loop by its loading branch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// beta + gamma > 0.
    Softening,
    /// beta + gamma = 0.
    Linear,
    /// beta + gamma < 0.
    Hardening,
}

/// Relative error of one step of the general exponent; errors of many steps decay with the law's own memory.
const TOLERANCE: f64 = 1e-13;
/// Trial steps after which each is taken as it is, and after which what is left is given up: a law that saturates has long done so.
const PATIENCE: usize = 10_000;
const MOST_TRIED: usize = 20_000;
/// A hardening law runs away at a finite distance; beyond this multiple of A it is held, so that nothing overflows.
const RUNAWAY: f64 = 1e12;

impl BoucWen {
    /// Which of the three families of Figure 2.2.
    pub fn family(&self) -> Family {
        match self.beta + self.gamma {
            sum if sum > 0.0 => Family::Softening,
            sum if sum < 0.0 => Family::Hardening,
            _ => Family::Linear,
        }
    }

    /// h after x has moved by `by` one way.
    #[inline]
    pub fn after(&self, h: f64, by: f64) -> f64 {
        let towards = by.signum();
        towards * self.along(towards * h, by.abs())
    }

    /// dh/dx while x moves in the direction of the sign of `towards`.
    pub fn slope(&self, h: f64, towards: f64) -> f64 {
        let y = h * towards.signum();
        self.amplitude - (self.gamma + self.beta * y.signum()) * y.abs().powf(self.exponent)
    }

    /// Where loading ends: the h that A balances; `None` if it doesn't soften.
    pub fn saturation(&self) -> Option<f64> {
        let sum = self.beta + self.gamma;
        (sum > 0.0).then(|| (self.amplitude / sum).powf(1.0 / self.exponent))
    }

    /// Least and largest dh/dx over every h that a softening law reaches; for the others of |h| up to `reach`.
    pub fn slopes(&self, reach: f64) -> [f64; 2] {
        let h = self.saturation().unwrap_or(reach);
        let ends = [self.amplitude, self.slope(h, 1.0), self.slope(-h, 1.0)];
        [ends.iter().copied().fold(f64::INFINITY, f64::min), ends.iter().copied().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Distance over which the law bends, in units of x: quadratures take pieces no longer than this.
    pub fn length(&self) -> f64 {
        let bend = self.beta.abs() + self.gamma.abs();
        match self.saturation() {
            _ if bend == 0.0 => f64::INFINITY,
            Some(h) if self.amplitude > 0.0 => h / self.amplitude,
            _ => 1.0 / bend,
        }
    }

    /// y after |x| has grown by `by`.
    #[inline]
    fn along(&self, y: f64, by: f64) -> f64 {
        if self.exponent == 1.0 {
            let (a, loading, unloading) = (self.amplitude, self.gamma + self.beta, self.gamma - self.beta);
            if y >= 0.0 || a <= 0.0 {
                return relaxed(y, a, if y >= 0.0 { loading } else { -unloading }, by);
            }
            // y' = A + (gamma - beta) y until y passes zero.
            let end = relaxed(y, a, -unloading, by);
            if end <= 0.0 {
                return end;
            }
            let x = unloading * -y / a;
            // Distance to zero: ln(A / (A + r y)) / r.
            let zero_at = if x.abs() < 1e-9 { -y / a * (1.0 + 0.5 * x) } else { -(-x).ln_1p() / unloading };
            return relaxed(0.0, a, loading, (by - zero_at).max(0.0));
        }
        self.integrate(y, by)
    }

    fn rate(&self, y: f64) -> f64 {
        self.amplitude - (self.gamma + self.beta * y.signum()) * y.abs().powf(self.exponent)
    }

    /// Bogacki and Shampine's successor with error control: Dormand and Prince's pair, steps ending at the kink y = 0.
    fn integrate(&self, mut y: f64, by: f64) -> f64 {
        let most = RUNAWAY * self.amplitude.abs().max(1.0);
        let mut left = by;
        let mut step = left;
        let mut turns = 0;
        while left > 0.0 && y.abs() < most {
            step = step.min(left);
            let (end, error) = self.pair(y, step);
            let allowed =
                TOLERANCE * y.abs().max(end.abs()).max(self.amplitude.abs() * by * 1e-3).max(f64::MIN_POSITIVE);
            turns += 1;
            if turns > MOST_TRIED {
                break;
            }
            if !(end.is_finite() && error.is_finite()) {
                // What overflows says nothing of by how much it is too long.
                step *= 0.1;
                continue;
            }
            if error > allowed && turns <= PATIENCE {
                step *= (0.9 * (allowed / error).powf(0.2)).clamp(0.1, 0.9);
                continue;
            }
            if y * end < 0.0 {
                // Both sides of the kink are smooth: stop on it, by regula falsi on the step.
                let (mut low, mut high) = (0.0, step);
                for _ in 0..80 {
                    let middle = 0.5 * (low + high);
                    if self.pair(y, middle).0 * y > 0.0 { low = middle } else { high = middle }
                }
                left -= high;
                y = 0.0;
            } else {
                left -= step;
                y = end;
            }
            step *= (0.9 * (allowed / error.max(1e-300)).powf(0.2)).clamp(0.2, 5.0);
        }
        y
    }

    /// One step: the fifth-order end and the difference to the fourth-order one.
    fn pair(&self, y: f64, h: f64) -> (f64, f64) {
        const A: [[f64; 6]; 6] = [
            [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
            [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
            [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
            [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
            [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
        ];
        const E: [f64; 7] =
            [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0];
        let mut k = [0.0; 7];
        k[0] = self.rate(y);
        let mut end = y;
        for (stage, row) in A.iter().enumerate() {
            end = y + h * row.iter().zip(&k).map(|(a, k)| a * k).sum::<f64>();
            k[stage + 1] = self.rate(end);
        }
        (end, (h * E.iter().zip(&k).map(|(e, k)| e * k).sum::<f64>()).abs())
    }
}

/// Solution of y' = a - r y after `by`.
#[inline]
fn relaxed(y: f64, a: f64, r: f64, by: f64) -> f64 {
    let x = r * by;
    // (1 - e^-x)/x without cancellation.
    let mean = if x.abs() < 1e-12 { 1.0 - 0.5 * x } else { -(-x).exp_m1() / x };
    y * (-x).exp() + a * by * mean
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: BoucWen = BoucWen { amplitude: 0.008743, beta: 0.00637, gamma: 0.0144905, exponent: 1.0 };

    /// (2.1) in small steps of the time-like form, by Heun's rule.
    fn stepped(law: &BoucWen, mut h: f64, by: f64) -> f64 {
        let steps = 200_000;
        let dx = by / f64::from(steps);
        let rate = |h: f64| {
            law.amplitude
                - law.beta * dx.signum() * h * h.abs().powf(law.exponent - 1.0)
                - law.gamma * h.abs().powf(law.exponent)
        };
        for _ in 0..steps {
            let guess = h + dx * rate(h);
            h += 0.5 * dx * (rate(h) + rate(guess));
        }
        h
    }

    #[test]
    fn agrees_with_the_equation_stepped_finely() {
        for (beta, gamma) in [(0.15, 0.85), (0.5, -0.5), (0.15, -0.5)] {
            for exponent in [1.0, 1.5, 2.0, 3.0] {
                let law = BoucWen { amplitude: 1.0, beta, gamma, exponent };
                for (h, by) in [(0.0, 0.7), (0.6, -1.3), (-0.5, 1.1), (0.3, 0.2)] {
                    let (ours, fine) = (law.after(h, by), stepped(&law, h, by));
                    // Heun's error is of second order but for the kink, where one step of 7e-6 goes wrong in curvature.
                    assert!((ours - fine).abs() < 2e-9 * (1.0 + fine.abs()), "{law:?} {h} {by}: {ours} {fine}");
                }
            }
        }
    }

    #[test]
    fn both_ways_of_one_distance_are_the_same() {
        // Exact over any distance: two halves are the whole, to rounding (n = 1) or tolerance.
        for exponent in [1.0, 2.0] {
            let law = BoucWen { exponent, ..TABLE };
            let whole = law.after(-0.2, 80.0);
            let halves = law.after(law.after(-0.2, 33.0), 47.0);
            assert!((whole - halves).abs() < 1e-11, "{exponent}: {whole} {halves}");
        }
    }

    /// The powers of a first trial over the whole way overflow: it was tried again and again, and the test would not end.
    #[test]
    fn a_long_way_of_a_steep_law_ends() {
        let law = BoucWen { amplitude: 1.0, beta: 0.03, gamma: 0.07, exponent: 3.0 };
        let saturated = law.saturation().expect("it softens");
        for (from, to) in [(0.0, saturated), (-saturated, saturated), (0.5, saturated)] {
            // 90 V are more than a hundred lengths of the law's end: what is left of the way there is below rounding.
            let end = law.after(from, 90.0);
            assert!((end - to).abs() < 1e-10, "{from}: {end} {to}");
        }
        // A law that hardens runs away, and is held.
        let hardening = BoucWen { beta: 0.15, gamma: -0.5, ..law };
        let end = hardening.after(0.0, 90.0);
        assert!(end > 1e6 && end.is_finite(), "{end}");
    }

    #[test]
    fn families_and_saturation() {
        let law = |beta, gamma| BoucWen { amplitude: 1.0, beta, gamma, exponent: 1.0 };
        assert_eq!(law(0.15, 0.85).family(), Family::Softening);
        assert_eq!(law(0.5, -0.5).family(), Family::Linear);
        assert_eq!(law(0.15, -0.5).family(), Family::Hardening);
        // A softening law ends at (A/(beta + gamma))^(1/n): 1 here.
        assert!((law(0.15, 0.85).after(0.0, 60.0) - 1.0).abs() < 1e-12);
        assert!((law(0.5, -0.5).after(0.0, 3.0) - 3.0).abs() < 1e-12);
        assert!(law(0.15, -0.5).after(0.0, 3.0) > 3.0);
    }
}
