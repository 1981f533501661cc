//! Forms of the errors in time and of the link.

use super::{C, CR, D, DC, DCR, Form, Planted, R, log_uniform, sign};
use crate::bench::{BadLink, JITTER_ROWS, Jitter, TURN_ROWS};
use crate::digitise::Digitise;
use crate::drive::Drive;
use crate::effects::EffectId::*;
use rand::RngExt;
use rand_pcg::Pcg64;

pub(super) const FORMS: &[Form] = &[
    Form { effect: TransportDelay, name: "of the command", splits: DC, draw: delay_command },
    Form { effect: TransportDelay, name: "of the measurement", splits: CR, draw: delay_measurement },
    Form { effect: TransportDelay, name: "all-pass of second order", splits: R, draw: delay_all_pass },
    Form { effect: TransportDelay, name: "half of the command, half of the measurement", splits: C, draw: delay_both },
    Form {
        effect: TransportDelay,
        name: "of the command, by turns longer and shorter",
        splits: C,
        draw: delay_by_turns,
    },
    Form { effect: SamplingJitter, name: "uniform", splits: D, draw: jitter_uniform },
    Form { effect: SamplingJitter, name: "Gaussian", splits: DC, draw: jitter_gaussian },
    Form { effect: SamplingJitter, name: "some rows late", splits: CR, draw: jitter_late },
    Form { effect: SamplingJitter, name: "wandering from row to row", splits: C, draw: jitter_wandering },
    Form { effect: SamplingJitter, name: "one of two times", splits: C, draw: jitter_two_times },
    Form { effect: LostSamples, name: "rows repeat the one before", splits: DC, draw: lost_rows },
    Form { effect: LostSamples, name: "commands not applied", splits: CR, draw: lost_commands },
    Form { effect: LostSamples, name: "runs of rows repeat the one before", splits: R, draw: lost_runs },
    Form { effect: LostSamples, name: "rows filled with a running mean", splits: C, draw: lost_filled },
    Form { effect: LostSamples, name: "rows show an older one", splits: C, draw: lost_stale },
    Form { effect: LostSamples, name: "rows late until put in step again", splits: C, draw: lost_step },
    Form { effect: LostSamples, name: "commands lost in bad times of the link", splits: C, draw: lost_bad_link },
    Form { effect: LostSamples, name: "rows carried on along the last slope", splits: C, draw: lost_carried_on },
    Form { effect: LostSamples, name: "rows lost when another task comes round", splits: C, draw: lost_regular },
    Form { effect: LostSamples, name: "some rows only while the link is busy", splits: C, draw: lost_thinned },
    Form { effect: LostSamples, name: "packets of rows shown once more", splits: C, draw: lost_replayed },
    Form { effect: LostSamples, name: "rows and commands, each for itself", splits: C, draw: lost_both_ways },
    Form { effect: ClockError, name: "constant", splits: DCR, draw: clock_constant },
    Form { effect: ClockError, name: "growing", splits: C, draw: clock_growing },
    Form { effect: ClockError, name: "swinging", splits: R, draw: clock_swinging },
    Form { effect: ClockError, name: "put right again and again", splits: C, draw: clock_synced },
    Form { effect: ClockError, name: "settling as the oscillator warms", splits: C, draw: clock_settling },
];

const DELAY_S: (f64, f64) = (1e-6, 4e-4);

fn delay_command(_: &mut Pcg64) -> Planted {
    Planted::new("delay_s", DELAY_S, |a, bench| bench.timing.command_delay_s = a)
}

fn delay_measurement(_: &mut Pcg64) -> Planted {
    Planted::new("delay_s", DELAY_S, |a, bench| bench.timing.measure_delay_s = a)
}

fn delay_all_pass(_: &mut Pcg64) -> Planted {
    Planted::new("delay_s", (5e-6, 4e-4), |a, bench| bench.drives.push(Drive::AllPass { delay_s: a }))
}

/// Jitter adds in rms over moving rows only, and more than a third of a row is no jitter.
const JITTER: (f64, f64) = (3.0, 15.0);

/// Where the bench cuts a jitter's tails, lest rows change places.
fn cut_at_s(_: f64, period_s: f64) -> f64 {
    JITTER_ROWS * period_s
}

fn jitter_uniform(_: &mut Pcg64) -> Planted {
    Planted::new("half_width_s", (5e-7, 2e-5), |a, bench| {
        bench.timing.jitter = Some(Jitter::Uniform { half_s: a });
    })
    .band(JITTER.0, JITTER.1)
}

