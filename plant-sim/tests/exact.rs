//! The exact integrator against an independent general solver at its tightest: DOP853 on equations (2.4) to (2.6), restarted
//! wherever the input changes and wherever a hysteron passes a corner of its dead zone.
//!
//! The rival shares nothing with the crate under test: its own state (charges, displacement, momentum), its own right-hand side, its
//! own account of delays. Full scale is the largest magnitude that the rival's state reaches in the run, each state by itself; that
//! is never more than what the input could hold statically or excite in resonance, so 1e-9 of it is the stricter reading.

use ode_solvers::dop_shared::{OutputType, System};
use ode_solvers::{Dop853, SVector};
use plant_sim::chain::{Chain, Drive, Held, Lag, Parts, Sensor, Simulator};
use plant_sim::exact::{Dynamics, Spans, pack, stepper};
use plant_sim::model::Model;
use plant_sim::phs::{Hysteron, Phs, PhsState};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;
use std::path::Path;

/// The bar, in parts of full scale.
const BAR: f64 = 1e-9;
/// DOP853's own tolerance per step. Below it rounding of the 12 stages takes over (measured: 1e-14 gives no smaller differences).
const RTOL: f64 = 1e-13;
/// In micro-units, where charges, displacement and momentum are all of the order of 1 to 100.
const ATOL: f64 = 1e-13;
const MICRO: f64 = 1e6;
/// DOP853's longest step. A hysteron that turns within it peaks at most 1e-5 V above the step's ends.
const LONGEST_S: f64 = 1e-6;

fn thesis() -> Phs {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/thesis-phs.toml");
    Model::read(&file).expect("the thesis model").chain().plant
}

/// A stretch of constant or ramped input.
#[derive(Clone, Copy)]
struct Piece {
    duration_s: f64,
    drive_v: f64,
    slope_v_per_s: f64,
    force_n: f64,
}

impl Piece {
    fn held(duration_s: f64, drive_v: f64) -> Self {
        Self { duration_s, drive_v, slope_v_per_s: 0.0, force_n: 0.0 }
    }
}

/// Equations (2.4) and (2.6) for x = [Q1 .. Qn, q, p, V] with charges in uC, displacement in um, momentum in ug m/s, volts in uV. Forces
/// come out in uN: the equations keep their form when everything but the parameters is scaled alike.
///
/// The drive is a state so that the system is autonomous: ode_solvers 0.6.2 evaluates DOP853's stage 12 at the start of the step instead
/// of its end, which spoils anything that depends on time (measured: 3e-8 with ramps).
///
/// `sides` holds on which side of its dead zone each hysteron is (-1, 0, 1). A corner of h_i inside a step would cost any Runge-Kutta
/// method its order, unseen by its error estimate (measured: 1e-9 after some hundred corners), so the rival stops at corners.
struct Rival<'a, const S: usize> {
    plant: &'a Phs,
    piece: Piece,
    sides: [f64; S],
}

impl<const S: usize> Rival<'_, S> {
    /// uV by which hysteron `i` has left its side: positive once it has, at its corners zero.
    fn beyond(&self, x: &SVector<f64, S>, i: usize) -> f64 {
        let hysteron = &self.plant.hysterons[i];
        if hysteron.dead_zone_v == 0.0 {
            return f64::NEG_INFINITY;
        }
        let (v, half) = (x[i] / hysteron.capacitance_f, MICRO * hysteron.dead_zone_v / 2.0);
        if self.sides[i] == 0.0 { v.abs() - half } else { half - self.sides[i] * v }
    }

    fn left_its_side(&self, x: &SVector<f64, S>) -> Option<usize> {
        // Rounding at a corner just passed must not count: 1e-13 of the edge, where h is as good as zero.
        (0..self.plant.hysterons.len())
            .find(|&i| self.beyond(x, i) > 1e-13 * MICRO * self.plant.hysterons[i].dead_zone_v)
    }
}

