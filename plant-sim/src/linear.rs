//! Linear plants: state space and transfer functions, their poles, responses and sampled forms.
//!
//! `x' = A x + B u`, `y = C x + D u`, and `G(s) = (b0 s^m + .. + bm) / (a0 s^n + .. + an)`, m <= n. Volts in, metres out.
//!
//! Not here: the hysteron plant's own linear regions ([`crate::margins`]), and stepping in time ([`crate::exact`]).

use crate::margins::{LinearRegion, balance};
use nalgebra::{Complex, DMatrix, DVector, RowDVector};

/// A linear plant in state space.
#[derive(Clone, Debug, PartialEq)]
pub struct StateSpace {
    /// A, 1/s.
    pub a: DMatrix<f64>,
    /// B, per volt and second.
    pub b: DVector<f64>,
    /// C, metres.
    pub c: RowDVector<f64>,
    /// D, m/V.
    pub d: f64,
}

/// A linear plant as a quotient of polynomials, highest power first.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFunction {
    /// b0 .. bm.
    pub numerator: Vec<f64>,
    /// a0 .. an.
    pub denominator: Vec<f64>,
}

impl StateSpace {
    /// Its frequency response at `hz`, m/V; `None` on a pole.
    pub fn response(&self, hz: f64) -> Option<Complex<f64>> {
        self.at(Complex::new(0.0, std::f64::consts::TAU * hz))
    }

    /// G(s).
    pub fn at(&self, s: Complex<f64>) -> Option<Complex<f64>> {
        let mut a = self.a.clone();
        let scale = balance(&mut a);
        let n = a.nrows();
        let matrix = DMatrix::from_fn(n, n, |i, j| {
            let diagonal = if i == j { s } else { Complex::from(0.0) };
            diagonal - a[(i, j)]
        });
        let b = DVector::from_fn(n, |i, _| Complex::from(self.b[i] / scale[i]));
        let x = matrix.lu().solve(&b)?;
        let y: Complex<f64> = (0..n).map(|i| x[i] * (self.c[i] * scale[i])).sum();
        Some(y + self.d)
    }

    /// Its poles, 1/s, slowest first.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        poles(&self.a)
    }

    /// The same plant, its first state the output without feedthrough. `None` if nothing of the state is seen.
    pub(crate) fn output_first(&self) -> Option<Self> {
        let n = self.a.nrows();
        // Only one state is exchanged for the output, that of the largest share, so that the others keep their scales.
        let mut a = self.a.clone();
        let scale = balance(&mut a);
        let pivot = (0..n).filter(|&i| self.c[i] != 0.0).max_by(|&i, &j| {
            let share = |k: usize| (self.c[k] * scale[k]).abs();
            share(i).total_cmp(&share(j))
        })?;
        let order: Vec<usize> = std::iter::once(pivot).chain((0..n).filter(|&i| i != pivot)).collect();
        // z = T x: z0 = C x, the others as they are.
        let forward =
            DMatrix::from_fn(n, n, |i, j| if i == 0 { self.c[j] } else { f64::from(u8::from(order[i] == j)) });
        let back = DMatrix::from_fn(n, n, |i, j| match (i == pivot, j) {
            (true, 0) => 1.0 / self.c[pivot],
            (true, _) => -self.c[order[j]] / self.c[pivot],
            (false, 0) => 0.0,
            (false, _) => f64::from(u8::from(order[j] == i)),
        });
        let c = RowDVector::from_fn(n, |_, j| if j == 0 { 1.0 } else { 0.0 });
        let turned = Self { a: &forward * &self.a * back, b: forward * &self.b, c, d: self.d };
        Some(if n > 1 { turned } else { turned.with_idle_state() })
    }

    /// With one more state that nothing drives and nothing sees: an engine has at least two.
    fn with_idle_state(self) -> Self {
        let n = self.a.nrows();
        let mut a = self.a.resize(n + 1, n + 1, 0.0);
        a[(n, n)] = -1.0;
        let (b, c) = (self.b.resize_vertically(n + 1, 0.0), self.c.resize_horizontally(n + 1, 0.0));
        Self { a, b, c, d: self.d }
    }

    /// The state under a constant `u`; `None` if it integrates.
    pub fn steady_state(&self, u: f64) -> Option<DVector<f64>> {
        let mut a = self.a.clone();
        let scale = balance(&mut a);
        let b = DVector::from_fn(scale.len(), |i, _| -self.b[i] * u / scale[i]);
        let x = a.lu().solve(&b)?;
        Some(DVector::from_fn(scale.len(), |i, _| x[i] * scale[i]))
    }

    /// y over constant u; `None` if it integrates.
    pub fn static_gain(&self) -> Option<f64> {
        Some((&self.c * self.steady_state(1.0)?)[0] + self.d)
    }

    /// The plant as a region for margins.
    pub fn region(&self, label: &str) -> LinearRegion {
        LinearRegion { label: label.to_owned(), a: self.a.clone(), b: self.b.clone(), c: self.c.clone(), d: self.d }
    }
}

impl From<&LinearRegion> for StateSpace {
    fn from(region: &LinearRegion) -> Self {
        Self { a: region.a.clone(), b: region.b.clone(), c: region.c.clone(), d: region.d }
    }
}

impl TransferFunction {
    /// n.
    pub fn order(&self) -> usize {
        self.denominator.len().saturating_sub(1)
    }

