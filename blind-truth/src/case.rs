//! Makes a case: draws the truth, finds the size of its effect, records the logs.

use crate::bench::{Bench, History, STEP_S, Session, Source, record};
use crate::digitise::Noise;
use crate::effects::{EffectId, ForeignKind, Split, Subject};
use crate::forms::{self, Planted};
use crate::nominal;
use crate::plan::{self, Plan, Size};
use crate::record::Record;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

/// What is wanted.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Everything random follows from it.
    pub seed: u64,
    /// What the case contains.
    pub subject: Subject,
    /// Which forms and nuisances.
    pub split: Split,
    /// How much data.
    pub size: Size,
    /// Raw gap over noise to aim at; drawn if absent.
    pub strength: Option<f64>,
}

/// What is so. For the scorer only.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Effects on the bench.
    pub effects: Vec<EffectId>,
    /// Or what no registry entry explains.
    pub foreign: Option<ForeignKind>,
    /// Which form of each, joined by " + ".
    pub form: String,
    /// Numbers of the forms and of the nuisances, unit in the name.
    pub parameters: Vec<(String, f64)>,
    /// Rms difference of this bench with and without its effects, over all rows of all logs, over the noise's rms: same
    /// parameters, same commands, same noise.
    pub gap_over_noise: f64,
    /// Rms of the sensor's noise.
    pub noise_um: f64,
}

/// A bench, what it recorded, and what a diagnosis is told of it.
#[derive(Clone, Debug)]
pub struct Case {
    /// Says nothing of the truth.
    pub id: String,
    /// Seed of the request.
    pub seed: u64,
    /// The answer.
    pub truth: Truth,
    /// Nominal plant, in the format of models/.
    pub plant_toml: String,
    /// What the diagnosis gets.
    pub logs: Vec<Record>,
    /// What its answer is tried on.
    pub held_out: Vec<Record>,
    /// The true bench, for further experiments.
    pub bench: Bench,
}

/// Step of the runs that look for the amplitude. Coarse: they decide sizes, never a record.
const SEARCH_STEP_S: f64 = 4e-6;

/// Offset that any bench of `Calibrate` and `Report` may have at the most, and what its plant file says of it: the standard deviation.
const NUISANCE_OFFSET_M: f64 = 1e-6;
const ZEROED_UM: f64 = 0.6;