impl<const S: usize> System<f64, SVector<f64, S>> for &Rival<'_, S> {
    fn system(&self, _: f64, x: &SVector<f64, S>, dx: &mut SVector<f64, S>) {
        let plant = self.plant;
        let (alpha, w) = (plant.transduction_c_per_m, x[S - 2] / plant.mass_kg);
        let mut force = alpha * x[S - 1]
            - MICRO * self.piece.force_n
            - plant.stiffness_n_per_m * x[S - 3]
            - plant.damping_n_s_per_m * w;
        for (i, hysteron) in plant.hysterons.iter().enumerate() {
            let v = x[i] / hysteron.capacitance_f;
            let corner = MICRO * self.sides[i] * hysteron.dead_zone_v / 2.0;
            let conducts = self.sides[i] != 0.0 || hysteron.dead_zone_v == 0.0;
            force -= alpha * v;
            dx[i] = alpha * w - if conducts { hysteron.slope_s * (v - corner) } else { 0.0 };
        }
        dx[S - 3] = w;
        dx[S - 2] = force;
        dx[S - 1] = MICRO * self.piece.slope_v_per_s;
    }

    fn solout(&mut self, _: f64, x: &SVector<f64, S>, _: &SVector<f64, S>) -> bool {
        self.left_its_side(x).is_some()
    }
}

/// Instants and states of DOP853's steps from `from_s` until `to_s` or until a hysteron has left its side.
fn steps<const S: usize>(
    system: &Rival<S>,
    from_s: f64,
    to_s: f64,
    x: SVector<f64, S>,
) -> (Vec<f64>, Vec<SVector<f64, S>>) {
    // Library defaults but for two: a longest step, so that a corner passed twice lies beyond 1e-6 of its edge at most, and no
    // complaint about stiffness.
    let (h_max, no_limit) = (LONGEST_S.min(to_s - from_s), u32::MAX);
    let (safety, beta, shrink, grow) = (0.9, 0.0, 0.333, 6.0);
    let mut solver = Dop853::from_param(
        system,
        0.0,
        to_s - from_s,
        0.0,
        x,
        RTOL,
        ATOL,
        safety,
        beta,
        shrink,
        grow,
        h_max,
        0.0,
        no_limit,
        no_limit,
        OutputType::Sparse,
    );
    solver.integrate().expect("the rival integrates");
    (solver.x_out().iter().map(|t| from_s + t).collect(), solver.y_out().clone())
}

/// States [q, q', v1 .. vn] in SI at the end of every piece.
fn rival_of_size<const S: usize>(plant: &Phs, start: &[f64], pieces: &[Piece]) -> Vec<Vec<f64>> {
    let mut x = SVector::<f64, S>::zeros();
    let mut sides = [0.0; S];
    for (i, hysteron) in plant.hysterons.iter().enumerate() {
        x[i] = MICRO * hysteron.capacitance_f * start[2 + i];
        if start[2 + i].abs() > hysteron.dead_zone_v / 2.0 && hysteron.dead_zone_v > 0.0 {
            sides[i] = start[2 + i].signum();
        }
    }
    (x[S - 3], x[S - 2]) = (MICRO * start[0], MICRO * plant.mass_kg * start[1]);
    let mut ends = Vec::with_capacity(pieces.len());
    for &piece in pieces {
        x[S - 1] = MICRO * piece.drive_v;
        let mut t = 0.0;
        while piece.duration_s - t > 1e-18 {
            let system = Rival { plant, piece, sides };
            let (instants, states) = steps(&system, t, piece.duration_s, x);
            let last = states.len() - 1;
            if system.left_its_side(&states[last]).is_none() {
                x = states[last];
                break;
            }
            // The last step passed a corner: halve it until only rounding is left, then change sides.
            let (mut low, mut high) = (0.0, instants[last] - instants[last - 1]);
            let mut after = states[last];
            while high - low > 1e-20 + 1e-15 * high {
                let middle = 0.5 * (low + high);
                let end = *steps(&system, 0.0, middle, states[last - 1]).1.last().expect("an end");
                if system.left_its_side(&end).is_some() {
                    (high, after) = (middle, end);
                } else {
                    low = middle;
                }
            }
            let i = system.left_its_side(&after).expect("a corner");
            sides[i] = if sides[i] == 0.0 { after[i].signum() } else { 0.0 };
            x = after;
            t = instants[last - 1] + high;
        }
        let mut end = vec![x[S - 3] / MICRO, x[S - 2] / MICRO / plant.mass_kg];
        end.extend(plant.hysterons.iter().enumerate().map(|(i, h)| x[i] / MICRO / h.capacitance_f));
        ends.push(end);
    }
    ends
}

