//! Numbers of chapter 3: the reduced plants, the loops' poles, Table 3.1, proposition 3.3.1.

use super::{Entry, Thesis, value};
use nalgebra::{Complex, DMatrix};
use plant_sim::linear::{poles, roots};
use plant_sim::phs::Phs;
use plant_sim::reduce::{quasi_static, speeds};
use plant_sim::stability::{Law, certify, closed_loop_matrix, proposition};

/// s^2 + psi s + k/M and the gain alpha/M.
#[derive(Clone, Copy)]
struct Second {
    gain: f64,
    psi: f64,
    constant: f64,
}

impl Second {
    fn of(plant: &Phs) -> Self {
        let m = plant.mass_kg;
        Self {
            gain: plant.transduction_c_per_m / m,
            psi: plant.damping_n_s_per_m / m,
            constant: plant.stiffness_n_per_m / m,
        }
    }

    fn open_poles(&self) -> Vec<Complex<f64>> {
        roots(&[1.0, self.psi, self.constant])
    }

    /// s^3 + psi s^2 + (k/M + g Kp) s + g Ki.
    fn closed_poles(&self, kp: f64, ki: f64) -> Vec<Complex<f64>> {
        roots(&[1.0, self.psi, self.constant + self.gain * kp, self.gain * ki])
    }

    fn damping_ratio(&self) -> f64 {
        self.psi / (2.0 * self.constant.sqrt())
    }
}

