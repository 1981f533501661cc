//! Forms of noise, of the mains' lines and of the converters' codes.

use super::{C, CR, DC, DCR, DR, Form, Planted, R, STROKE_M, log_uniform, sign};
use crate::digitise::Digitise;
use crate::drive::Drive;
use crate::effects::EffectId::*;
use crate::nominal::static_gain_m_per_v;
use crate::sensor::Measure;
use crate::structure::Force;
use rand::RngExt;
use rand_pcg::Pcg64;

pub(super) const FORMS: &[Form] = &[
    Form { effect: NoiseExcess, name: "white", splits: DC, draw: white },
    Form { effect: NoiseExcess, name: "low-pass", splits: C, draw: coloured },
    Form { effect: NoiseExcess, name: "a + b/f", splits: R, draw: flicker },
    Form { effect: NoiseExcess, name: "comes and goes", splits: R, draw: bursts },
    Form { effect: NoiseExcess, name: "about a frequency", splits: C, draw: band_noise },
    Form { effect: NoiseExcess, name: "shaped away from low frequencies", splits: C, draw: shaped },
    Form { effect: NoiseExcess, name: "single rows hit", splits: C, draw: spikes },
    Form { effect: NoiseExcess, name: "popcorn", splits: C, draw: popcorn },
    Form { effect: NoiseExcess, name: "white, with heavy tails", splits: C, draw: heavy_tails },
    Form { effect: NoiseExcess, name: "swinging with a lamp's light", splits: C, draw: lamp },
    Form { effect: NoiseExcess, name: "crackle that rings down", splits: C, draw: crackle },
    Form { effect: NoiseExcess, name: "each draw stays for some rows", splits: C, draw: held_noise },
    Form { effect: NoiseExcess, name: "white, growing as an amplifier warms", splits: C, draw: warming_noise },
    Form { effect: MainsHum, name: "50 Hz with harmonics", splits: DC, draw: |rng| hum(rng, 50.0) },
    Form { effect: MainsHum, name: "60 Hz with harmonics", splits: DR, draw: |rng| hum(rng, 60.0) },
    Form { effect: MainsHum, name: "50 Hz behind a rectifier", splits: C, draw: hum_rectified },
    Form { effect: MainsHum, name: "50 Hz, third harmonic strongest", splits: R, draw: hum_third },
    Form { effect: MainsHum, name: "50 Hz of a loose grid", splits: C, draw: hum_loose },
    Form { effect: MainsHum, name: "50 Hz, phase cut", splits: C, draw: hum_cut },
    Form { effect: MainsHum, name: "100 Hz of a transformer, as a force", splits: C, draw: hum_force },
    Form { effect: MainsHum, name: "60 Hz in swells", splits: C, draw: hum_swelling },
    Form { effect: MainsHum, name: "50 Hz on the drive's voltage", splits: C, draw: hum_drive },
    Form { effect: Quantisation, name: "sensor's converter", splits: DCR, draw: lattice },
    Form { effect: Quantisation, name: "command's converter", splits: CR, draw: dac },
    Form { effect: Quantisation, name: "sensor's converter, truncating", splits: R, draw: truncation },
    Form { effect: Quantisation, name: "sensor's converter, codes of unequal width", splits: C, draw: uneven_codes },
    Form { effect: Quantisation, name: "sensor's converter, codes that hold on", splits: C, draw: held_codes },
    Form { effect: Quantisation, name: "short floating-point number", splits: C, draw: floating },
    Form { effect: Quantisation, name: "both converters", splits: C, draw: both_converters },
    Form { effect: Quantisation, name: "sensor's converter, some codes missing", splits: C, draw: missing_codes },
    Form { effect: Quantisation, name: "sensor's converter, dithered", splits: C, draw: dithered },
];

/// Excess over the data sheet's rms: less cannot be told from its 10 % sigma, more is no noise any more.
const EXCESS: (f64, f64) = (1.5, 5.0);

