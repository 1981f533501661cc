//! Low-passes in motion: exact responses to straight lines (the drive's side) and to cubics (the sensor's side).

use super::path::Piece;
use nalgebra::{Complex, ComplexField};

/// A linear low-pass with unit gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lag {
    /// 1 / (1 + s T).
    First {
        /// T in seconds.
        time_constant_s: f64,
    },
    /// w^2 / (s^2 + 2 z w s + w^2).
    Second {
        /// w in rad/s.
        natural_rad_per_s: f64,
        /// z.
        damping_ratio: f64,
    },
}

/// How a lag's time constant (of a second-order one, both) depends on what is there: T (1 + by_side x + outwards |x|) / (1 + eager |u - x|),
/// where the lag is at x and goes towards u, in volts or metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth {
    /// More on one side of zero than on the other, 1/V or 1/m.
    pub by_side: f64,
    /// More on both sides, or less if it is negative, 1/V or 1/m.
    pub outwards: f64,
    /// How much quicker it is for a large error, 1/V or 1/m.
    pub eager: f64,
}

impl Growth {
    /// One time constant everywhere.
    pub const NONE: Growth = Growth { by_side: 0.0, outwards: 0.0, eager: 0.0 };

    /// Time constant at `x` over that at zero, for a small error.
    fn slower(self, x: f64) -> f64 {
        (1.0 + self.by_side * x + self.outwards * x.abs()).max(LEAST_LAG)
    }
}

/// Least share that is left of a lag that grows.
const LEAST_LAG: f64 = 0.05;
/// Most pieces of an input that moves, for a lag that is quicker for a large error.
const MOST_PIECES: f64 = 8.0;
/// The same of a second-order one, and what a piece times its natural frequency is, as it is where the piece begins.
const MOST_BENT_PIECES: usize = 32;
const BENT_PIECE: f64 = 0.25;
/// A time constant below this acts as none, in seconds; the closed forms divide by it.
const NEGLIGIBLE_S: f64 = 1e-12;
/// How far a damping ratio keeps from 1, where the two poles of a second-order lag meet and the closed forms divide by zero. The
/// response changes by about as much.
const APART: f64 = 1e-6;

/// A term of the series below that adds nothing.
const ROUNDING: f64 = 1e-18;
/// 1/n and 1/(n + 2) for n from one on: 1/18! is below rounding.
const SERIES: [[f64; 2]; 18] = {
    let mut series = [[0.0; 2]; 18];
    let mut n = 0;
    while n < series.len() {
        series[n] = [1.0 / (n + 1) as f64, 1.0 / (n + 3) as f64];
        n += 1;
    }
    series
};

/// Output of a lag and, for one of second order, the output's slope.
#[derive(Clone, Debug, Default)]
pub(super) struct LagState {
    value: f64,
    slope: f64,
    /// Decays over the durations met last, which in a steady run come back every sample.
    known: [Known; 2],
    oldest: usize,
}

/// exp(pole t) and its moments over one duration, for both poles.
#[derive(Clone, Copy, Debug)]
struct Known {
    duration_s: f64,
    decays: [Decay; 2],
}

impl Default for Known {
    fn default() -> Self {
        Self { duration_s: f64::NAN, decays: [Decay::default(); 2] }
    }
}

/// exp(pole t) at the end of a duration, and its moments over the duration.
#[derive(Clone, Copy, Debug, Default)]
struct Decay {
    end: Complex<f64>,
    moments: [Complex<f64>; 3],
}

/// What a piece of output adds up to over its duration.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    /// Integral of the output.
    pub zeroth: f64,
    /// Integral of the output times the time since the piece began.
    pub first: f64,
    /// Integral of the output times the square of that time.
    pub second: f64,
}

impl Lag {
    /// Whether it is slow enough to be felt at all.
    pub(crate) fn acts(self) -> bool {
        match self {
            Lag::First { time_constant_s } => time_constant_s > NEGLIGIBLE_S,
            Lag::Second { .. } => true,
        }
    }
}

impl LagState {
    /// At rest on `value`.
    pub(super) fn at(value: f64) -> Self {
        Self { value, ..Self::default() }
    }