fn rival(plant: &Phs, start: &[f64], pieces: &[Piece]) -> Vec<Vec<f64>> {
    match plant.hysterons.len() {
        0 => rival_of_size::<3>(plant, start, pieces),
        1 => rival_of_size::<4>(plant, start, pieces),
        2 => rival_of_size::<5>(plant, start, pieces),
        3 => rival_of_size::<6>(plant, start, pieces),
        4 => rival_of_size::<7>(plant, start, pieces),
        5 => rival_of_size::<8>(plant, start, pieces),
        10 => rival_of_size::<13>(plant, start, pieces),
        20 => rival_of_size::<23>(plant, start, pieces),
        n => panic!("no rival of {n} hysterons"),
    }
}

/// Our states at the end of every piece; all pieces last equally long.
fn ours(plant: &Phs, start: &[f64], pieces: &[Piece]) -> Vec<Vec<f64>> {
    let alpha = plant.transduction_c_per_m;
    let mut stepper = stepper(&Dynamics::of_plant(plant), Spans::whole(pieces[0].duration_s));
    stepper.set_state(start);
    let states = plant.hysterons.len() + 2;
    pieces
        .iter()
        .map(|piece| {
            stepper.advance(0, alpha * piece.drive_v - piece.force_n, alpha * piece.slope_v_per_s);
            (0..states).map(|i| stepper.state(i)).collect()
        })
        .collect()
}

fn relaxed(plant: &Phs) -> Vec<f64> {
    vec![0.0; plant.hysterons.len() + 2]
}

/// Largest difference, each state in parts of the largest magnitude that it reaches in `truth`.
fn error(ours: &[Vec<f64>], truth: &[Vec<f64>]) -> f64 {
    (0..truth[0].len())
        .map(|state| {
            let full_scale = truth.iter().map(|x| x[state].abs()).fold(0.0, f64::max);
            let worst = ours.iter().zip(truth).map(|(a, b)| (a[state] - b[state]).abs()).fold(0.0, f64::max);
            assert!(worst.is_finite());
            if worst == 0.0 { 0.0 } else { worst / full_scale }
        })
        .fold(0.0, f64::max)
}

fn log_uniform(random: &mut Pcg64, low: f64, high: f64) -> f64 {
    (random.random_range(low.ln()..high.ln())).exp()
}

/// A plant within a factor of three of the thesis' mechanics; hysterons from stiff (0.5 us) to creeping (50 ms), a few without dead zone.
fn random_plant(random: &mut Pcg64, hysterons: usize) -> Phs {
    let (mass_kg, stiffness_n_per_m) = (log_uniform(random, 3e-4, 3e-3), log_uniform(random, 8e3, 8e4));
    let damping_ratio = log_uniform(random, 0.01, 1.0);
    Phs {
        mass_kg,
        stiffness_n_per_m,
        damping_n_s_per_m: 2.0 * damping_ratio * (mass_kg * stiffness_n_per_m).sqrt(),
        transduction_c_per_m: log_uniform(random, 0.02, 0.1),
        hysterons: (0..hysterons)
            .map(|_| {
                let capacitance_f = log_uniform(random, 1.5e-7, 1.5e-6) * (hysterons as f64 / 2.0).sqrt();
                let open = random.random_range(0.0..1.0) < 0.1;
                Hysteron {
                    capacitance_f,
                    slope_s: capacitance_f / log_uniform(random, 0.5e-6, 50e-3),
                    dead_zone_v: if open { 0.0 } else { log_uniform(random, 0.3, 25.0) },
                }
            })
            .collect(),
    }
}