/// Makes the case of a request. The same request makes the same case, bit for bit.
pub fn make(request: &Request) -> Case {
    let mut rng = Pcg64::seed_from_u64(mix(request));
    let noise_m = forms::log_uniform(&mut rng, 10e-9, 50e-9);
    let plain = plain_bench(request.split, noise_m, &mut rng);
    let plans = plan::logs(request.split, request.size, &mut rng);
    let held_out = plan::held_out(request.split, request.size, plans[0].rate_hz, &mut rng);

    let planted: Vec<(String, Planted)> = match &request.subject {
        Subject::Null => Vec::new(),
        Subject::Effects(effects) => effects
            .iter()
            .map(|effect| {
                let (form, planted) = forms::draw(*effect, request.split, &mut rng);
                (format!("{}: {form}", effect.id()), planted)
            })
            .collect(),
        Subject::Foreign(kind) => vec![(format!("foreign: {}", kind.id()), forms::foreign(*kind, &mut rng))],
    };
    let mut bench = plain.clone();
    let mut parameters = vec![("nuisance_offset_um".to_owned(), plain.offset_m * 1e6)];
    let log_seed = rng.random::<u64>();
    for (name, planted) in &planted {
        let target = planted.band.map(|(low, high)| {
            let drawn = forms::log_uniform(&mut rng, low, high);
            request.strength.unwrap_or(drawn)
        });
        let drawn = forms::log_uniform(&mut rng, planted.bounds.0, planted.bounds.1);
        let amplitude = match target {
            None => drawn,
            Some(target) => find_amplitude(&plain, planted, &plans, log_seed, target * noise_m),
        };
        (planted.apply)(amplitude, &mut bench);
        let short = name.trim_start_matches("foreign: ").split(':').next().unwrap_or(name);
        if let Some(target) = target {
            parameters.push((format!("{short}.aimed_gap_over_noise"), target));
        }
        parameters.push((format!("{short}.{}", planted.amplitude), amplitude));
        let stated = planted.stated(amplitude, 1.0 / plans[0].rate_hz);
        parameters.extend(stated.into_iter().map(|(key, value)| (format!("{short}.{key}"), value)));
    }
    bench.put_in_order();

    let play = |plans: &[Plan], salt: u64| -> Vec<Record> {
        let numbered: Vec<(usize, &Plan)> = plans.iter().enumerate().collect();
        let seed = |at: usize| log_seed.wrapping_add(salt + at as u64);
        numbered.par_iter().map(|(at, plan)| play_one(&bench, plan, seed(*at), STEP_S)).collect()
    };
    let logs = play(&plans, 0);
    let gap_m = gap(&plain, &plans, &logs, log_seed, STEP_S);
    let truth = Truth {
        effects: if let Subject::Effects(effects) = &request.subject { effects.clone() } else { Vec::new() },
        foreign: if let Subject::Foreign(kind) = request.subject { Some(kind) } else { None },
        form: planted.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(" + "),
        parameters,
        gap_over_noise: gap_m / noise_m,
        noise_um: noise_m * 1e6,
    };
    Case {
        id: format!("{}-{:016x}", request.split.id(), mix(request).wrapping_mul(0x2545_F491_4F6C_DD1D)),
        seed: request.seed,
        truth,
        plant_toml: nominal::plant_toml(noise_m * 1e6, (request.split != Split::Develop).then_some(ZEROED_UM)),
        logs,
        held_out: play(&held_out, 1000),
        bench,
    }
}

