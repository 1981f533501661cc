//! Hysteresis operators: each has the property that defines it, and lacks those that others are defined by.

use plant_sim::bouc_wen::BoucWen;
use plant_sim::chain::{Chain, Drive, DriveHysteresis, Force, Heat, Lag, Parts, Warming};
use plant_sim::log::{Hold, Log};
use plant_sim::operators::{Counts, Dahl, Duhem, KrasnoselskiiPokrovskii, Law, Operator, Play, Plays, Preisach};
use plant_sim::replay::{Start, predict};
use proptest::prelude::*;
use std::f64::consts::TAU;

const REACH_V: f64 = 100.0;

fn plays(counts: Counts) -> Law {
    let of = |(threshold_v, weight_per_v)| Play::upright(threshold_v, weight_per_v);
    Law::Plays(Plays { plays: [(3.0, 0.2), (11.0, 0.5), (27.0, 0.1), (60.0, 0.4)].map(of).into(), counts })
}

fn levels(from_v: f64, to_v: f64, count: usize) -> Vec<f64> {
    (0..count).map(|i| from_v + (to_v - from_v) * (i as f64 / (count - 1) as f64).powf(1.2)).collect()
}

fn weights(rows: usize) -> Vec<f64> {
    (0..rows * (rows + 1) / 2).map(|i| 0.05 + 0.04 * (3.7 * i as f64).sin()).collect()
}

fn preisach() -> Preisach {
    Preisach { level_v: levels(-90.0, 105.0, 7), weight: weights(6) }
}

fn kernels() -> Law {
    Law::KrasnoselskiiPokrovskii(KrasnoselskiiPokrovskii {
        level_v: levels(-95.0, 70.0, 6),
        weight: weights(6),
        ramp_v: 33.0,
    })
}

fn dahl(exponent: f64) -> Law {
    Law::Dahl(Dahl { rate_per_v: 0.04, exponent })
}

fn duhem() -> Law {
    Law::Duhem(Duhem { rate_per_v: 0.05, slope_per_v: 0.02, inner_slope_per_v: 0.014 })
}

fn bouc_wen() -> Law {
    Law::BoucWen(BoucWen { amplitude: 0.008743, beta: 0.00637, gamma: 0.0144905, exponent: 1.0 })
}

fn with_memory_of_loops() -> Vec<Law> {
    vec![plays(Counts::Places), plays(Counts::Lags), Law::Preisach(preisach()), kernels()]
}

fn all() -> Vec<Law> {
    let mut all = with_memory_of_loops();
    all.extend([dahl(0.5), dahl(1.0), dahl(1.7), duhem(), bouc_wen()]);
    all
}

/// An operator where voltages have brought it.
#[derive(Clone)]
struct Walk<'a> {
    operator: &'a dyn Operator,
    memory: Vec<f64>,
    at_v: f64,
}

impl<'a> Walk<'a> {
    fn new(law: &'a Law) -> Self {
        let operator = law.operator();
        Self { operator, memory: operator.relaxed(), at_v: 0.0 }
    }

    fn to(mut self, voltages: &[f64]) -> Self {
        for &to_v in voltages {
            if to_v != self.at_v {
                self.operator.pass(&mut self.memory, self.at_v, to_v);
                self.at_v = to_v;
            }
        }
        self
    }

    fn h(&self) -> f64 {
        self.operator.h(&self.memory, self.at_v)
    }
}

fn volts() -> impl Strategy<Value = f64> {
    -REACH_V..REACH_V
}

fn history() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(volts(), 0..12)
}