/// `samples` commands of at most 90 V: steps, a sine, a multisine or noise.
fn random_commands(random: &mut Pcg64, samples: usize, dt_s: f64) -> Vec<f64> {
    let amplitude_v = random.random_range(20.0..90.0);
    let span_s = samples as f64 * dt_s;
    match random.random_range(0..4) {
        0 => {
            let hold = 1 + samples / random.random_range(3..12);
            let levels: Vec<f64> =
                (0..=samples / hold).map(|_| random.random_range(-amplitude_v..amplitude_v)).collect();
            (0..samples).map(|k| levels[k / hold]).collect()
        }
        1 => {
            let turns = random.random_range(0.5..20.0);
            (0..samples).map(|k| amplitude_v * (TAU * turns * k as f64 / samples as f64).sin()).collect()
        }
        2 => {
            let lines: Vec<(f64, f64)> =
                (0..8).map(|_| (log_uniform(random, 1.0 / span_s, 2e3), random.random_range(0.0..TAU))).collect();
            let at = |t: f64| lines.iter().map(|(hz, phase)| (TAU * hz * t + phase).sin()).sum::<f64>() / 4.0;
            (0..samples).map(|k| amplitude_v * at(k as f64 * dt_s).clamp(-1.0, 1.0)).collect()
        }
        _ => (0..samples).map(|_| random.random_range(-amplitude_v..amplitude_v)).collect(),
    }
}

/// The drive's voltage over sample `k` when each command arrives `delay` samples late: at most two pieces that fill the sample.
fn delayed(commands: &[f64], delay: f64, dt_s: f64, k: usize) -> Vec<Piece> {
    let command = |index: f64| if index < 0.0 { 0.0 } else { commands[index as usize] };
    // Command j acts from j + delay on, in samples; the newest that has arrived at instant k is j = floor(k - delay).
    let newest = (k as f64 - delay).floor();
    let next_arrival = newest + 1.0 + delay - k as f64;
    if next_arrival >= 1.0 {
        return vec![Piece::held(dt_s, command(newest))];
    }
    vec![
        Piece::held(next_arrival * dt_s, command(newest)),
        Piece::held((1.0 - next_arrival) * dt_s, command(newest + 1.0)),
    ]
}

#[test]
fn random_plants_inputs_rates_and_delays_agree_with_the_general_solver() {
    let mut opened = 0;
    for seed in 0..60 {
        let mut random = Pcg64::seed_from_u64(seed);
        let hysterons = random.random_range(2..=5);
        let plant = random_plant(&mut random, hysterons);
        let dt_s = 1.0 / log_uniform(&mut random, 1e3, 1e5);
        let samples = ((20e-3 / dt_s) as usize).min(600);
        let commands = random_commands(&mut random, samples, dt_s);
        let delay = if seed % 3 == 0 { 0.0 } else { random.random_range(0.0..3.0) };

        let chain = Chain { drive: Drive::IDEAL, plant: plant.clone(), parts: Parts::default(), sensor: Sensor::IDEAL };
        let mut simulator = Simulator::new(&chain, dt_s, delay * dt_s);
        let mut got = Vec::new();
        let mut pieces = Vec::new();
        let mut ends_of_samples = Vec::new();
        for (k, &command) in commands.iter().enumerate() {
            simulator.advance(Held::zero_order(command), 0.0);
            got.push(pack(&simulator.state()));
            pieces.extend(delayed(&commands, delay, dt_s, k));
            ends_of_samples.push(pieces.len() - 1);
        }
        let truth = rival(&plant, &relaxed(&plant), &pieces);
        let truth: Vec<_> = ends_of_samples.iter().map(|&end| truth[end].clone()).collect();
        opened += plant
            .hysterons
            .iter()
            .enumerate()
            .filter(|(i, h)| h.dead_zone_v > 0.0 && truth.iter().any(|x| x[2 + i].abs() > h.edge_v()))
            .count();
        let error = error(&got, &truth);
        assert!(error < BAR, "seed {seed}: {error:e} of full scale at {:.0} Hz, delay {delay}, {plant:?}", 1.0 / dt_s);
    }
    // Otherwise the runs would only test a linear system.
    assert!(opened > 100, "{opened} dead zones opened");
}

