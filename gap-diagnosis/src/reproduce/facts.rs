//! What Table 2.1 implies: time constants, stiffnesses, travel, memory, symmetries.

use super::{Entry, Thesis};
use plant_sim::chain::Chain;
use plant_sim::linear::poles;
use plant_sim::log::Log;
use plant_sim::metrics::rms;
use plant_sim::phs::Phs;
use plant_sim::replay::{Start, predict};
use std::f64::consts::TAU;

/// Rate and length of a slow ramp: slow against 4.5 ms, so that it is quasi-static to a nanometre, and cheap.
const RATE_HZ: f64 = 20e3;
const SLOW_S: f64 = 5.0;

pub(super) fn facts(thesis: &Thesis) -> Vec<Entry> {
    let chain = thesis.phs.chain();
    let plant = &chain.plant;
    let alpha = plant.transduction_c_per_m;
    let (first, second) = (&plant.hysterons[0], &plant.hysterons[1]);
    let spring = |c: f64| alpha * alpha / c;
    let locked = plant.stiffness_n_per_m + spring(first.capacitance_f) + spring(second.capacitance_f);
    let hz = |k: f64| (k / plant.mass_kg).sqrt() / TAU;
    let gain = plant.static_gain_m_per_v();
    let place = "Table 2.1";
    let of = |what: &str, printed: &str, ours: f64, unit: &'static str| Entry::digits(place, what, printed, ours, unit);
    let mut entries = parameters(thesis);
    entries.extend([
        of("time constant C/beta of hysteron 1", "0.940", first.capacitance_f / first.slope_s * 1e6, "us"),
        of("time constant C/beta of hysteron 2", "4.52", second.capacitance_f / second.slope_s * 1e3, "ms"),
        of("stiffness of hysteron 1 inside its dead zone", "3801", spring(first.capacitance_f), "N/m"),
        of("stiffness of hysteron 2 inside its dead zone", "4115", spring(second.capacitance_f), "N/m"),
        of("resonance with both inside", "900.6", hz(locked), "Hz"),
        of("resonance without hysterons", "783.3", hz(plant.stiffness_n_per_m), "Hz"),
        of("static gain alpha/k", "1.88417", gain * 1e6, "um/V"),
        of("volts for 120 um, relaxed", "63.69", 120e-6 / gain, "V"),
        of("volts for 120 um from rest, quasi-static", "75.3", volts_from_rest(&chain, 120e-6), "V"),
        of("from rest, 64 V reaches", "98.7", slow(&chain, &[0.0, 64.0]) * 1e6, "um"),
        of("64 V there and back leaves", "7.5", slow(&chain, &[0.0, 64.0, 0.0]) * 1e6, "um"),
    ]);
    let linear = plant.linear_region(&[true, true]).map(|region| poles(&region.a)).unwrap_or_default();
    let pole = |i: usize| linear.get(i).copied().unwrap_or_default();
    entries.extend([
        of("fastest pole without dead zones", "-1.0637e6", pole(3).re, "1/s"),
        of("mechanical pair, real part", "-1858.6", pole(1).re, "1/s"),
        of("mechanical pair, imaginary part", "4993.4", pole(1).im.abs(), "rad/s"),
        of("slowest pole without dead zones", "-188.7", pole(0).re, "1/s"),
    ]);
    let symmetry = |what: &str, ours: f64| Entry::digits("Section 1.4", what, "0.000000", ours, "% of full scale");
    entries.extend([
        symmetry("sensor gain 1.05 = (alpha g, C g^2, beta g^2)", sensor_symmetry(&chain)),
        symmetry("drive gain 1.05 = the same with d/g", drive_symmetry(&chain)),
        symmetry("payload 5 % = (k, b, alpha, C, beta)/(1 + m)", payload_symmetry(&chain)),
    ]);
    entries.push(symmetry("d1 wider by a tenth, at 40 V, where it stays shut", invisible_dead_zone(&chain)));
    let [least, most] = beta1_doubled_nm(&chain);
    let what =
        format!("beta1 doubled moves sines of unstated amplitude by at least (64 V, 1 to 150 Hz: {least:.2} nm rms)");
    entries.push(Entry::given("Section 1.4", &what, "0.06", "nm"));
    let what = format!("and at most (64 V, 1 to 150 Hz: {most:.2} nm rms)");
    entries.push(Entry::given("Section 1.4", &what, "2.4", "nm"));
    entries
}