/// A loop from one end to the other and back, as h above its lower left corner at some voltages.
fn minor_loop(walk: Walk<'_>, low_v: f64, high_v: f64) -> Vec<f64> {
    let at = |share: f64| low_v + share * (high_v - low_v);
    // Around once, so that nothing within the loop is remembered.
    let mut walk = walk.to(&[low_v, high_v, low_v]);
    let corner = walk.h();
    let mut course = Vec::new();
    for share in [0.1, 0.35, 0.7, 1.0, 0.8, 0.4, 0.2, 0.0] {
        walk = walk.to(&[at(share)]);
        course.push(walk.h() - corner);
    }
    course
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn relaxed_is_zero_and_equations_hold_at_small_moves() {
    for law in all() {
        assert!(Walk::new(&law).h().abs() < 1e-12, "{law:?}");
    }
    // dh/dV after a move, by a small one more.
    let slope = |law: &Law, history: &[f64], towards: f64| {
        let walk = Walk::new(law).to(history);
        let before = walk.h();
        let by = 1e-5 * towards;
        let end_v = walk.at_v;
        (before, end_v, (walk.to(&[end_v + by]).h() - before) / by)
    };
    for (history, s) in [(&[40.0][..], 1.0), (&[40.0], -1.0), (&[40.0, -70.0], -1.0), (&[40.0, -70.0, 5.0], 1.0)] {
        for i in [0.5, 1.0, 1.7] {
            let (h, _, found) = slope(&dahl(i), history, s);
            let wanted = 0.04 * (1.0 - s * h).powf(i);
            assert!((found - wanted).abs() < 1e-7, "Dahl {i}: {found} {wanted}");
        }
        let (h, v, found) = slope(&duhem(), history, s);
        let wanted = s * 0.05 * (0.02 * v - h) + 0.014;
        assert!((found - wanted).abs() < 1e-7, "Duhem: {found} {wanted}");
    }
}

/// Preisach's operator by its definition: many relays in each cell.
#[test]
fn preisach_is_a_sum_of_relays() {
    let law = preisach();
    let (rows, fine) = (law.level_v.len() - 1, 40);
    let mut relays = Vec::new();
    for up in 0..rows {
        for down in 0..=up {
            let inside = |cell: usize, k: usize| {
                law.level_v[cell] + (law.level_v[cell + 1] - law.level_v[cell]) * (k as f64 + 0.5) / fine as f64
            };
            let cell: Vec<[f64; 2]> = (0..fine)
                .flat_map(|i| (0..fine).map(move |j| (i, j)))
                .filter(|(i, j)| up != down || i >= j)
                .map(|(i, j)| [inside(up, i), inside(down, j)])
                .collect();
            let weight = law.weight[up * (up + 1) / 2 + down] / cell.len() as f64;
            relays.extend(cell.into_iter().map(|at| (at, weight)));
        }
    }
    let voltages = [104.0, -89.0, 60.0, -40.0, 35.0, -10.0, 20.0, 50.0, -60.0, 90.0, -20.0, 0.0];
    // From the lower end, so that both have forgotten how they began.
    let mut state = vec![-1.0; relays.len()];
    let whole = Law::Preisach(law.clone());
    let mut walk = Walk::new(&whole).to(&[-90.0]);
    let (zero, mut at_v) = (walk.h() + law.weight.iter().sum::<f64>(), -90.0);
    for to_v in voltages {
        for (state, ([up_v, down_v], _)) in state.iter_mut().zip(&relays) {
            if to_v > at_v && to_v >= *up_v {
                *state = 1.0;
            } else if to_v < at_v && to_v <= *down_v {
                *state = -1.0;
            }
        }
        walk = walk.to(&[to_v]);
        at_v = to_v;
        let by_relays: f64 = state.iter().zip(&relays).map(|(state, (_, weight))| state * weight).sum();
        let total: f64 = law.weight.iter().sum();
        assert!((walk.h() - zero - by_relays).abs() < 0.03 * total, "{to_v}: {} {by_relays}", walk.h() - zero);
    }
}

#[test]
fn loops_of_maxwell_slip_are_masings() {
    let law = plays(Counts::Lags);
    let virgin = |v: f64| Walk::new(&law).to(&[v]).h();
    let top = Walk::new(&law).to(&[80.0]);
    for v in [70.0, 31.0, 0.0, -44.0, -79.0] {
        let branch = top.h() - top.clone().to(&[v]).h();
        assert!((branch - 2.0 * virgin(0.5 * (80.0 - v))).abs() < 1e-12, "{v}");
    }
    // Bouc-Wen's are not: beyond a turn its slope is not the virgin one.
    let law = bouc_wen();
    let virgin = |v: f64| Walk::new(&law).to(&[v]).h();
    let top = Walk::new(&law).to(&[80.0]);
    assert!((top.h() - top.clone().to(&[0.0]).h() - 2.0 * virgin(40.0)).abs() > 0.01);
}

#[test]
fn plays_that_lean_or_bow_add_what_the_voltage_says() {
    let of = |weights: [f64; 3]| {
        let [weight_per_v, lean_per_v2, bow_per_v3] = weights;
        let play = |threshold_v| Play { threshold_v, weight_per_v, lean_per_v2, bow_per_v3 };
        Law::Plays(Plays { plays: [4.0, 25.0].map(play).into(), counts: Counts::Lags })
    };
    let path = [70.0, -20.0, 31.0, 5.0, -64.0, 12.0];
    let mirrored = path.map(|v| -v);
    for until in 1..=path.len() {
        let at = |weights, path: &[f64]| Walk::new(&of(weights)).to(&path[..until]).h();
        let v = path[until - 1];
        let upright = at([0.02, 0.0, 0.0], &path);
        let all = at([0.02, 3e-4, 5e-6], &path);
        assert!((all - upright * (1.0 + 3e-4 / 0.02 * v + 5e-6 / 0.02 * v * v)).abs() < 1e-12, "{until}");
        // What leans is the same on the mirrored path, what bows is mirrored.
        let (lean, bow) = ([0.0, 3e-4, 0.0], [0.0, 0.0, 5e-6]);
        assert!((at(lean, &path) - at(lean, &mirrored)).abs() < 1e-12, "{until}");
        assert!((at(bow, &path) + at(bow, &mirrored)).abs() < 1e-12, "{until}");
        assert!(at(lean, &path).abs() > 1e-3 && at(bow, &path).abs() > 1e-4, "{until}");
    }
}

#[test]
fn dahl_ends_at_one_and_duhem_in_its_loop() {
    for exponent in [0.5, 1.0, 1.7] {
        let law = dahl(exponent);
        let walk = Walk::new(&law).to(&[1e5]);
        assert!(walk.h() <= 1.0 && walk.h() > 0.99, "{exponent}: {}", walk.h());
        assert!(walk.clone().to(&[-1e5]).h() < -0.99);
        // Bristle by bristle: a small loop is no closed one, so that nothing is wiped out.
        let (before, after) = (Walk::new(&law).to(&[20.0]), Walk::new(&law).to(&[20.0, 5.0, 20.0]));
        assert!((before.h() - after.h()).abs() > 1e-4, "{exponent}");
    }
    let law = duhem();
    let ends = |start_v: f64| {
        let mut walk = Walk::new(&law).to(&[start_v]);
        let mut loops = Vec::new();
        for _ in 0..20 {
            walk = walk.to(&[-50.0, 50.0]);
            loops.push(walk.h());
        }
        loops
    };
    let (one, other) = (ends(100.0), ends(-100.0));
    // Both begin elsewhere and end in the loop that the equation has: off = behind tanh(rho 50).
    let limit = 0.02 * 50.0 + (0.014 - 0.02) / 0.05 * (0.05 * 50.0f64).tanh();
    assert!((one[19] - limit).abs() < 1e-12 && (other[19] - limit).abs() < 1e-12, "{} {limit}", one[19]);
    let law = Law::Duhem(Duhem { rate_per_v: 0.005, slope_per_v: 0.02, inner_slope_per_v: 0.014 });
    let first = |start_v: f64| Walk::new(&law).to(&[start_v, -50.0, 50.0]).h();
    assert!((first(100.0) - first(-100.0)).abs() > 1e-3, "its memory fades, it isn't wiped out");
}

proptest! {
    #[test]
    fn the_pace_is_of_no_account(history in history(), to in volts(), share in 0.0..1.0f64) {
        for law in all() {
            let walk = Walk::new(&law).to(&history);
            let middle = walk.at_v + share * (to - walk.at_v);
            let (whole, halves) = (walk.clone().to(&[to]), walk.clone().to(&[middle, to]));
            prop_assert!((whole.h() - halves.h()).abs() < 1e-11, "{law:?}: {} {}", whole.h(), halves.h());
        }
    }

    #[test]
    fn a_larger_swing_wipes_smaller_ones_out(
        history in history(), low in -70.0..-10.0f64, high in 10.0..70.0f64,
        inside in prop::collection::vec(0.0..1.0f64, 1..8), then in volts(),
    ) {
        let inside: Vec<f64> = inside.iter().map(|share| low + share * (high - low)).collect();
        for law in with_memory_of_loops() {
            let walk = Walk::new(&law).to(&history).to(&[low, high, low]);
            let plain = walk.clone().to(&[high, then]);
            let after = walk.to(&inside).to(&[high, then]);
            prop_assert!((plain.h() - after.h()).abs() < 1e-10, "{law:?}: {} {}", plain.h(), after.h());
        }
    }

    #[test]
    fn loops_of_one_range_are_congruent(one in history(), other in history(), a in volts(), b in volts()) {
        let (low, high) = (a.min(b), a.max(b));
        prop_assume!(high - low > 1.0);
        for law in with_memory_of_loops() {
            let of = |history: &[f64]| minor_loop(Walk::new(&law).to(history), low, high);
            prop_assert!(apart(&of(&one), &of(&other)) < 1e-10, "{law:?}");
        }
    }

    #[test]
    fn slopes_stay_within_their_bounds(history in history(), towards in prop::bool::ANY) {
        let by = if towards { 1e-4 } else { -1e-4 };
        // The limit of many loops only is a bound of Duhem's, and a bound of Bouc-Wen's is tested with its margins.
        let mut laws = with_memory_of_loops();
        laws.extend([dahl(0.5), dahl(1.0), dahl(1.7)]);
        for law in laws {
            let walk = Walk::new(&law).to(&history);
            let (h, v) = (walk.h(), walk.at_v);
            let slope = (walk.to(&[v + by]).h() - h) / by;
            let [low, high] = law.operator().slopes_per_v();
            prop_assert!((low - 1e-7..=high + 1e-7).contains(&slope), "{law:?}: {slope} of {low}..{high}");
        }
    }

    #[test]
    fn smooth_stretches_have_no_kink(history in history(), towards in prop::bool::ANY) {
        let sign = if towards { 1.0 } else { -1.0 };
        for law in all() {
            let walk = Walk::new(&law).to(&history);
            let by = law.operator().smooth_v(&walk.memory, walk.at_v, sign).min(20.0);
            let v = walk.at_v;
            let at = |share: f64| walk.clone().to(&[v + sign * share * by]).h();
            // Eight equal steps of a cubic have no fourth difference; of a smooth law hardly any.
            let h: Vec<f64> = (0..=8).map(|k| at(f64::from(k) / 8.0)).collect();
            let fourth = h.windows(5).map(|w| (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).abs());
            let worst = fourth.fold(0.0, f64::max);
            prop_assert!(worst < 1e-4, "{law:?}: {worst}");
        }
    }
}

/// Dahl and Bouc-Wen remember one number: equal ranges make other loops, until they drift to where they close.
#[test]
fn laws_of_one_number_are_not_congruent() {
    for law in [dahl(1.0), bouc_wen()] {
        let of = |history: &[f64]| minor_loop(Walk::new(&law).to(history), 10.0, 20.0);
        assert!(apart(&of(&[90.0]), &of(&[-90.0])) > 1e-3, "{law:?}");
    }
}

/// Jumps to 60 V and elsewhere, a sine in steps, and rest, a fifth of a sample late; the readings of a mass on a spring behind `law`, whose force
/// is 15 % of the drive's at 60 V.
fn late_jumps(law: &Law, drive: &Drive, forces: Vec<Force>, sample_s: f64) -> Vec<f64> {
    let mut chain = Chain { drive: drive.clone(), ..crate::chain::chain() };
    chain.plant.hysterons.clear();
    let force_n = 0.15 * chain.plant.transduction_c_per_m * 60.0 / law.rest(60.0);
    let transducer = Some(DriveHysteresis { law: law.clone(), force_n });
    chain.parts = Parts { transducer, forces, ..Parts::default() };
    let command = |k: usize| match k {
        0..10 => 0.0,
        10..110 => 60.0,
        110..210 => -40.0,
        210..310 => 25.0,
        310..450 => 25.0 + 20.0 * (0.05 * (k - 310) as f64).sin(),
        _ => 10.0,
    };
    let command_v: Vec<f64> = (0..600).map(command).collect();
    let mut log = Log { dt_s: sample_s, displacement_m: vec![0.0; command_v.len()], command_v, ..Log::default() };
    log.meta.hold = Hold::Zoh;
    log.meta.latency_s = 0.2 * sample_s;
    predict(&chain, &log, &Start::relaxed(&chain), log.len())
}

/// A friction of nothing has the chain stepped another way, in which a jump within a step is put as a parabola. That swings beyond the jump by an
/// eighth of it; an operator that followed it there would remember it, as micrometres that stay.
#[test]
fn operators_follow_the_voltage_and_not_what_stands_for_it() {
    let nothing = || vec![Force::Smooth { coulomb_n: 0.0, speed_m_per_s: 1e-3 }];
    for law in all() {
        let exact = late_jumps(&law, &Drive::IDEAL, Vec::new(), 5e-5);
        let stepped = late_jumps(&law, &Drive::IDEAL, nothing(), 5e-5);
        // The mass hardly tells a jump from its parabola: 0.3 nm of 60 V within 50 us, and jumps here are of up to 100 V.
        let error = apart(&exact, &stepped);
        assert!(error < 5e-9, "{law:?}: {error:e} m");
    }
}

/// Behind an amplifier both ways take the same course, in stretches that begin elsewhere. A stretch of a quarter of the time constant misses some
/// millivolts of 60 V, of which an operator of 15 % makes a nanometre; a parabola over a whole sample of 100 us misses a few more.
#[test]
fn operators_follow_what_an_amplifier_makes_of_jumps() {
    let nothing = || vec![Force::Smooth { coulomb_n: 0.0, speed_m_per_s: 1e-3 }];
    let first = Drive { lag: Some(Lag::First { time_constant_s: 6e-5 }), ..Drive::IDEAL };
    let ringing = Lag::Second { natural_rad_per_s: TAU * 3000.0, damping_ratio: 0.3 };
    let slewed = Drive { slew_v_per_s: 7e5, slew_down_v_per_s: 5e5, ..Drive::IDEAL };
    for drive in [first, Drive { lag: Some(ringing), ..Drive::IDEAL }, slewed] {
        for law in all() {
            let whole = late_jumps(&law, &drive, Vec::new(), 1e-4);
            let stepped = late_jumps(&law, &drive, nothing(), 1e-4);
            let error = apart(&whole, &stepped);
            assert!(error < 3e-8, "{law:?}: {error:e} m");
        }
    }
}

/// What the actuator makes of the voltage is its straight and its hysteretic part, and a gain that warms is that of both.
#[test]
fn a_gain_that_warms_is_that_of_the_hysteresis_as_well() {
    // Warm after the first nanosecond.
    let warming = Warming { coefficient: 0.1, time_constant_s: 1e-9, heat: Heat::Time };
    let warm = Drive { warmings: vec![warming], ..Drive::IDEAL };
    for law in all() {
        let cold = late_jumps(&law, &Drive::IDEAL, Vec::new(), 5e-5);
        let warm = late_jumps(&law, &warm, Vec::new(), 5e-5);
        let error = apart(&cold.iter().map(|y| 1.1 * y).collect::<Vec<_>>(), &warm);
        assert!(error < 1e-15, "{law:?}: {error:e} m");
    }
}
