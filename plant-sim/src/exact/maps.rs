//! Matrix exponentials as ladders: the exact maps over a duration and over all its halves, from one scaling-and-squaring.

/// Column-major square matrix; `m[j][i]` is row i, column j.
pub(crate) type Columns<const N: usize> = [[f64; N]; N];

/// Degree of the Taylor polynomial on the finest step. With rate * step <= [`FINEST`] its remainder is below
/// (1/16)^9 / 9! = 4e-17 of the state, which is under rounding.
pub(crate) const DEGREE: usize = 8;
/// Largest product of fastest rate and finest step.
pub(crate) const FINEST: f64 = 1.0 / 16.0;

/// One, halved so often; exact, as the exponent is all that changes.
#[inline(always)]
pub(crate) fn halved(times: u32) -> f64 {
    f64::from_bits((1023 - u64::from(times.min(1022))) << 52)
}

/// y = a x.
#[inline(always)]
pub(crate) fn apply<const N: usize>(a: &Columns<N>, x: &[f64; N]) -> [f64; N] {
    let mut y = [0.0; N];
    for j in 0..N {
        for i in 0..N {
            y[i] += a[j][i] * x[j];
        }
    }
    y
}

/// a b.
fn multiply<const N: usize>(a: &Columns<N>, b: &Columns<N>) -> Columns<N> {
    let mut product = [[0.0; N]; N];
    for j in 0..N {
        product[j] = apply(a, &b[j]);
    }
    product
}

/// Exact response over one duration, for one set of open dead zones.
#[derive(Clone)]
pub(crate) struct Linear<const N: usize> {
    /// exp(A t).
    pub state: Columns<N>,
    /// Response to one newton held from the start.
    pub force: [f64; N],
    /// Response to a force that grows by one newton per second from zero.
    pub ramp: [f64; N],
    /// Response to a force t^2/2, in newton.
    pub curve: [f64; N],
    /// Integral of exp(A s) over the duration: response to constants in any state's equation.
    pub constant: Columns<N>,
}

impl<const N: usize> Default for Linear<N> {
    fn default() -> Self {
        Self { state: [[0.0; N]; N], force: [0.0; N], ramp: [0.0; N], curve: [0.0; N], constant: [[0.0; N]; N] }
    }
}

/// The maps over `duration / 2^level` for the levels `coarsest ..= finest`, coarsest first.
///
/// All maps come from the finest by doubling. exp(A t) - I is what is doubled, never exp(A t), because near the finest step the
/// identity would swallow the digits of A t: D(2t) = 2 D + D^2; Phi(2t) = 2 Phi + D Phi; Psi(2t) = Psi + exp(A t) Psi + t Phi b for the
/// ramp, and for the curve Chi(2t) = Chi + exp(A t) Chi + t Psi + t^2/2 Phi b.
pub(crate) fn ladder<const N: usize>(
    a: &Columns<N>,
    force: &[f64; N],
    duration_s: f64,
    coarsest: u32,
    finest: u32,
) -> Vec<Linear<N>> {
    let mut t = duration_s * halved(finest);
    // Phi = t (I + A t / 2! + (A t)^2 / 3! + ..), by Horner; D = A Phi; Psi = t^2 (I/2! + A t / 3! + ..) b; Chi = t^3 (I/3! + ..) b.
    let mut phi = [[0.0; N]; N];
    let (mut psi, mut chi) = ([0.0; N], [0.0; N]);
    for degree in (0..=DEGREE).rev() {
        let weight = t / (degree as f64 + 2.0);
        phi = multiply(a, &phi);
        for j in 0..N {
            for i in 0..N {
                phi[j][i] *= weight;
            }
            phi[j][j] += 1.0;
        }
        (psi, chi) = (apply(a, &psi), apply(a, &chi));
        let weights = [t / (degree as f64 + 3.0), t / (degree as f64 + 4.0)];
        for i in 0..N {
            psi[i] = psi[i] * weights[0] + force[i];
            chi[i] = chi[i] * weights[1] + force[i];
        }
    }
    for j in 0..N {
        for i in 0..N {
            phi[j][i] *= t;
        }
        psi[j] *= 0.5 * t * t;
        chi[j] *= t * t * t / 6.0;
    }
    let mut d = multiply(a, &phi);
    let mut maps = Vec::with_capacity((finest - coarsest + 1) as usize);
    let mut level = finest;
    loop {
        let mut state = d;
        for (j, column) in state.iter_mut().enumerate() {
            column[j] += 1.0;
        }
        let forced = apply(&phi, force);
        maps.push(Linear { state, force: forced, ramp: psi, curve: chi, constant: phi });
        if level == coarsest {
            break;
        }
        level -= 1;
        let (pushed, bent) = (apply(&d, &psi), apply(&d, &chi));
        for i in 0..N {
            chi[i] = 2.0 * chi[i] + bent[i] + t * psi[i] + 0.5 * t * t * forced[i];
            psi[i] = 2.0 * psi[i] + pushed[i] + t * forced[i];
        }
        let (d_phi, d_d) = (multiply(&d, &phi), multiply(&d, &d));
        for j in 0..N {
            for i in 0..N {
                phi[j][i] = 2.0 * phi[j][i] + d_phi[j][i];
                d[j][i] = 2.0 * d[j][i] + d_d[j][i];
            }
        }
        t *= 2.0;
    }
    maps.reverse();
    maps
}