/// Change of the displacement by a wider first dead zone while it stays shut, in percent of full scale.
fn invisible_dead_zone(chain: &Chain) -> f64 {
    let mut other = chain.clone();
    other.plant.hysterons[0].dead_zone_v *= 1.1;
    let log = log((0..4000).map(|k| 40.0 * (TAU * 20.0 * f64::from(k) / RATE_HZ).sin()).collect());
    let [a, b] = [chain, &other].map(|chain| predict(chain, &log, &Start::relaxed(chain), log.len()));
    let full = a.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    100.0 * a.iter().zip(&b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / full
}

/// Least and largest rms change of 64 V sines by twice the slope of hysteron 1, nanometres.
fn beta1_doubled_nm(chain: &Chain) -> [f64; 2] {
    let mut other = chain.clone();
    other.plant.hysterons[0].slope_s *= 2.0;
    let moved = [1.0, 10.0, 50.0, 100.0, 150.0].map(|hz: f64| {
        let rows = (2.0 * RATE_HZ / hz) as usize;
        let log = log((0..rows).map(|k| 64.0 * (TAU * hz * k as f64 / RATE_HZ).sin()).collect());
        let [a, b] = [chain, &other].map(|chain| predict(chain, &log, &Start::relaxed(chain), log.len()));
        1e9 * rms(a.iter().zip(&b).map(|(a, b)| a - b))
    });
    [moved.iter().copied().fold(f64::INFINITY, f64::min), moved.iter().copied().fold(0.0, f64::max)]
}

/// Tables 2.1 and 2.2 as the model files hold them.
fn parameters(thesis: &Thesis) -> Vec<Entry> {
    let plant = thesis.phs.chain().plant;
    let (first, second) = (&plant.hysterons[0], &plant.hysterons[1]);
    let bouc_wen = thesis.bouc_wen.chain();
    let law = thesis.bouc_wen.hysteresis.bouc_wen(thesis.bouc_wen.kind);
    let force_n = bouc_wen.parts.transducer.as_ref().map_or(f64::NAN, |part| part.force_n);
    let of = |table: &str, what: &str, printed: &str, ours: f64, unit: &'static str| {
        Entry::digits(table, &format!("{what}, in the model file"), printed, ours, unit)
    };
    let [phs, bw] = ["Table 2.1", "Table 2.2"];
    vec![
        of(phs, "M", "1.0148e-3", plant.mass_kg, "kg"),
        of(phs, "k", "24579", plant.stiffness_n_per_m, "N/m"),
        of(phs, "b", "3.7356", plant.damping_n_s_per_m, "N s/m"),
        of(phs, "C1", "5.6425e-7", first.capacitance_f, "F"),
        of(phs, "C2", "5.2125e-7", second.capacitance_f, "F"),
        of(phs, "alpha", "0.046311", plant.transduction_c_per_m, "C/m"),
        of(phs, "slope beta1", "0.6002", first.slope_s, "S"),
        of(phs, "slope beta2", "1.1528e-4", second.slope_s, "S"),
        of(phs, "d1", "14.5126", first.dead_zone_v, "V"),
        of(phs, "d2", "8.6838", second.dead_zone_v, "V"),
        of(bw, "M", "9.4023e-4", bouc_wen.plant.mass_kg, "kg"),
        of(bw, "b", "5.2", bouc_wen.plant.damping_n_s_per_m, "N s/m"),
        of(bw, "k", "24579", bouc_wen.plant.stiffness_n_per_m, "N/m"),
        of(bw, "A", "0.008743", law.amplitude, "1/V"),
        of(bw, "beta", "0.00637", law.beta, "1/V"),
        of(bw, "gamma", "0.0144905", law.gamma, "1/V"),
        of(bw, "Kv", "0.048676", bouc_wen.plant.transduction_c_per_m, "N/V"),
        of(bw, "Kh", "1.9767", force_n, "N"),
    ]
}