fn jitter_gaussian(_: &mut Pcg64) -> Planted {
    Planted::new("rms_s", (3e-7, 1e-5), |a, bench| bench.timing.jitter = Some(Jitter::Gaussian { rms_s: a }))
        .installed("cut_at_s", cut_at_s)
        .band(JITTER.0, JITTER.1)
}

fn jitter_late(rng: &mut Pcg64) -> Planted {
    let one_in = log_uniform(rng, 2.0, 8.0);
    Planted::new("mean_s", (1e-6, 2.5e-5), move |a, bench| {
        bench.timing.jitter = Some(Jitter::RareLate { one_in, mean_s: a });
    })
    .with("one_in", one_in)
    .installed("cut_at_s", cut_at_s)
    .band(JITTER.0, JITTER.1)
}

const LOST: (f64, f64) = (3.0, 20.0);

fn lost_rows(_: &mut Pcg64) -> Planted {
    Planted::new("probability", (2e-4, 0.08), |a, bench| bench.digitises.push(Digitise::Repeat { probability: a }))
        .band(LOST.0, LOST.1)
}

fn lost_runs(rng: &mut Pcg64) -> Planted {
    let length = rng.random_range(2..=6);
    Planted::new("probability", (1e-4, 0.03), move |a, bench| {
        bench.digitises.push(Digitise::Burst { probability: a, length });
    })
    .with("rows", f64::from(length))
    .band(LOST.0, LOST.1)
}

fn lost_commands(rng: &mut Pcg64) -> Planted {
    let length = rng.random_range(1..=4);
    Planted::new("probability", (2e-4, 0.08), move |a, bench| {
        bench.timing.command_loss = Some((a, length));
    })
    .with("rows", f64::from(length))
    .band(LOST.0, LOST.1)
}

fn lost_filled(rng: &mut Pcg64) -> Planted {
    let rows = log_uniform(rng, 2.0, 6.0);
    Planted::new("probability", (1e-4, 0.08), move |a, bench| {
        bench.digitises.push(Digitise::Filled { probability: a, rows });
    })
    .with("mean_over_rows", rows)
    .band(LOST.0, LOST.1)
}

fn lost_stale(rng: &mut Pcg64) -> Planted {
    let rows = rng.random_range(2..=5);
    Planted::new("probability", (5e-5, 0.08), move |a, bench| {
        bench.digitises.push(Digitise::Stale { probability: a, rows });
    })
    .with("rows", f64::from(rows))
    .band(LOST.0, LOST.1)
}

fn lost_step(rng: &mut Pcg64) -> Planted {
    let rows = rng.random_range(4..=24);
    Planted::new("probability", (2e-5, 0.03), move |a, bench| {
        bench.digitises.push(Digitise::OutOfStep { probability: a, rows });
    })
    .with("rows", f64::from(rows))
    .band(LOST.0, LOST.1)
}

fn lost_bad_link(rng: &mut Pcg64) -> Planted {
    let (rows, loss) = (log_uniform(rng, 4.0, 20.0), rng.random_range(0.3..0.8));
    Planted::new("probability", (2e-5, 0.03), move |a, bench| {
        bench.timing.bad_link = Some(BadLink { start: a, rows, loss });
    })
    .with("rows", rows)
    .with("loss", loss)
    .band(LOST.0, LOST.1)
}

/// Anchors F18: 1 to 100 ppm; a cheap oscillator reaches a few hundred.
const CLOCK: (f64, f64) = (2e-6, 1e-3);

fn clock_constant(rng: &mut Pcg64) -> Planted {
    let sign = sign(rng);
    Planted::new("ratio_error", CLOCK, move |a, bench| bench.timing.clock_error = sign * a).with("sign", sign)
}

fn clock_growing(rng: &mut Pcg64) -> Planted {
    // The first part of a long swing is a ramp: error x t/tau.
    let (sign, tau_s) = (sign(rng), log_uniform(rng, 1.0, 10.0));
    Planted::new("ratio_error", CLOCK, move |a, bench| {
        let swing_s = 200.0;
        bench.timing.clock_swing_s = swing_s;
        bench.timing.clock_error = sign * a * swing_s / (std::f64::consts::TAU * tau_s);
    })
    .with("sign", sign)
    .with("tau_s", tau_s)
}

fn clock_swinging(rng: &mut Pcg64) -> Planted {
    let (sign, swing_s) = (sign(rng), log_uniform(rng, 2.0, 8.0));
    Planted::new("ratio_error", CLOCK, move |a, bench| {
        bench.timing.clock_swing_s = swing_s;
        bench.timing.clock_error = sign * a;
    })
    .with("sign", sign)
    .with("swing_s", swing_s)
}