#[test]
fn first_order_holds_agree_with_the_general_solver() {
    for seed in 100..112 {
        let mut random = Pcg64::seed_from_u64(seed);
        let plant = if seed == 100 { thesis() } else { random_plant(&mut random, 3) };
        let dt_s = 1.0 / log_uniform(&mut random, 1e3, 3e4);
        let samples = (20e-3 / dt_s) as usize;
        let commands = random_commands(&mut random, samples + 1, dt_s);
        let pieces: Vec<Piece> = commands
            .windows(2)
            .map(|pair| Piece { slope_v_per_s: (pair[1] - pair[0]) / dt_s, force_n: 0.3, ..Piece::held(dt_s, pair[0]) })
            .collect();
        let error = error(&ours(&plant, &relaxed(&plant), &pieces), &rival(&plant, &relaxed(&plant), &pieces));
        assert!(error < BAR, "seed {seed}: {error:e} of full scale");
    }
}

#[test]
fn very_slow_sampling_agrees_with_the_general_solver() {
    // A 200 Hz log of a 900 Hz mode: several oscillations, crossings and returns within each sample.
    for seed in 200..210 {
        let mut random = Pcg64::seed_from_u64(seed);
        let mut plant = if seed == 200 { thesis() } else { random_plant(&mut random, 2) };
        plant.damping_n_s_per_m *= if seed % 2 == 0 { 0.1 } else { 1.0 };
        let commands = random_commands(&mut random, 8, 5e-3);
        let pieces: Vec<Piece> = commands.iter().map(|&v| Piece::held(5e-3, v)).collect();
        let error = error(&ours(&plant, &relaxed(&plant), &pieces), &rival(&plant, &relaxed(&plant), &pieces));
        assert!(error < BAR, "seed {seed}: {error:e} of full scale");
    }
}

#[test]
fn many_hysterons_agree_with_the_general_solver() {
    for (seed, hysterons) in [(300, 10), (301, 20)] {
        let mut random = Pcg64::seed_from_u64(seed);
        let plant = random_plant(&mut random, hysterons);
        let commands: Vec<f64> = (0..100).map(|k| 80.0 * (TAU * f64::from(k) / 40.0).sin()).collect();
        let pieces: Vec<Piece> = commands.iter().map(|&v| Piece::held(1e-4, v)).collect();
        let error = error(&ours(&plant, &relaxed(&plant), &pieces), &rival(&plant, &relaxed(&plant), &pieces));
        assert!(error < BAR, "{hysterons} hysterons: {error:e} of full scale");
    }
}