    /// Moved from where it is: its value and its rate.
    pub(super) fn shift(&mut self, [value, slope]: [f64; 2]) {
        self.value += value;
        self.slope += slope;
    }

    pub(super) fn value(&self) -> f64 {
        self.value
    }

    pub(super) fn slope(&self) -> f64 {
        self.slope
    }

    /// Moves through `duration_s` of the input `input[0] + input[1] t + input[2] t^2 + input[3] t^3` and returns the moments of the
    /// output. One state belongs to one lag.
    pub(super) fn pass(&mut self, lag: Option<Lag>, input: [f64; 4], duration_s: f64) -> Moments {
        match lag {
            Some(Lag::First { time_constant_s }) if time_constant_s > NEGLIGIBLE_S => {
                let settled = settled(input, time_constant_s, 0.0);
                let away = self.value - settled[0];
                let pole = Complex::new(-1.0 / time_constant_s, 0.0);
                let [decay, _] = self.decays([pole, pole], duration_s);
                self.value = at(settled, duration_s) + away * decay.end.re;
                self.slope = 0.0;
                moments(settled, duration_s).plus(&decay, Complex::new(away, 0.0))
            }
            Some(Lag::Second { natural_rad_per_s: w, damping_ratio }) => {
                let z = if (damping_ratio - 1.0).abs() < APART { 1.0 + APART } else { damping_ratio };
                let settled = settled(input, 2.0 * z / w, 1.0 / (w * w));
                let root = Complex::new(z * z - 1.0, 0.0).sqrt() * w;
                let poles = [root - z * w, -root - z * w];
                // Amplitudes of the two modes that start from where the state is and where it would have settled.
                let away = Complex::new(self.value - settled[0], 0.0);
                let moving = Complex::new(self.slope - settled[1], 0.0);
                let second = (moving - poles[0] * away) / (poles[1] - poles[0]);
                let amplitudes = [away - second, second];
                let mut sum = moments(settled, duration_s);
                let decays = self.decays(poles, duration_s);
                (self.value, self.slope) = (at(settled, duration_s), slope_at(settled, duration_s));
                for i in 0..2 {
                    let now = amplitudes[i] * decays[i].end;
                    self.value += now.re;
                    self.slope += (now * poles[i]).re;
                    sum = sum.plus(&decays[i], amplitudes[i]);
                }
                sum
            }
            _ => {
                (self.value, self.slope) = (at(input, duration_s), 0.0);
                moments(input, duration_s)
            }
        }
    }

    /// The same of a lag that grows, with the time constant that it has where its output is.
    pub(super) fn pass_grown(&mut self, lag: Option<Lag>, growth: Growth, input: [f64; 4], duration_s: f64) -> Moments {
        if growth == Growth::NONE {
            return self.pass(lag, input, duration_s);
        }
        match lag.filter(|_| growth.eager != 0.0) {
            Some(Lag::First { time_constant_s }) => {
                let time_constant_s = (time_constant_s * growth.slower(self.value)).max(NEGLIGIBLE_S);
                self.pass_eager(time_constant_s, growth.eager, input, duration_s)
            }
            Some(Lag::Second { natural_rad_per_s, .. }) => {
                self.pass_bent(lag, natural_rad_per_s, growth, input, duration_s)
            }
            None => self.pass_slower(lag, growth.slower(self.value), input, duration_s),
        }
    }

    /// The same of a lag that is slower by a factor, which sees everything faster by it.
    fn pass_slower(&mut self, lag: Option<Lag>, slower: f64, input: [f64; 4], duration_s: f64) -> Moments {
        let [a, b, c, d] = input;
        let input = [a, b * slower, c * slower.powi(2), d * slower.powi(3)];
        let Moments { zeroth, first, second } = self.pass(lag, input, duration_s / slower);
        Moments { zeroth: zeroth * slower, first: first * slower.powi(2), second: second * slower.powi(3) }
    }