    /// G(j 2 pi hz), m/V.
    pub fn response(&self, hz: f64) -> Complex<f64> {
        let s = Complex::new(0.0, std::f64::consts::TAU * hz);
        let value = |polynomial: &[f64]| polynomial.iter().fold(Complex::from(0.0), |sum, c| sum * s + *c);
        value(&self.numerator) / value(&self.denominator)
    }

    /// Roots of the denominator, 1/s, slowest first.
    pub fn poles(&self) -> Vec<Complex<f64>> {
        roots(&self.denominator)
    }

    /// Roots of the numerator, 1/s.
    pub fn zeros(&self) -> Vec<Complex<f64>> {
        roots(&self.numerator)
    }

    /// In controllable canonical form, its states scaled so that they are of one size; `None` if it is not proper or a0 is zero.
    pub fn state_space(&self) -> Option<StateSpace> {
        let n = self.order();
        let lead = *self.denominator.first()?;
        let numerator: Vec<f64> = self.numerator.iter().copied().skip_while(|b| *b == 0.0).collect();
        if n == 0 || lead == 0.0 || numerator.len() > n + 1 {
            return None;
        }
        let a: Vec<f64> = self.denominator.iter().map(|c| c / lead).collect();
        let mut b = vec![0.0; n + 1 - numerator.len()];
        b.extend(numerator.iter().map(|c| c / lead));
        let d = b[0];
        // A typical rate, so that state i, the i-th derivative, is measured in rate^i.
        let rate = a[n].abs().powf(1.0 / n as f64);
        let rate = if rate > 0.0 { rate } else { 1.0 };
        let power = |i: usize| rate.powi(i as i32);
        let mut matrix = DMatrix::zeros(n, n);
        for i in 0..n - 1 {
            matrix[(i, i + 1)] = rate;
        }
        for i in 0..n {
            matrix[(n - 1, i)] = -a[n - i] * power(i) / power(n - 1);
        }
        let mut input = DVector::zeros(n);
        input[n - 1] = 1.0 / power(n - 1);
        let output = RowDVector::from_fn(n, |_, i| (b[n - i] - a[n - i] * d) * power(i));
        Some(StateSpace { a: matrix, b: input, c: output, d })
    }
}

/// Eigenvalues, slowest first, of a matrix in any units.
pub fn poles(a: &DMatrix<f64>) -> Vec<Complex<f64>> {
    let mut a = a.clone();
    balance(&mut a);
    let mut found: Vec<Complex<f64>> = a.complex_eigenvalues().iter().copied().collect();
    found.sort_by(|l, r| l.norm().total_cmp(&r.norm()).then(l.im.total_cmp(&r.im)));
    found
}

/// Roots of a polynomial, highest power first, slowest first.
pub fn roots(polynomial: &[f64]) -> Vec<Complex<f64>> {
    let from = polynomial.iter().position(|c| *c != 0.0).unwrap_or(polynomial.len());
    let p = &polynomial[from..];
    if p.len() < 2 {
        return Vec::new();
    }
    let n = p.len() - 1;
    let companion =
        DMatrix::from_fn(n, n, |i, j| if i == 0 { -p[j + 1] / p[0] } else { f64::from(u8::from(i == j + 1)) });
    poles(&companion)
}

/// Coefficients, highest power first, of prod(s - root); roots come in conjugate pairs.
pub fn polynomial(roots: &[Complex<f64>]) -> Vec<f64> {
    let mut coefficients = vec![Complex::from(1.0)];
    for root in roots {
        let mut next = coefficients.clone();
        next.push(Complex::from(0.0));
        for (i, c) in coefficients.iter().enumerate() {
            next[i + 1] -= *c * *root;
        }
        coefficients = next;
    }
    coefficients.iter().map(|c| c.re).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn newid2() -> TransferFunction {
        TransferFunction { numerator: vec![16.78], denominator: vec![1.0, 2555.0, 9.539e6] }
    }

    #[test]
    fn both_forms_answer_alike() {
        let zero = TransferFunction { numerator: vec![1e-9, 3e-6, 2.0], denominator: vec![2.0, 500.0, 7e6] };
        let third = TransferFunction { numerator: vec![5.0, 9e3], denominator: vec![1.0, 30.0, 1e6, 2e7] };
        for tf in [newid2(), zero, third] {
            let space = tf.state_space().expect("proper");
            let turned = space.output_first().expect("seen");
            for hz in [0.1, 30.0, 491.0, 2e4] {
                let direct = tf.response(hz);
                for form in [&space, &turned] {
                    let ours = form.response(hz).expect("no pole there");
                    // Both are sums of a handful of terms: some roundings.
                    assert!((ours - direct).norm() < 1e-12 * direct.norm(), "{hz}: {ours} {direct}");
                }
            }
            let gain = tf.numerator.last().unwrap() / tf.denominator.last().unwrap();
            assert!((space.static_gain().unwrap() / gain - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn roots_and_coefficients_are_inverse() {
        let tf = newid2();
        let back = polynomial(&tf.poles());
        for (ours, given) in back.iter().zip(&tf.denominator) {
            assert!((ours / given - 1.0).abs() < 1e-12, "{back:?}");
        }
        assert_eq!(roots(&[0.0, 0.0, 2.0]), []);
        assert!(
            TransferFunction { numerator: vec![1.0, 0.0, 0.0], denominator: vec![1.0, 2.0] }.state_space().is_none()
        );
    }
}