#[test]
fn equal_hysterons_open_at_the_same_instant() {
    // n equal hysterons act as one whose voltage is their sum: C/n, beta/n, n d. All n must cross at once.
    let one = Phs { hysterons: vec![thesis().hysterons[1]], ..thesis() };
    for n in [3, 12, 20] {
        let count = n as f64;
        let part = Hysteron {
            capacitance_f: count * one.hysterons[0].capacitance_f,
            slope_s: count * one.hysterons[0].slope_s,
            dead_zone_v: one.hysterons[0].dead_zone_v / count,
        };
        let many = Phs { hysterons: vec![part; n], ..one.clone() };
        let pieces: Vec<Piece> =
            (0..300).map(|k| Piece::held(1e-4, 70.0 * (TAU * f64::from(k) / 90.0).sin())).collect();
        let single = ours(&one, &relaxed(&one), &pieces);
        let together: Vec<Vec<f64>> =
            ours(&many, &relaxed(&many), &pieces).iter().map(|x| vec![x[0], x[1], x[2..].iter().sum()]).collect();
        let error = error(&together, &single);
        assert!(error < BAR, "{n} equal hysterons: {error:e} of full scale");
    }
}

/// The rival's peak of |v_i| within one piece, from 256 equal parts of it.
fn peak_within(plant: &Phs, start: &[f64], piece: Piece, hysteron: usize) -> f64 {
    let parts = vec![Piece { duration_s: piece.duration_s / 256.0, ..piece }; 256];
    rival(plant, start, &parts).iter().map(|x| x[2 + hysteron].abs()).fold(0.0, f64::max)
}

fn never_opening(plant: &Phs, hysteron: usize) -> Phs {
    let mut closed = plant.clone();
    closed.hysterons[hysteron].slope_s = 0.0;
    closed
}

#[test]
fn an_edge_crossed_and_crossed_back_within_one_sample_is_found() {
    // A step from rest first peaks about half a period later. The rate is chosen so that the peak lies in the middle of sample
    // `sample`, the drive so that it overshoots the edge by `beyond` of it. Both come from a plant that never opens: it is linear, so
    // the peak scales with the drive, and up to the edge it moves like the plant in question.
    let base = thesis();
    for (hysteron, sample, beyond) in [
        (1, 0, 1e-1),
        (1, 0, 1e-4),
        (1, 2, 2e-2),
        (1, 5, 1e-2),
        (1, 5, 1e-4),
        (1, 20, 1e-4),
        (0, 0, 1e-1),
        (0, 5, 1e-2),
        (0, 5, 1e-4),
        (0, 20, 1e-4),
    ] {
        // The other hysteron stays shut, so that the peak is this one's.
        let plant = never_opening(&base, 1 - hysteron);
        let edge_v = plant.hysterons[hysteron].edge_v();
        let shut = never_opening(&plant, hysteron);
        let rise = rival(&shut, &relaxed(&shut), &vec![Piece::held(1e-6, 10.0); 1000]);
        let peak =
            (0..rise.len()).max_by(|&a, &b| rise[a][2 + hysteron].total_cmp(&rise[b][2 + hysteron])).expect("a rise");
        let dt_s = 1e-6 * (peak + 1) as f64 / (sample as f64 + 0.5);
        let drive_v = 10.0 * edge_v * (1.0 + beyond) / rise[peak][2 + hysteron];
        let pieces = vec![Piece::held(dt_s, drive_v); sample + 1 + 20];
        let truth = rival(&plant, &relaxed(&plant), &pieces);
        let before = if sample == 0 { relaxed(&plant) } else { truth[sample - 1].clone() };
        assert!(
            before[2 + hysteron].abs() < edge_v && truth[sample][2 + hysteron].abs() < edge_v,
            "both ends are inside"
        );
        let top = peak_within(&plant, &before, pieces[sample], hysteron);
        assert!(top > edge_v, "the rival crossed: {top} against {edge_v}");
        let got = ours(&plant, &relaxed(&plant), &pieces);
        let error_ours = error(&got, &truth);
        assert!(error_ours < BAR, "hysteron {hysteron}, {beyond} beyond the edge: {error_ours:e} of full scale");
        // A stepper that looks at the ends of samples only sees every hysteron inside and opens none.
        let naive = rival(&shut, &relaxed(&shut), &pieces);
        let missed = error(&naive[..=sample], &truth[..=sample]);
        assert!(missed > 10.0 * BAR, "hysteron {hysteron}, {beyond} beyond: the crossing matters only {missed:e}");
    }
}