    /// The same of a first-order lag that is quicker for a large error: T e' = -e (1 + c |e|) is solved by e = e0 x / (1 + c |e0| (1 - x)),
    /// x = exp(-t / T). An input that moves counts piece by piece as what it is in the middle.
    fn pass_eager(&mut self, time_constant_s: f64, eager: f64, input: [f64; 4], duration_s: f64) -> Moments {
        let is_flat = input[1..].iter().all(|c| *c == 0.0);
        let pieces = if is_flat { 1.0 } else { (duration_s / time_constant_s).ceil().clamp(1.0, MOST_PIECES) };
        let piece_s = duration_s / pieces;
        let mut sum = Moments::default();
        for piece in 0..pieces as usize {
            let from_s = piece as f64 * piece_s;
            let towards = at(input, from_s + 0.5 * piece_s);
            let error = self.value - towards;
            let left = |t: f64| {
                let x = (-t / time_constant_s).exp();
                error * x / (1.0 + eager * error.abs() * (1.0 - x))
            };
            // Nodes where the error still dies out, and behind.
            let ends = [0.0, 1.0, 4.0, f64::INFINITY].map(|ends: f64| (ends * time_constant_s).min(piece_s));
            for part in ends.windows(2).filter(|part| part[1] > part[0]) {
                for (t, weight) in (Piece { from_s: part[0], to_s: part[1] }).nodes() {
                    sum.add_node(from_s + t, weight, towards + left(t));
                }
            }
            self.value = towards + left(piece_s);
        }
        self.slope = 0.0;
        sum
    }

    /// The same of a second-order lag that is quicker for a large error: piece by piece, as it is where each begins.
    fn pass_bent(
        &mut self,
        lag: Option<Lag>,
        natural_rad_per_s: f64,
        growth: Growth,
        input: [f64; 4],
        duration_s: f64,
    ) -> Moments {
        let (mut sum, mut done_s) = (Moments::default(), 0.0);
        for piece in 1..=MOST_BENT_PIECES {
            let input = later(input, done_s);
            let slower = growth.slower(self.value) / (1.0 + growth.eager * (input[0] - self.value).abs());
            let left_s = duration_s - done_s;
            let piece_s = BENT_PIECE * slower / natural_rad_per_s;
            let is_last = piece == MOST_BENT_PIECES || piece_s >= left_s;
            let piece_s = if is_last { left_s } else { piece_s };
            sum.add(self.pass_slower(lag, slower, input, piece_s), done_s);
            done_s += piece_s;
            if is_last {
                break;
            }
        }
        sum
    }

    fn decays(&mut self, poles: [Complex<f64>; 2], duration_s: f64) -> [Decay; 2] {
        if let Some(known) = self.known.iter().find(|known| known.duration_s == duration_s) {
            return known.decays;
        }
        let decays = poles.map(|pole| decay(pole, duration_s));
        self.known[self.oldest] = Known { duration_s, decays };
        self.oldest = 1 - self.oldest;
        decays
    }
}

/// What 1 / (1 + a s + b s^2) makes of a cubic once everything else has died out: u - a u' + (a^2 - b) u'' + (2 a b - a^3) u'''.
fn settled([c0, c1, c2, c3]: [f64; 4], a: f64, b: f64) -> [f64; 4] {
    let (second, third) = (a * a - b, 2.0 * a * b - a * a * a);
    [c0 - a * c1 + 2.0 * second * c2 + 6.0 * third * c3, c1 - 2.0 * a * c2 + 6.0 * second * c3, c2 - 3.0 * a * c3, c3]
}

/// A cubic's value.
pub(super) fn at([c0, c1, c2, c3]: [f64; 4], t: f64) -> f64 {
    c0 + t * (c1 + t * (c2 + t * c3))
}

/// The same cubic with its time counted from `t` on.
pub(super) fn later(path @ [_, _, bend, twist]: [f64; 4], t: f64) -> [f64; 4] {
    [at(path, t), slope_at(path, t), bend + 3.0 * t * twist, twist]
}

/// Its slope.
pub(super) fn slope_at([_, c1, c2, c3]: [f64; 4], t: f64) -> f64 {
    c1 + t * (2.0 * c2 + t * 3.0 * c3)
}