fn delay_both(rng: &mut Pcg64) -> Planted {
    let share = rng.random_range(0.3..0.7);
    Planted::new("delay_s", DELAY_S, move |a, bench| {
        bench.timing.command_delay_s = share * a;
        bench.timing.measure_delay_s = (1.0 - share) * a;
    })
    .with("command_share", share)
}

fn delay_by_turns(rng: &mut Pcg64) -> Planted {
    let share = rng.random_range(0.1..0.5);
    Planted::new("delay_s", DELAY_S, move |a, bench| {
        bench.timing.command_delay_s = a;
        bench.timing.edge_turns_s = share * a;
    })
    .installed("longer_and_shorter_by", move |a, period_s| share.min(TURN_ROWS * period_s / a))
}

fn jitter_wandering(rng: &mut Pcg64) -> Planted {
    let rows = log_uniform(rng, 2.0, 30.0);
    Planted::new("rms_s", (3e-7, 1e-5), move |a, bench| {
        bench.timing.jitter = Some(Jitter::Wandering { rms_s: a, rows });
    })
    .with("rows", rows)
    .installed("cut_at_s", cut_at_s)
    .band(JITTER.0, JITTER.1)
}

fn jitter_two_times(_: &mut Pcg64) -> Planted {
    Planted::new("half_distance_s", (3e-7, 1e-5), |a, bench| bench.timing.jitter = Some(Jitter::TwoTimes { s: a }))
        .band(JITTER.0, JITTER.1)
}

fn lost_carried_on(rng: &mut Pcg64) -> Planted {
    let length = rng.random_range(2..=6);
    Planted::new("probability", (2e-4, 0.08), move |a, bench| {
        bench.digitises.push(Digitise::CarriedOn { probability: a, length });
    })
    .with("rows", f64::from(length))
    .band(LOST.0, LOST.1)
}

fn lost_regular(rng: &mut Pcg64) -> Planted {
    let length = rng.random_range(1..=4);
    Planted::new("share", (2e-4, 0.1), move |a, bench| {
        bench.digitises.push(Digitise::Regular { share: a, length });
    })
    .with("rows", f64::from(length))
    .band(LOST.0, LOST.1)
}

fn lost_thinned(rng: &mut Pcg64) -> Planted {
    let (rows, every) = (rng.random_range(6..=24), rng.random_range(2..=4));
    Planted::new("probability", (3e-5, 0.05), move |a, bench| {
        bench.digitises.push(Digitise::Thinned { probability: a, rows, every });
    })
    .with("rows", f64::from(rows))
    .with("one_in", f64::from(every))
    .band(LOST.0, LOST.1)
}

fn lost_replayed(rng: &mut Pcg64) -> Planted {
    let rows = rng.random_range(2..=4);
    Planted::new("probability", (1e-4, 0.08), move |a, bench| {
        bench.digitises.push(Digitise::Replayed { probability: a, rows });
    })
    .with("rows", f64::from(rows))
    .band(LOST.0, LOST.1)
}

fn lost_both_ways(rng: &mut Pcg64) -> Planted {
    let ratio = log_uniform(rng, 0.5, 2.0);
    Planted::new("probability", (2e-4, 0.06), move |a, bench| {
        bench.digitises.push(Digitise::Repeat { probability: a });
        bench.timing.command_loss = Some((ratio * a, 1));
    })
    .with("commands_over_rows", ratio)
    .band(LOST.0, LOST.1)
}

fn clock_synced(rng: &mut Pcg64) -> Planted {
    let (sign, sync_s) = (sign(rng), log_uniform(rng, 0.15, 0.8));
    Planted::new("ratio_error", CLOCK, move |a, bench| {
        bench.timing.clock_error = sign * a;
        bench.timing.clock_sync_s = sync_s;
    })
    .with("sign", sign)
    .with("put_right_after_s", sync_s)
}

fn clock_settling(rng: &mut Pcg64) -> Planted {
    let (sign, share, tau_s) = (sign(rng), rng.random_range(0.4..0.95), log_uniform(rng, 0.15, 2.0));
    Planted::new("ratio_error", CLOCK, move |a, bench| {
        bench.timing.clock_error = sign * a;
        bench.timing.clock_settling = Some((share, tau_s));
    })
    .with("sign", sign)
    .with("settling_share", share)
    .with("tau_s", tau_s)
}