pub(super) fn design(thesis: &Thesis) -> Vec<Entry> {
    let plant = thesis.phs.chain().plant;
    let newid2 = thesis.newid2.chain().plant;
    let (m, alpha) = (plant.mass_kg, plant.transduction_c_per_m);
    let reduced = quasi_static(&plant, |_| true).map_or_else(|_| plant.clone(), |reduction| reduction.plant);
    let (phs2, step) = (Second::of(&reduced), Second::of(&newid2));
    let [kp1, ki1] = [thesis.pi1.kp_v_per_m.value, thesis.pi1.ki_v_per_m_s.value];
    let [kp2, ki2] = [thesis.pi2.kp_v_per_m.value, thesis.pi2.ki_v_per_m_s.value];
    // The errata are about (3.9) as it is printed, with psi cut off.
    let as_printed = Second { psi: value("22017"), ..phs2 };
    let open = as_printed.open_poles();
    let closed = as_printed.closed_poles(kp1, ki1);
    let tau_ms = |i: usize| speeds(&plant).get(i).map_or(f64::NAN, |speed| speed.time_constant_s * 1e3);
    let of = Entry::digits;
    let poles_cause = "the poles belong to another sum (21885) than the 22017 of (3.9)";
    let closed_cause = "they follow from the open-loop poles of (3.10), which are not those of (3.9)";
    let mut entries = vec![
        of("(3.9)", "numerator alpha/M", "45.64", phs2.gain, "m/(V s^2)"),
        Entry::erratum("(3.9)", "psi", "22017", phs2.psi, "1/s", "22018", "cut off (22017.66), not rounded"),
        of("(3.9)", "k/M", "2.422e7", phs2.constant, "1/s^2"),
        Entry::erratum("(3.10)", "open-loop pole 1", "-20716", open[1].re, "1/s", "-20856", poles_cause),
        Entry::erratum("(3.10)", "open-loop pole 2", "-1169", open[0].re, "1/s", "-1161.3", poles_cause),
        Entry::erratum("(3.13)", "closed-loop pole 1, PI 1", "-18612", closed[2].re, "1/s", "-18765", closed_cause),
        Entry::erratum("(3.13)", "closed-loop pole 2, PI 1", "-2195", closed[1].re, "1/s", "-2166", closed_cause),
        Entry::erratum("(3.13)", "closed-loop pole 3, PI 1", "-1078", closed[0].re, "1/s", "-1086.5", closed_cause),
        Entry::given("(3.14)", "Kp of PI 1, tuned by hand", "8.5811e5", "V/m"),
        Entry::given("(3.14)", "Ki of PI 1, tuned by hand", "9.6755e8", "V/(m s)"),
        Entry::given("(3.15)", "second identification, on steps: fit", "78.25", "%"),
        Entry::given("(3.16)", "Kp of PI 2, tuned by hand", "2.3164e4", "V/m"),
        Entry::given("(3.16)", "Ki of PI 2, tuned by hand", "1.8384e8", "V/(m s)"),
        of("(3.15)", "numerator, from the model file", "16.78", step.gain, "m/(V s^2)"),
        of("(3.15)", "psi, from the model file", "2555", step.psi, "1/s"),
        of("(3.15)", "k/M, from the model file", "9.539e6", step.constant, "1/s^2"),
        of("(3.21)", "alpha = 16.78 M", "0.017028", 16.78 * m, "C/m"),
        of("(3.22)", "k = 9.539e6 M", "9680.2", 9.539e6 * m, "N/m"),
        of("(3.23)", "b = 2555 M", "2.5928", 2555.0 * m, "N s/m"),
    ];
    // (3.24) from the printed b, which is rounded: what is left is the rounding.
    let [new_alpha, new_b] = [newid2.transduction_c_per_m, newid2.damping_n_s_per_m];
    let slope_of = |psi: f64, b: f64| (m * psi - b) / (2.0 * new_alpha * new_alpha);
    let slope = |psi: f64| slope_of(psi, new_b);
    entries.extend([
        of("(3.24)", "\"beta^-1 = beta1^-1 = beta2^-1\", from the rounded b", "0.024", slope(2555.0), "1/ohm"),
        of("erratum (3.24)", "what it is made of: M 2555 - 2.5928", "1.4e-5", m * 2555.0 - new_b, "N s/m"),
        of("erratum (3.24)", "with psi = 22017 in place of 2555", "3.4057e4", slope(22017.0), "1/ohm"),
        Entry::erratum(
            "(3.24)",
            "the same with b = 2555 M unrounded, as (3.23) defines it",
            "0.024",
            slope_of(2555.0, m * 2555.0),
            "1/ohm",
            "0",
            "a rounding residue: b is all of psi by assumption, so that nothing is left for the hysterons; the value carries no information",
        ),
        of("(3.26)", "damping ratio of PHS2", "2.24", phs2.damping_ratio(), ""),
        of("(3.27)", "damping ratio of NewId2", "0.41", step.damping_ratio(), ""),
        of("(3.28)", "feedforward k/alpha with Table 2.1", "530737.8", plant.stiffness_n_per_m / alpha, "V/m"),
        Entry::refuted(
            "(3.6)",
            "time constant of hysteron 2, whose dynamics are neglected",
            "\"the electrical part is faster than the mechanical\"",
            tau_ms(1),
            "ms",
            "4.52",
            "true of hysteron 1 (0.94 us) only: hysteron 2 is twenty times slower than the mechanics (0.2 ms), so that the second-order \
             model's over-damping is an artefact of the reduction",
        ),
    ]);
    let nonlinear = closed_loop_matrix(&plant, kp1, ki1);
    entries.push(of(
        "erratum (3.6)",
        "the loop with both hysterons rings at",
        "8e3",
        poles(&nonlinear).iter().map(|z| z.im).fold(0.0, f64::max),
        "rad/s",
    ));
    let second = step.closed_poles(kp2, ki2);
    let pair = second.iter().find(|z| z.im > 0.0).copied().unwrap_or_default();
    let real = second.iter().find(|z| z.im == 0.0).map_or(f64::NAN, |z| z.re);
    entries.extend([
        Entry::refuted(
            "3.1.2",
            "damping ratio of the closed loop with PI 2",
            "\"an overdamped system\"",
            -pair.re / pair.norm(),
            "",
            "0.37",
            "the pair of (3.15) stays a pair: the integrator's zero adds a slow real pole that hides it in the step",
        ),
        of("erratum 3.1.2", "its pair, real part", "-1109.5", pair.re, "1/s"),
        of("erratum 3.1.2", "its pair, imaginary part", "2819.8", pair.im, "rad/s"),
        of("erratum 3.1.2", "its real pole", "-336.0", real, "1/s"),
    ]);
    entries.extend(table_3_1(&plant, &newid2));
    entries
}