/// A seed for each request: neither splits nor subjects share their random numbers.
fn mix(request: &Request) -> u64 {
    let subject = match &request.subject {
        Subject::Null => 0,
        Subject::Effects(effects) => effects.iter().fold(1, |sum, effect| sum * 64 + 1 + *effect as u64),
        Subject::Foreign(kind) => (1 << 40) + *kind as u64,
    };
    let split = request.split as u64;
    let salted = request.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (subject << 8) ^ (split << 2) ^ request.size as u64;
    (salted ^ (salted >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9)
}

/// A bench without effects: parameters off by their sigma, and the nuisances of its split.
fn plain_bench(split: Split, noise_m: f64, rng: &mut Pcg64) -> Bench {
    let numbers = nominal::scattered(rng);
    let mut noise = Noise { rms_m: noise_m, coloured_share: 0.0, corner_hz: 1.0 };
    let mut history = History::Relaxed;
    let mut offset_m = 0.0;
    if split != Split::Develop {
        if rng.random::<bool>() {
            let share = rng.random_range(0.05..0.3);
            noise = Noise { coloured_share: share, corner_hz: forms::log_uniform(rng, 50.0, 2000.0), ..noise };
        }
        let rest_s = rng.random_range(0.2..0.4);
        history = match rng.random_range(0..3) {
            0 => History::Relaxed,
            1 => History::Demagnetised { volts: rng.random_range(30.0..60.0), rest_s },
            _ => History::Moved { volts: rng.random_range(20.0..60.0), rest_s },
        };
        offset_m = NUISANCE_OFFSET_M * rng.random_range(-1.0..1.0);
    }
    Bench { history, offset_m, ..nominal::bench(&numbers, noise) }
}

pub(crate) fn play_one(bench: &Bench, plan: &Plan, seed: u64, step_s: f64) -> Record {
    let source = match plan.law {
        None => Source::Open(&plan.rows),
        Some(law) => Source::Closed(&plan.rows, law),
    };
    let session = Session { source, rate_hz: plan.rate_hz, rest_v: plan.rest_v(), seed, monitor: false, step_s };
    Record { name: plan.name.clone(), ..record(bench, &session) }
}

/// Rms difference in metres between records and what the plain bench makes of the same commands, noise and history.
fn gap(plain: &Bench, plans: &[Plan], logs: &[Record], log_seed: u64, step_s: f64) -> f64 {
    let numbered: Vec<(usize, &Plan)> = plans.iter().enumerate().collect();
    let parts: Vec<(f64, usize)> = numbered
        .par_iter()
        .map(|(at, plan)| {
            let source = Source::Open(&logs[*at].command_v);
            let seed = log_seed.wrapping_add(*at as u64);
            let session =
                Session { source, rate_hz: plan.rate_hz, rest_v: plan.rest_v(), seed, monitor: false, step_s };
            square_distance(&record(plain, &session), &logs[*at])
        })
        .collect();
    rms(&parts)
}

fn square_distance(a: &Record, b: &Record) -> (f64, usize) {
    let squares = a.displacement_um.iter().zip(&b.displacement_um).map(|(x, y)| (x - y) * (x - y) * 1e-12);
    (squares.sum(), a.displacement_um.len())
}

fn rms(parts: &[(f64, usize)]) -> f64 {
    let (sum, n) = parts.iter().fold((0.0, 0), |(sum, n), (more, rows)| (sum + more, n + rows));
    (sum / n.max(1) as f64).sqrt()
}

/// Amplitude for a wanted gap: secant on logarithms inside the sane bounds. It stops at 15 %: a size is no measurement.
pub(crate) fn find_amplitude(plain: &Bench, planted: &Planted, plans: &[Plan], log_seed: u64, wanted_m: f64) -> f64 {
    let (low, high) = planted.bounds;
    // Open loop throughout, with the plain bench's own commands in the closed-loop log: one reference serves every try.
    let numbered: Vec<(usize, &Plan)> = plans.iter().enumerate().collect();
    let seed = |at: usize| log_seed.wrapping_add(at as u64);
    let reference: Vec<Record> =
        numbered.par_iter().map(|(at, plan)| play_one(plain, plan, seed(*at), SEARCH_STEP_S)).collect();
    let gap_at = |amplitude: f64| {
        let mut bench = plain.clone();
        (planted.apply)(amplitude, &mut bench);
        let parts: Vec<(f64, usize)> = numbered
            .par_iter()
            .map(|(at, plan)| {
                let session = Session {
                    source: Source::Open(&reference[*at].command_v),
                    rate_hz: plan.rate_hz,
                    rest_v: plan.rest_v(),
                    seed: seed(*at),
                    monitor: false,
                    step_s: SEARCH_STEP_S,
                };
                square_distance(&record(&bench, &session), &reference[*at])
            })
            .collect();
        rms(&parts).max(1e-12)
    };
    let goal = wanted_m.ln();
    let (mut below, mut above) = (low.ln(), high.ln());
    let mut x = 0.5 * (below + above);
    let mut slope = 1.0;
    let mut before: Option<(f64, f64)> = None;
    for _ in 0..7 {
        let y = gap_at(x.exp()).ln();
        if (y - goal).abs() < 0.14 {
            break;
        }
        if y < goal {
            below = x
        } else {
            above = x
        }
        if let Some((x0, y0)) = before
            && x != x0
        {
            slope = f64::clamp((y - y0) / (x - x0), 0.2, 5.0);
        }
        before = Some((x, y));
        let next = x + (goal - y) / slope;
        x = if next <= below || next >= above {
            // Outside what is known: the bound itself if it was never tried, else the middle.
            let bound = if next <= below { below } else { above };
            if bound == low.ln() || bound == high.ln() { bound } else { 0.5 * (below + above) }
        } else {
            next
        };
        if above - below < 1e-3 {
            break;
        }
    }
    x.exp()
}