fn moments([c0, c1, c2, c3]: [f64; 4], t: f64) -> Moments {
    Moments {
        zeroth: t * (c0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0))),
        first: t * t * (c0 / 2.0 + t * (c1 / 3.0 + t * (c2 / 4.0 + t * c3 / 5.0))),
        second: t * t * t * (c0 / 3.0 + t * (c1 / 4.0 + t * (c2 / 5.0 + t * c3 / 6.0))),
    }
}

/// exp(rate t) and its moments up to the second.
fn decay(rate: Complex<f64>, t: f64) -> Decay {
    // Most lags are of first order, and real numbers cost a third.
    if rate.im == 0.0 {
        let (end, moments) = decaying(rate.re, t);
        return Decay { end: end.into(), moments: moments.map(Complex::from) };
    }
    let (end, moments) = decaying(rate, t);
    Decay { end, moments }
}

/// The same. Where little decays, the closed forms would lose their digits in differences.
fn decaying<T: ComplexField<RealField = f64> + Copy>(rate: T, t: f64) -> (T, [T; 3]) {
    let real = T::from_real;
    let z = rate.scale(t);
    let end = z.exp();
    if z.norm1() < 1.0 {
        // Integral of s^2 exp(z s) over [0, 1] = sum of z^n / (n! (n + 3)); of what comes before, (exp(z) - k times it) = z times the one after.
        let (mut term, mut second) = (real(1.0), T::zero());
        for [factorial, moment] in SERIES {
            second += term.scale(moment);
            term *= z.scale(factorial);
            if term.norm1() < ROUNDING {
                break;
            }
        }
        let first = (end - z * second).scale(0.5);
        let zeroth = end - z * first;
        return (end, [zeroth.scale(t), first.scale(t * t), second.scale(t * t * t)]);
    }
    let zeroth = (end - real(1.0)) / rate;
    let first = (end.scale(t) - zeroth) / rate;
    (end, [zeroth, first, (end.scale(t * t) - first.scale(2.0)) / rate])
}

impl Moments {
    fn plus(self, decay: &Decay, amplitude: Complex<f64>) -> Self {
        let [zeroth, first, second] = decay.moments.map(|moment| (moment * amplitude).re);
        Self { zeroth: self.zeroth + zeroth, first: self.first + first, second: self.second + second }
    }

    /// These less `share` of them, and that share of the `other`.
    pub(super) fn mixed(self, other: Moments, share: f64) -> Self {
        let mix = |own: f64, other: f64| own + share * (other - own);
        Self {
            zeroth: mix(self.zeroth, other.zeroth),
            first: mix(self.first, other.first),
            second: mix(self.second, other.second),
        }
    }

    /// Adds the moments of a piece that begins `at_s` after the sum does.
    pub(super) fn add(&mut self, piece: Moments, at_s: f64) {
        self.second += piece.second + at_s * (2.0 * piece.first + at_s * piece.zeroth);
        self.first += piece.first + at_s * piece.zeroth;
        self.zeroth += piece.zeroth;
    }

    /// Adds `value` at `t` with the `weight` of a node of a quadrature.
    pub(super) fn add_node(&mut self, t: f64, weight: f64, value: f64) {
        self.zeroth += weight * value;
        self.first += weight * t * value;
        self.second += weight * t * t * value;
    }

    /// The parabola over `duration_s` that has these moments: its value, slope and second derivative at the start.
    pub(super) fn parabola(self, duration_s: f64) -> [f64; 3] {
        let per = 1.0 / duration_s;
        let (i0, i1, i2) = (self.zeroth * per, self.first * per * per, self.second * per * per * per);
        // In Legendre polynomials of s = t / duration: i0 + c1 (2 s - 1) + c2 (6 s^2 - 6 s + 1).
        let (c1, c2) = (3.0 * (2.0 * i1 - i0), 5.0 * (6.0 * (i2 - i1) + i0));
        [i0 - c1 + c2, (2.0 * c1 - 6.0 * c2) * per, 12.0 * c2 * per * per]
    }
}