fn table_3_1(plant: &Phs, newid2: &Phs) -> Vec<Entry> {
    let of = |what: &str, printed: &str, ours: f64, unit| Entry::digits("Table 3.1", what, printed, ours, unit);
    vec![
        of("M, old and new", "1.0148e-3", plant.mass_kg, "kg"),
        of("k, old", "24579", plant.stiffness_n_per_m, "N/m"),
        of("k, new", "9680.2", newid2.stiffness_n_per_m, "N/m"),
        of("b, old", "3.7356", plant.damping_n_s_per_m, "N s/m"),
        of("b, new", "2.5928", newid2.damping_n_s_per_m, "N s/m"),
        of("alpha, old", "0.046311", plant.transduction_c_per_m, "C/m"),
        of("alpha, new", "0.017028", newid2.transduction_c_per_m, "C/m"),
        of("slope of hysteron 1, old", "0.6002", plant.hysterons[0].slope_s, "S"),
        of("slope of hysteron 2, old", "1.1528e-4", plant.hysterons[1].slope_s, "S"),
    ]
}

pub(super) fn stability(thesis: &Thesis) -> Vec<Entry> {
    let plant = thesis.phs.chain().plant;
    let [kp, ki] = [thesis.pi1.kp_v_per_m.value, thesis.pi1.ki_v_per_m_s.value];
    let mut entries = Vec::new();
    // As printed, with + B K2: the integral pushes the wrong way.
    let mut printed: DMatrix<f64> = closed_loop_matrix(&plant, kp, ki);
    let (p, z) = (plant.hysterons.len() + 1, plant.hysterons.len() + 2);
    printed[(p, z)] = -printed[(p, z)];
    let unstable = poles(&printed).iter().map(|z| z.re).fold(f64::NEG_INFINITY, f64::max);
    let of = Entry::digits;
    let what = "rightmost pole with + B K2 and M = [0 0 1 0]: unstable, so that - B K2 is meant";
    let cause = "the sign of K2 or of M is wrong in print; the thesis' own eigenvalues of P G are those of - B K2. (The project's first \
                 erratum had 638, cut off from 638.51.)";
    entries.push(Entry::erratum("(3.29)", what, "638", unstable, "1/s", "638.5", cause));
    let Some(found) = proposition(&plant, kp, ki) else {
        return entries;
    };
    let pole = |i: usize| found.poles_per_s.get(i).copied().unwrap_or_default();
    let pair = found.poles_per_s.iter().find(|z| z.im > 0.0).copied().unwrap_or_default();
    let eigenvalue = |i: usize| found.eigenvalues_of_pg.get(i).copied().unwrap_or(f64::NAN);
    entries.extend([
        of("erratum (3.29)", "with - B K2: fastest pole", "-1.0637e6", pole(0).re, "1/s"),
        of("erratum (3.29)", "with - B K2: pair, real part", "-1511.8", pair.re, "1/s"),
        of("erratum (3.29)", "with - B K2: pair, imaginary part", "7946.6", pair.im, "rad/s"),
        of("erratum (3.29)", "with - B K2: real pole", "-653.9", pole(3).re, "1/s"),
        of("erratum (3.29)", "with - B K2: slowest pole", "-228.2", pole(4).re, "1/s"),
        of("(3.31)", "largest eigenvalue of P G", "0.022653084227172", eigenvalue(0), ""),
        of("(3.31)", "second eigenvalue of P G", "1.458464736e-6", eigenvalue(1), ""),
        of("(3.31)", "lambda_min(Q) / (2 lambda_max(P G))", "22.072", found.bound, ""),
        of("(3.31)", "max beta, left of the inequality", "0.6002", found.largest_slope_s, "S"),
        Entry::refuted(
            "(3.31)",
            "left of the inequality in the unit of its right side: max beta/C",
            "\"the inequality holds\"",
            found.largest_rate_per_s,
            "1/s",
            "1.0637e6",
            "the states are charges, so that the dead zones act by beta/C; siemens are smaller by C. With its units right the inequality \
             fails, and for any Q: a hysteron inside its dead zone keeps its charge, so that no quadratic function of all the states falls",
        ),
    ]);
    let proof = certify(&plant, Law::Continuous { kp_v_per_m: kp, ki_v_per_m_s: ki });
    entries.push(of(
        "3.3",
        "the claim itself, by another storage function: 1 if certified",
        "1",
        f64::from(u8::from(proof.is_certified)),
        "",
    ));
    entries
}
