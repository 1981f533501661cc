//! The port-Hamiltonian hysteron plant: equations, energy, equilibrium. How it is stepped in time is [`crate::exact`]'s business.
//!
//! x' = (J - D(x)) dH/dx + g u with x = [Q1 .. Qn, q, p] and u = [V, Fext] (Caballeria, Ramirez and Le Gorrec; equations (2.4)-(2.9)
//! of the thesis):
//!
//! ```text
//! q'  = p/M
//! p'  = -alpha sum_i Qi/Ci - k q - b p/M + alpha V - Fext
//! Qi' = -h_i(Qi/Ci) + alpha p/M
//! H   = 1/2 (sum_i Qi^2/Ci + k q^2 + p^2/M)
//! ```
//!
//! | letter | meaning | unit | field |
//! | --- | --- | --- | --- |
//! | M | moving mass | kg | `mass_kg` |
//! | b | viscous damping | N s/m | `damping_n_s_per_m` |
//! | k | stiffness | N/m | `stiffness_n_per_m` |
//! | alpha | transduction (also N/V) | C/m | `transduction_c_per_m` |
//! | Ci | capacitance of hysteron i | F | `capacitance_f` |
//! | beta_i | slope of the admittance h_i outside its dead zone | S | `slope_s` |
//! | d_i | full width of the dead zone of h_i | V | `dead_zone_v` |

use nalgebra::{DMatrix, DVector};

/// One hysteron: a capacitor that leaks through an admittance with a dead zone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hysteron {
    /// C, capacitance in farad; positive.
    pub capacitance_f: f64,
    /// beta, slope of the admittance outside the dead zone in siemens; not negative.
    pub slope_s: f64,
    /// d, full width of the dead zone in volts; not negative. Zero makes a plain creep element.
    pub dead_zone_v: f64,
}

impl Hysteron {
    /// Half the width of the dead zone: the voltage at which the hysteron opens, in volts.
    pub fn edge_v(&self) -> f64 {
        0.5 * self.dead_zone_v
    }

    /// h(v), current in ampere through the admittance at `voltage_v` (equation (2.6)).
    pub fn current_a(&self, voltage_v: f64) -> f64 {
        let beyond_v = (voltage_v.abs() - self.edge_v()).max(0.0);
        self.slope_s * beyond_v.copysign(voltage_v)
    }
}

/// Parameters of the plant.
#[derive(Clone, Debug, PartialEq)]
pub struct Phs {
    /// M, moving mass in kg.
    pub mass_kg: f64,
    /// b, viscous damping in N s/m.
    pub damping_n_s_per_m: f64,
    /// k, stiffness in N/m without the hysterons.
    pub stiffness_n_per_m: f64,
    /// alpha, transduction in C/m, which is also N/V.
    pub transduction_c_per_m: f64,
    /// The hysterons, any number of them.
    pub hysterons: Vec<Hysteron>,
}

/// The plant's state in the variables that are continuous and measurable in principle.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct PhsState {
    /// q, displacement in metres.
    pub displacement_m: f64,
    /// p/M, velocity in m/s.
    pub velocity_m_per_s: f64,
    /// Qi/Ci, voltage of each hysteron.
    pub hysteron_v: Vec<f64>,
}

impl Phs {
    /// J, interconnection, for x = [Q1 .. Qn, q, p]; skew-symmetric.
    pub fn interconnection(&self) -> DMatrix<f64> {
        let n = self.hysterons.len();
        let mut j = DMatrix::zeros(n + 2, n + 2);
        for i in 0..n {
            j[(i, n + 1)] = self.transduction_c_per_m;
            j[(n + 1, i)] = -self.transduction_c_per_m;
        }
        j[(n, n + 1)] = 1.0;
        j[(n + 1, n)] = -1.0;
        j
    }

    /// D(x), dissipation: diag(h_i(v_i)/v_i .., 0, b); positive semi-definite.
    pub fn dissipation(&self, state: &PhsState) -> DMatrix<f64> {
        let mut diagonal: Vec<f64> = self
            .hysterons
            .iter()
            .zip(&state.hysteron_v)
            .map(|(hysteron, &v)| if v == 0.0 { 0.0 } else { hysteron.current_a(v) / v })
            .collect();
        diagonal.extend([0.0, self.damping_n_s_per_m]);
        DMatrix::from_diagonal(&DVector::from_vec(diagonal))
    }

    /// g, input map for u = [V, Fext]; the power-conjugate outputs are [alpha p/M, -p/M].
    pub fn input_map(&self) -> DMatrix<f64> {
        let n = self.hysterons.len();
        let mut g = DMatrix::zeros(n + 2, 2);
        g[(n + 1, 0)] = self.transduction_c_per_m;
        g[(n + 1, 1)] = -1.0;
        g
    }

    /// dH/dx = [Q1/C1 .., k q, p/M].
    pub fn energy_gradient(&self, state: &PhsState) -> DVector<f64> {
        let mut gradient = state.hysteron_v.clone();
        gradient.extend([self.stiffness_n_per_m * state.displacement_m, state.velocity_m_per_s]);
        DVector::from_vec(gradient)
    }

    /// H, stored energy in joule.
    pub fn energy_j(&self, state: &PhsState) -> f64 {
        let electric: f64 = self.hysterons.iter().zip(&state.hysteron_v).map(|(h, v)| h.capacitance_f * v * v).sum();
        let mechanic =
            self.stiffness_n_per_m * state.displacement_m.powi(2) + self.mass_kg * state.velocity_m_per_s.powi(2);
        0.5 * (electric + mechanic)
    }

    /// Time derivative of [q, q', v1 .. vn] under drive `drive_v` and external force `force_n`, straight from the equations above.
    pub fn derivative(&self, state: &PhsState, drive_v: f64, force_n: f64) -> PhsState {
        let hysteron_sum_v: f64 = state.hysteron_v.iter().sum();
        let force = self.transduction_c_per_m * (drive_v - hysteron_sum_v)
            - self.stiffness_n_per_m * state.displacement_m
            - self.damping_n_s_per_m * state.velocity_m_per_s
            - force_n;
        PhsState {
            displacement_m: state.velocity_m_per_s,
            velocity_m_per_s: force / self.mass_kg,
            hysteron_v: self
                .hysterons
                .iter()
                .zip(&state.hysteron_v)
                .map(|(h, &v)| (self.transduction_c_per_m * state.velocity_m_per_s - h.current_a(v)) / h.capacitance_f)
                .collect(),
        }
    }

    /// The relaxed state: everything zero.
    pub fn relaxed(&self) -> PhsState {
        PhsState { hysteron_v: vec![0.0; self.hysterons.len()], ..PhsState::default() }
    }

    /// The equilibrium (2.9) that holds the given hysteron voltages under constant drive and force: displacement in metres.
    pub fn equilibrium_m(&self, drive_v: f64, force_n: f64, hysteron_v: &[f64]) -> f64 {
        let held_v: f64 = hysteron_v.iter().sum();
        (self.transduction_c_per_m * (drive_v - held_v) - force_n) / self.stiffness_n_per_m
    }

    /// alpha/k, displacement per volt once every hysteron has relaxed, in m/V.
    pub fn static_gain_m_per_v(&self) -> f64 {
        self.transduction_c_per_m / self.stiffness_n_per_m
    }
}