/// Displacement at the end of slow ramps between `levels_v`, one after the other, from the relaxed state.
fn slow(chain: &Chain, levels_v: &[f64]) -> f64 {
    let rows = (SLOW_S * RATE_HZ) as usize;
    let mut command_v = Vec::new();
    for ends in levels_v.windows(2) {
        command_v.extend((0..rows).map(|k| ends[0] + (ends[1] - ends[0]) * k as f64 / rows as f64));
    }
    // A little time at the end: at zero velocity nothing pulls the hysterons beyond their edges.
    command_v.extend(std::iter::repeat_n(*levels_v.last().unwrap_or(&0.0), rows / 10));
    let log = log(command_v);
    predict(chain, &log, &Start::relaxed(chain), log.len()).pop().unwrap_or(f64::NAN)
}

/// The level from which a slow ramp reaches `travel_m`, by bisection.
fn volts_from_rest(chain: &Chain, travel_m: f64) -> f64 {
    let (mut low, mut high) = (0.0, 4.0 * travel_m / chain.plant.static_gain_m_per_v());
    for _ in 0..14 {
        let middle = 0.5 * (low + high);
        if slow(chain, &[0.0, middle]) < travel_m { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

fn log(command_v: Vec<f64>) -> Log {
    Log { dt_s: 1.0 / RATE_HZ, displacement_m: vec![0.0; command_v.len()], command_v, ..Log::default() }
}

/// Largest difference of two plants' answers to a chirped sine, in percent of full scale; the second's command and answer are scaled.
fn apart(chain: &Chain, other: Phs, drive_gain: f64, sensor_gain: f64) -> f64 {
    let chirp = |k: usize| {
        let t = k as f64 / RATE_HZ;
        70.0 * (TAU * (5.0 + 150.0 * t) * t).sin()
    };
    let ours = log((0..10_000).map(chirp).collect());
    let theirs = log((0..10_000).map(|k| drive_gain * chirp(k)).collect());
    let other = Chain { plant: other, ..chain.clone() };
    let run = |chain: &Chain, log: &Log| predict(chain, log, &Start::relaxed(chain), log.len());
    let (a, b) = (run(&other, &ours), run(chain, &theirs));
    let full = a.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    100.0 * a.iter().zip(&b).fold(0.0f64, |m, (a, b)| m.max((a - sensor_gain * b).abs())) / full
}

const G: f64 = 1.05;

fn sensor_symmetry(chain: &Chain) -> f64 {
    let mut other = chain.plant.clone();
    other.transduction_c_per_m *= G;
    for h in &mut other.hysterons {
        h.capacitance_f *= G * G;
        h.slope_s *= G * G;
    }
    apart(chain, other, 1.0, G)
}

fn drive_symmetry(chain: &Chain) -> f64 {
    let mut other = chain.plant.clone();
    other.transduction_c_per_m *= G;
    for h in &mut other.hysterons {
        h.capacitance_f *= G * G;
        h.slope_s *= G * G;
        h.dead_zone_v /= G;
    }
    apart(chain, other, G, 1.0)
}

fn payload_symmetry(chain: &Chain) -> f64 {
    // The plant with more mass, against the nominal mass and everything else smaller.
    let mut other = chain.plant.clone();
    let less = 1.0 / G;
    other.stiffness_n_per_m *= less;
    other.damping_n_s_per_m *= less;
    other.transduction_c_per_m *= less;
    for h in &mut other.hysterons {
        h.capacitance_f *= less;
        h.slope_s *= less;
    }
    let heavier = Chain { plant: Phs { mass_kg: chain.plant.mass_kg * G, ..chain.plant.clone() }, ..chain.clone() };
    apart(&heavier, other, 1.0, 1.0)
}