/// 5 nm to 300 nm; the band decides.
const EXCESS_M: (f64, f64) = (5e-9, 3e-7);

fn white(_: &mut Pcg64) -> Planted {
    Planted::new("rms_m", EXCESS_M, |a, bench| bench.digitises.push(Digitise::White { m: a })).band(EXCESS.0, EXCESS.1)
}

fn coloured(rng: &mut Pcg64) -> Planted {
    let corner_hz = log_uniform(rng, 20.0, 2000.0);
    Planted::new("rms_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::Coloured { m: a, corner_hz }))
        .with("corner_hz", corner_hz)
        .band(EXCESS.0, EXCESS.1)
}

fn flicker(rng: &mut Pcg64) -> Planted {
    let ratio = rng.random_range(0.3..1.0);
    Planted::new("white_rms_m", EXCESS_M, move |a, bench| {
        bench.digitises.push(Digitise::Flicker { white_m: a, flicker_m: ratio * a });
    })
    .with("flicker_over_white", ratio)
    .band(EXCESS.0, EXCESS.1)
}

fn bursts(rng: &mut Pcg64) -> Planted {
    let mean_s = log_uniform(rng, 0.005, 0.05);
    Planted::new("rms_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::Bursts { m: a, mean_s }))
        .with("mean_s", mean_s)
        .band(EXCESS.0, EXCESS.1)
}

fn band_noise(rng: &mut Pcg64) -> Planted {
    let (hz, quality) = (log_uniform(rng, 150.0, 3500.0), log_uniform(rng, 1.0, 10.0));
    Planted::new("rms_m", EXCESS_M, move |a, bench| {
        bench.digitises.push(Digitise::Band { m: a, hz, width_hz: hz / quality });
    })
    .with("hz", hz)
    .with("quality", quality)
    .band(EXCESS.0, EXCESS.1)
}

fn shaped(_: &mut Pcg64) -> Planted {
    Planted::new("rms_m", EXCESS_M, |a, bench| bench.digitises.push(Digitise::Shaped { m: a })).band(EXCESS.0, EXCESS.1)
}

fn spikes(rng: &mut Pcg64) -> Planted {
    let share = log_uniform(rng, 0.02, 0.2);
    Planted::new("rms_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::Spikes { m: a, share }))
        .with("share_of_rows", share)
        .band(EXCESS.0, EXCESS.1)
}

fn popcorn(rng: &mut Pcg64) -> Planted {
    let mean_s = log_uniform(rng, 5e-4, 1e-2);
    Planted::new("half_jump_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::Popcorn { m: a, mean_s }))
        .with("mean_dwell_s", mean_s)
        .band(EXCESS.0, EXCESS.1)
}

/// Anchors F25 has 1 to 50 nm; what 50 nm of noise hides in one log still shows over all of them.
const HUM: (f64, f64) = (2.0, 20.0);

fn hum_of(hz: f64, second: f64, third: f64, fifth: f64) -> Planted {
    Planted::new("amplitude_m", (5e-9, 2e-6), move |a, bench| {
        bench.measures.push(Measure::Hum { m: a, hz, second, third, fifth });
    })
    .with("hz", hz)
    .with("second", second)
    .with("third", third)
    .with("fifth", fifth)
    .band(HUM.0, HUM.1)
}

fn hum(rng: &mut Pcg64, hz: f64) -> Planted {
    hum_of(hz, rng.random_range(0.0..0.3), rng.random_range(0.1..0.5), rng.random_range(0.0..0.2))
}

fn hum_rectified(rng: &mut Pcg64) -> Planted {
    hum_of(50.0, rng.random_range(1.0..3.0), 0.0, 0.0)
}

fn hum_third(rng: &mut Pcg64) -> Planted {
    hum_of(50.0, 0.1, rng.random_range(1.0..2.0), rng.random_range(0.2..0.6))
}

fn hum_loose(rng: &mut Pcg64) -> Planted {
    // Off by up to 0.2 Hz, by turns.
    let (swing_s, off_hz) = (log_uniform(rng, 1.0, 10.0), rng.random_range(0.05..0.2));
    let third = rng.random_range(0.1..0.4);
    Planted::new("amplitude_m", (5e-9, 2e-6), move |a, bench| {
        bench.measures.push(Measure::LooseHum { m: a, hz: 50.0, third, swing_rad: off_hz * swing_s, swing_s });
    })
    .with("off_hz", off_hz)
    .with("swing_s", swing_s)
    .with("third", third)
    .band(HUM.0, HUM.1)
}

fn hum_cut(rng: &mut Pcg64) -> Planted {
    let decay = rng.random_range(2.0..8.0);
    Planted::new("amplitude_m", (5e-9, 4e-6), move |a, bench| {
        bench.measures.push(Measure::CutHum { m: a, hz: 50.0, decay });
    })
    .with("decay_per_half_wave", decay)
    .band(HUM.0, HUM.1)
}

fn hum_force(rng: &mut Pcg64) -> Planted {
    // Magnetostriction has twice the mains' frequency and no line at it.
    let second = rng.random_range(0.1..0.5);
    Planted::new("force_N", (1e-4, 0.1), move |a, bench| {
        bench.forces.push(Force::Periodic { n: a, hz: 100.0, second, beat_hz: 0.0 });
    })
    .with("second", second)
    .band(HUM.0, HUM.1)
}

/// A lattice that shows: its own rms is 2 to 10 times the noise.
const LATTICE: (f64, f64) = (2.0, 10.0);

fn lattice(_: &mut Pcg64) -> Planted {
    Planted::new("step_m", (2e-8, 2e-6), |a, bench| bench.digitises.push(Digitise::Lattice { m: a }))
        .band(LATTICE.0, LATTICE.1)
}

fn truncation(_: &mut Pcg64) -> Planted {
    Planted::new("step_m", (2e-8, 2e-6), |a, bench| bench.digitises.push(Digitise::Truncation { m: a }))
        .band(LATTICE.0, LATTICE.1)
}

fn dac(_: &mut Pcg64) -> Planted {
    Planted::new("step_V", (0.01, 3.0), |a, bench| bench.timing.dac_lsb_v = a).band(LATTICE.0, LATTICE.1)
}

fn uneven_codes(rng: &mut Pcg64) -> Planted {
    let skew = sign(rng) * rng.random_range(0.3..0.8);
    Planted::new("step_m", (2e-8, 2e-6), move |a, bench| {
        bench.digitises.push(Digitise::UnevenCodes { m: a, skew });
    })
    .with("skew", skew)
    .band(LATTICE.0, LATTICE.1)
}

fn held_codes(rng: &mut Pcg64) -> Planted {
    let hold = rng.random_range(0.15..0.5);
    Planted::new("step_m", (2e-8, 2e-6), move |a, bench| bench.digitises.push(Digitise::HeldCodes { m: a, hold }))
        .with("hold_over_step", hold)
        .band(LATTICE.0, LATTICE.1)
}

fn floating(_: &mut Pcg64) -> Planted {
    Planted::new("step_at_stroke_m", (2e-8, 8e-6), |a, bench| {
        bench.digitises.push(Digitise::Floating { m: a, full_m: STROKE_M });
    })
    .band(LATTICE.0, LATTICE.1)
}

fn both_converters(rng: &mut Pcg64) -> Planted {
    let ratio = log_uniform(rng, 0.5, 2.0);
    Planted::new("step_m", (2e-8, 2e-6), move |a, bench| {
        bench.timing.dac_lsb_v = ratio * a / static_gain_m_per_v();
        bench.digitises.push(Digitise::Lattice { m: a });
    })
    .with("command_over_sensor", ratio)
    .band(LATTICE.0, LATTICE.1)
}

fn heavy_tails(rng: &mut Pcg64) -> Planted {
    let degrees = rng.random_range(3..=5);
    Planted::new("rms_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::HeavyTails { m: a, degrees }))
        .with("degrees_of_freedom", f64::from(degrees))
        .band(EXCESS.0, EXCESS.1)
}

fn lamp(rng: &mut Pcg64) -> Planted {
    let (hz, depth) = (if rng.random::<bool>() { 50.0 } else { 60.0 }, rng.random_range(0.5..1.0));
    Planted::new("rms_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::Lamp { m: a, hz, depth }))
        .with("mains_hz", hz)
        .with("depth", depth)
        .band(EXCESS.0, EXCESS.1)
}

fn crackle(rng: &mut Pcg64) -> Planted {
    let (hits_per_s, hz) = (log_uniform(rng, 30.0, 300.0), log_uniform(rng, 400.0, 3000.0));
    let decay_s = log_uniform(rng, 3e-4, 2e-3);
    Planted::new("rms_m", EXCESS_M, move |a, bench| {
        bench.digitises.push(Digitise::Crackle { m: a, hits_per_s, hz, decay_s });
    })
    .with("hits_per_s", hits_per_s)
    .with("hz", hz)
    .with("decay_s", decay_s)
    .band(EXCESS.0, EXCESS.1)
}

fn held_noise(rng: &mut Pcg64) -> Planted {
    let rows = rng.random_range(2..=8);
    Planted::new("rms_m", EXCESS_M, move |a, bench| bench.digitises.push(Digitise::Held { m: a, rows }))
        .with("rows", f64::from(rows))
        .band(EXCESS.0, EXCESS.1)
}

fn warming_noise(rng: &mut Pcg64) -> Planted {
    let tau_s = log_uniform(rng, 0.1, 1.5);
    Planted::new("rms_in_the_end_m", EXCESS_M, move |a, bench| {
        bench.digitises.push(Digitise::Warming { m: a, tau_s });
    })
    .with("tau_s", tau_s)
    .band(EXCESS.0, EXCESS.1)
}

fn hum_swelling(rng: &mut Pcg64) -> Planted {
    let (third, depth) = (rng.random_range(0.1..0.4), rng.random_range(0.3..0.8));
    let swell_hz = log_uniform(rng, 0.3, 3.0);
    Planted::new("amplitude_m", (5e-9, 2e-6), move |a, bench| {
        bench.measures.push(Measure::SwellingHum { m: a, hz: 60.0, third, depth, swell_hz });
    })
    .with("third", third)
    .with("depth", depth)
    .with("swell_hz", swell_hz)
    .band(HUM.0, HUM.1)
}

fn hum_drive(rng: &mut Pcg64) -> Planted {
    // A ripple of the rails has twice the mains' frequency beside its pick-up at once.
    let (second, third) = (rng.random_range(0.1..0.6), rng.random_range(0.0..0.3));
    Planted::new("amplitude_V", (1e-3, 1.0), move |a, bench| {
        bench.drives.push(Drive::Hum { v: a, hz: 50.0, second, third });
    })
    .with("second", second)
    .with("third", third)
    .band(HUM.0, HUM.1)
}

fn missing_codes(rng: &mut Pcg64) -> Planted {
    let every = rng.random_range(3..=8);
    Planted::new("step_m", (2e-8, 2e-6), move |a, bench| {
        bench.digitises.push(Digitise::MissingCodes { m: a, every });
    })
    .with("one_in", f64::from(every))
    .band(LATTICE.0, LATTICE.1)
}

fn dithered(_: &mut Pcg64) -> Planted {
    Planted::new("step_m", (2e-8, 2e-6), |a, bench| bench.digitises.push(Digitise::Dithered { m: a }))
        .band(LATTICE.0, LATTICE.1)
}