#[test]
fn the_certificate_holds_for_random_states_far_from_any_trajectory() {
    // From a random state hysterons discharge from far beyond their edges while the velocity turns: accelerations change within a
    // fraction of the sample, which is where a cubic through both ends of a move says least about its middle.
    let mut worst = (0.0, 0);
    for seed in 0..3000 {
        let mut random = Pcg64::seed_from_u64(10_000 + seed);
        let mut plant = random_plant(&mut random, 2);
        let dt_s = log_uniform(&mut random, 1e-5, 3e-4);
        for hysteron in &mut plant.hysterons {
            hysteron.slope_s = hysteron.capacitance_f / (dt_s * log_uniform(&mut random, 0.05, 3.0));
        }
        let speed = 30e-6 * (plant.stiffness_n_per_m / plant.mass_kg).sqrt();
        let start: Vec<f64> = vec![
            random.random_range(-50e-6..50e-6),
            random.random_range(-speed..speed),
            random.random_range(-30.0..30.0),
            random.random_range(-30.0..30.0),
        ];
        let pieces = vec![Piece::held(dt_s, random.random_range(-90.0..90.0)); 2];
        let error = error(&ours(&plant, &start, &pieces), &rival(&plant, &start, &pieces));
        if error > worst.0 {
            worst = (error, seed);
        }
    }
    assert!(worst.0 < BAR, "seed {}: {:e} of full scale", worst.1, worst.0);
}

#[test]
fn nothing_creeps_at_rest() {
    // The thesis plant forgets by its slowest time constant, 4.52 ms (C2/beta2); after 0.3 s exp(-66) is left of any motion.
    let plant = thesis();
    let dt_s = 1e-4;
    let alpha = plant.transduction_c_per_m;
    let mut stepper = stepper(&Dynamics::of_plant(&plant), Spans::whole(dt_s));
    let mut full_scale_m = 0.0f64;
    for k in 0..2000 {
        stepper.advance(0, alpha * 80.0 * (TAU * 50.0 * f64::from(k) * dt_s).sin(), 0.0);
        full_scale_m = full_scale_m.max(stepper.state(0).abs());
    }
    for _ in 0..3000 {
        stepper.advance(0, alpha * 30.0, 0.0);
    }
    let settled_m = stepper.state(0);
    for _ in 0..50_000 {
        stepper.advance(0, alpha * 30.0, 0.0);
        let drift = (stepper.state(0) - settled_m).abs() / full_scale_m;
        assert!(drift < BAR, "{drift:e} of full scale");
    }
    let held: f64 = plant.equilibrium_m(30.0, 0.0, &[stepper.state(2), stepper.state(3)]);
    assert!((held - settled_m).abs() < BAR * full_scale_m);
}

#[test]
fn a_long_run_stops_building_maps() {
    let plant = thesis();
    let dt_s = 1e-4;
    let mut random = Pcg64::seed_from_u64(1);
    let mut stepper = stepper(&Dynamics::of_plant(&plant), Spans::whole(dt_s));
    let mut run = |samples: usize| {
        for _ in 0..samples {
            let drive_v = random.random_range(-90.0..90.0);
            stepper.advance(0, plant.transduction_c_per_m * drive_v, 0.0);
        }
        stepper.regions_built()
    };
    let early = run(20_000);
    // 3 states of each of two dead zones.
    assert!(early <= 9, "{early} regions");
    assert_eq!(run(200_000), early);
}

#[test]
fn a_split_sample_is_the_same_as_a_whole_one() {
    let plant = thesis();
    let alpha = plant.transduction_c_per_m;
    let dynamics = Dynamics::of_plant(&plant);
    let mut whole = stepper(&dynamics, Spans::whole(1e-4));
    let mut split = stepper(&dynamics, Spans::split(1e-4, 0.37e-4));
    let mut full_scale_m = 0.0f64;
    for k in 0..3000 {
        let force_n = alpha * 90.0 * (TAU * f64::from(k) / 70.0).sin();
        whole.advance(0, force_n, 0.0);
        split.advance(0, force_n, 0.0);
        split.advance(1, force_n, 0.0);
        full_scale_m = full_scale_m.max(whole.state(0).abs());
        assert!((whole.state(0) - split.state(0)).abs() < 1e-12 * full_scale_m.max(1e-6), "sample {k}");
    }
}

/// Steps that ring, waves and rests, large and small: turns and edges come before, within and after either part of a sample.
#[test]
fn both_parts_of_a_sample_at_once_are_one_after_the_other() {
    let plant = thesis();
    let mut random = Pcg64::seed_from_u64(11);
    let plain = Dynamics::of_plant(&plant);
    let lag = Lag::First { time_constant_s: 3e-4 };
    // Five states, then, which the engine pads.
    let watched = plain.clone().with_lag(lag, &[0]);
    for (sample_s, share, dynamics) in
        [(1e-4, 0.1, &plain), (1e-4, 0.5, &watched), (5e-5, 0.9, &plain), (2e-5, 0.37, &watched)]
    {
        let [mut at_once, mut in_turn] = [(); 2].map(|()| stepper(dynamics, Spans::split(sample_s, share * sample_s)));
        let mut full_scale = vec![1e-30f64; dynamics.states()];
        let (mut old_n, mut size_v) = (0.0, 60.0);
        for k in 0..60_000 {
            if k % 500 == 0 {
                // Half of them about what opens a dead zone: a peak may go beyond an edge and come back between two samples.
                let wide_v = 80.0 * 10f64.powf(-random.random_range(0.0..4.0));
                size_v = if k % 1000 == 0 { wide_v } else { random.random_range(3.0..40.0) };
            }
            let drive_v = match k / 500 % 3 {
                0 => size_v * (TAU * f64::from(k) * sample_s * 120.0).sin(),
                1 if k % 25 == 0 => random.random_range(-size_v..size_v),
                1 => old_n / plant.transduction_c_per_m,
                _ => size_v,
            };
            let forces_n = [old_n, plant.transduction_c_per_m * drive_v];
            at_once.advance_both(forces_n);
            in_turn.advance(0, forces_n[0], 0.0);
            in_turn.advance(1, forces_n[1], 0.0);
            old_n = forces_n[1];
            for (i, full) in full_scale.iter_mut().enumerate() {
                let [one, other] = [&at_once, &in_turn].map(|stepper| stepper.state(i));
                *full = full.max(other.abs());
                assert!(
                    (one - other).abs() < 1e-11 * *full,
                    "{sample_s} {share}, sample {k}, state {i}: {one:e} {other:e}"
                );
            }
        }
    }
}

#[test]
fn a_chain_starts_from_any_state() {
    let plant = thesis();
    let start = PhsState { displacement_m: 3e-5, velocity_m_per_s: -0.05, hysteron_v: vec![-2.0, 11.0] };
    let chain = Chain { drive: Drive::IDEAL, plant: plant.clone(), parts: Parts::default(), sensor: Sensor::IDEAL };
    let mut simulator = Simulator::new(&chain, 1e-4, 0.0);
    simulator.start_from(&start, 0.0);
    let pieces = vec![Piece::held(1e-4, 20.0); 50];
    let got: Vec<Vec<f64>> = pieces
        .iter()
        .map(|_| {
            simulator.advance(Held::zero_order(20.0), 0.0);
            pack(&simulator.state())
        })
        .collect();
    let error = error(&got, &rival(&plant, &pack(&start), &pieces));
    assert!(error < BAR, "{error:e} of full scale");
}
