//! The sampled loop's margins against printed facts, an independent computation, closed forms, and themselves: a margin is right if
//! using it up puts an eigenvalue on the unit circle.

use nalgebra::{Complex, DMatrix, DVector, RowDVector};
use plant_sim::margins::{
    LinearRegion, Loop, MarginError, Margins, Suggestion, Verdict, assess, margins, nearest_stable,
};
use plant_sim::phs::{Hysteron, Phs};
use proptest::prelude::*;

const TIMER_CLOCK_HZ: u32 = 170_000_000;

/// Table 2.1 of the thesis.
pub fn thesis_plant() -> Phs {
    Phs {
        mass_kg: 1.0148e-3,
        stiffness_n_per_m: 24579.0,
        damping_n_s_per_m: 3.7356,
        transduction_c_per_m: 0.046311,
        hysterons: vec![
            Hysteron { capacitance_f: 5.6425e-7, slope_s: 0.6002, dead_zone_v: 10.0 },
            Hysteron { capacitance_f: 5.2125e-7, slope_s: 1.1528e-4, dead_zone_v: 10.0 },
        ],
    }
}

fn thesis_regions() -> Vec<LinearRegion> {
    thesis_plant().linear_regions().expect("the thesis plant is valid")
}

fn all_active() -> LinearRegion {
    thesis_regions().swap_remove(0)
}

fn pi_1(rate_hz: f64, delay_us: f64) -> Loop {
    Loop { kp_v_per_m: 8.5811e5, ki_v_per_m_s: 9.6755e8, rate_hz, delay_s: delay_us * 1e-6 }
}

fn pi_2(rate_hz: f64, delay_us: f64) -> Loop {
    Loop { kp_v_per_m: 2.3164e4, ki_v_per_m_s: 1.8384e8, rate_hz, delay_s: delay_us * 1e-6 }
}

fn examine(region: &LinearRegion, law: &Loop) -> Margins {
    margins(region, law).expect("a valid loop")
}

fn with_gain(law: &Loop, gain_db: f64) -> Loop {
    let factor = 10_f64.powf(gain_db / 20.0);
    Loop { kp_v_per_m: law.kp_v_per_m * factor, ki_v_per_m_s: law.ki_v_per_m_s * factor, ..*law }
}

/// The distance of the nearest eigenvalue from the unit circle.
fn distance_from_circle(found: &Margins) -> f64 {
    found.eigenvalues.iter().map(|z| (z.norm() - 1.0).abs()).fold(f64::INFINITY, f64::min)
}

#[test]
fn regions_are_labelled_from_all_active_to_none() {
    let labels: Vec<String> = thesis_regions().into_iter().map(|region| region.label).collect();
    let expected = ["hysterons 1, 2 active", "hysteron 2 active", "hysteron 1 active", "no hysteron active"];
    assert_eq!(labels, expected);
}

#[test]
fn printed_facts_hold_with_all_hysterons_active() {
    // The design page prints one decimal below 10 dB and whole decibels at 10: half of the last digit is the tolerance.
    for (law, printed_db, half_digit_db) in [
        (pi_1(10e3, 10.0), 2.4, 0.05),
        (pi_1(20e3, 10.0), 6.5, 0.05),
        (pi_1(20e3, 50.0), 0.7, 0.05),
        (pi_1(40e3, 10.0), 10.0, 0.5),
    ] {
        let found = examine(&all_active(), &law);
        assert!(found.stable, "{law:?}");
        assert!((found.gain_margin_db - printed_db).abs() <= half_digit_db, "{law:?}: {}", found.gain_margin_db);
    }
    let full_sample = examine(&all_active(), &pi_1(10e3, 100.0));
    assert!(!full_sample.stable && full_sample.gain_margin_db < 0.0, "{full_sample}");

    // PI 2 is comfortable from 5 kHz on.
    for rate_hz in [5e3, 10e3, 20e3, 40e3] {
        let assessment = assess(&thesis_regions(), &pi_2(rate_hz, 10.0)).expect("a valid loop");
        assert!(matches!(assessment.verdict, Verdict::Stable { .. }), "{assessment}");
        assert!(assessment.gain_margin_db.value > 20.0, "{assessment}");
    }
}

#[test]
fn gain_margins_agree_with_an_independent_computation() {
    // Independent: scipy expm in other units, numpy eigenvalues of the augmented loop, bisection of the gain at which the spectral
    // radius passes 1. Rounded to 1e-6 dB; columns in the order of the regions.
    let table = [
        (pi_1(10e3, 10.0), [2.421335, 2.541341, 2.386546, 2.508688]),
        (pi_1(20e3, 10.0), [6.475450, 6.557953, 6.450613, 6.534348]),
        (pi_1(20e3, 50.0), [0.672944, 0.799150, 0.633480, 0.762354]),
        (pi_1(40e3, 10.0), [9.990752, 10.051935, 9.972389, 10.034297]),
        (pi_1(10e3, 100.0), [-3.948367, -3.728832, -4.005348, -3.781139]),
        (pi_2(5e3, 10.0), [21.001168, 21.673423, 20.933130, 21.612845]),
        (pi_2(10e3, 10.0), [22.831970, 23.550996, 22.765501, 23.492195]),
        (pi_2(20e3, 10.0), [24.179883, 24.979911, 24.112631, 24.920583]),
        (pi_2(5e3, 200.0), [17.378744, 18.336956, 17.303799, 18.270854]),
    ];
    for (law, expected_db) in table {
        for (region, expected_db) in thesis_regions().iter().zip(expected_db) {
            let found = examine(region, &law);
            // 5e-7 of rounding in the table and as much again for the two computations.
            let error_db = found.gain_margin_db - expected_db;
            assert!(error_db.abs() < 1e-6, "{law:?} {}: {}", region.label, found.gain_margin_db);
            // The thesis loops become unstable only upwards.
            assert_eq!(found.lower_gain_margin_db, None);
        }
    }
}

#[test]
fn using_up_a_margin_puts_an_eigenvalue_on_the_circle() {
    let laws =
        [pi_1(10e3, 10.0), pi_1(20e3, 10.0), pi_1(20e3, 50.0), pi_1(40e3, 37.0), pi_2(5e3, 200.0), pi_2(5e3, 730.0)];
    for law in laws {
        for region in thesis_regions() {
            let found = examine(&region, &law);
            let at_gain = examine(&region, &with_gain(&law, found.gain_margin_db));
            assert!(distance_from_circle(&at_gain) < 1e-6, "gain, {law:?}: {at_gain}");
            let at_delay = examine(&region, &Loop { delay_s: law.delay_s + found.delay_margin_s, ..law });
            assert!(distance_from_circle(&at_delay) < 1e-6, "delay, {law:?}: {found} then {at_delay}");
            // And not before it is used up.
            for part in [0.25, 0.5, 0.75, 0.99] {
                assert!(examine(&region, &with_gain(&law, part * found.gain_margin_db)).stable);
                let delay_s = law.delay_s + part * found.delay_margin_s;
                assert!(examine(&region, &Loop { delay_s, ..law }).stable);
            }
        }
    }
}

#[test]
fn margins_of_an_unstable_loop_lead_back_to_a_stable_one() {
    let law = pi_1(10e3, 100.0);
    for region in thesis_regions() {
        let found = examine(&region, &law);
        assert!(!found.stable && found.gain_margin_db < 0.0 && found.delay_margin_s < 0.0);
        assert!(found.phase_margin_deg < 0.0 && found.modulus_margin < 0.0);
        assert!(examine(&region, &with_gain(&law, found.gain_margin_db - 0.01)).stable);
        assert!(!examine(&region, &with_gain(&law, found.gain_margin_db + 0.01)).stable);
        let with_delay = |change_s: f64| Loop { delay_s: law.delay_s + found.delay_margin_s + change_s, ..law };
        assert!(examine(&region, &with_delay(-1e-8)).stable);
        assert!(!examine(&region, &with_delay(1e-8)).stable);
    }
}

/// q' = -p q + g u: one pole, everything in closed form.
fn first_order(p: f64, g: f64) -> LinearRegion {
    LinearRegion {
        label: "one pole".to_string(),
        a: DMatrix::from_element(1, 1, -p),
        b: DVector::from_element(1, g),
        c: RowDVector::from_element(1, 1.0),
        d: 0.0,
    }
}

#[test]
fn one_pole_agrees_with_its_closed_form() {
    // Proportional law, no delay: the eigenvalue is E - Kp G with E = e^(-pT), G = g (1 - E)/p. It leaves at -1: Kp = (1 + E)/G.
    let (p, g, rate_hz): (f64, f64, f64) = (300.0, 2.0, 1000.0);
    let e = (-p / rate_hz).exp();
    let input = g * (1.0 - e) / p;
    let kp = 100.0;
    let law = Loop { kp_v_per_m: kp, ki_v_per_m_s: 0.0, rate_hz, delay_s: 0.0 };
    let found = examine(&first_order(p, g), &law);
    assert_eq!(found.eigenvalues.len(), 1);
    // Ten rounding units of numbers of size one, as for the other closed forms here.
    assert!((found.eigenvalues[0].re - (e - kp * input)).abs() < 2e-15);
    assert!((found.gain_margin_db - 20.0 * ((1.0 + e) / input / kp).log10()).abs() < 1e-10);
    assert!((found.gain_margin_hz.expect("it oscillates") - 500.0).abs() < 1e-9, "at the Nyquist frequency");
    // L stays below 1 at every frequency (its largest is Kp g/p = 2/3), so nothing but gain can upset it.
    assert_eq!(found.crossover_hz, None);
    assert_eq!((found.phase_margin_deg, found.delay_margin_s), (f64::INFINITY, f64::INFINITY));
    // |1 + L| is least at z = -1.
    assert!((found.modulus_margin - (1.0 - kp * input / (1.0 + e))).abs() < 1e-12);

    // A delay of one sample: in z^2 - E z + Kp G = 0 the product Kp G is 1 on the circle, so the margin is 1/(Kp G) exactly.
    let delayed = Loop { delay_s: 1.0 / rate_hz, kp_v_per_m: 0.5 / input, ..law };
    let found = examine(&first_order(p, g), &delayed);
    assert!((found.gain_margin_db - 20.0 * 2_f64.log10()).abs() < 1e-10, "{}", found.gain_margin_db);
}

#[test]
fn a_falling_gain_can_also_destabilise() {
    // An unstable pole, q' = +p q + g u, needs gain: stable for Kp between (E - 1)/G and (E + 1)/G.
    let (p, g, rate_hz): (f64, f64, f64) = (100.0, 1.0, 1000.0);
    let e = (p / rate_hz).exp();
    let input = g * (e - 1.0) / p;
    let law = |kp_v_per_m: f64| Loop { kp_v_per_m, ki_v_per_m_s: 0.0, rate_hz, delay_s: 0.0 };
    let db = |factor: f64| 20.0 * factor.log10();
    let found = examine(&first_order(-p, g), &law(2.0 * (e - 1.0) / input));
    assert!(found.stable);
    // The lower limit is at frequency zero, and the curve starts at a thousandth of the slowest mode: 1e-6 of the gain away.
    assert!((found.lower_gain_margin_db.expect("it needs gain") + db(2.0)).abs() < 1e-5);
    assert!((found.gain_margin_db - db((e + 1.0) / (2.0 * (e - 1.0)))).abs() < 1e-9);
    assert!((found.nearest_gain_margin_db() - db(2.0)).abs() < 1e-5);

    let too_little = examine(&first_order(-p, g), &law(0.5 * (e - 1.0) / input));
    assert!(!too_little.stable);
    assert_eq!(too_little.gain_margin_db, f64::NEG_INFINITY);
    assert!((too_little.lower_gain_margin_db.expect("more gain helps") - db(2.0)).abs() < 1e-5);
    assert!(too_little.to_string().contains("6.0 dB more gain would stabilise it"), "{too_little}");
}

#[test]
fn a_narrow_resonance_is_not_missed() {
    // Damping ratio 1e-5 at 1234 Hz: the peak is 0.025 Hz wide. A small proportional gain with a quarter period of delay drives it
    // unstable, which only the eigenvalues and a curve that looks at the peak can see.
    let omega = std::f64::consts::TAU * 1234.0;
    let region = LinearRegion {
        label: "resonance".to_string(),
        a: DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -omega * omega, -2e-5 * omega]),
        b: DVector::from_column_slice(&[0.0, omega * omega]),
        c: RowDVector::from_row_slice(&[1.0, 0.0]),
        d: 0.0,
    };
    let law = Loop { kp_v_per_m: 1e-5, ki_v_per_m_s: 0.0, rate_hz: 20e3, delay_s: 200e-6 };
    let found = examine(&region, &law);
    assert!(found.stable);
    // At the resonance |L| = Kp / (2 zeta) = 0.5 at most, so 6 dB or a little more.
    assert!(found.gain_margin_db > 5.9 && found.gain_margin_db < 7.0, "{}", found.gain_margin_db);
    assert!(distance_from_circle(&examine(&region, &with_gain(&law, found.gain_margin_db))) < 1e-9);
}

/// 45 past drives beside the plant: from no shift does the iteration find all, and on the transpose it does.
#[test]
fn a_long_delay_has_its_eigenvalues() {
    let hysteron = |capacitance_f: f64, slope_s: f64| Hysteron { capacitance_f, slope_s, dead_zone_v: 10.0 };
    let plant = Phs {
        mass_kg: 0.00038046263237050083,
        damping_n_s_per_m: 1.5506793724971157,
        stiffness_n_per_m: 55172.71131734158,
        transduction_c_per_m: 0.03621505587563581,
        hysterons: vec![
            hysteron(2.1606502692280657e-7, 0.004956543882282491),
            hysteron(5.464707664227922e-7, 0.008),
            hysteron(7.469221396779911e-7, 0.008),
        ],
    };
    let law = Loop {
        kp_v_per_m: 91630.1892429808,
        ki_v_per_m_s: 575054164.1509981,
        rate_hz: 11188.73068711963,
        delay_s: 0.00011310823510714033,
    };
    for region in plant.linear_regions().expect("positive coefficients") {
        let found = examine(&region, &law);
        let longer = |part: f64| Loop { delay_s: law.delay_s + part * found.delay_margin_s, ..law };
        assert!(examine(&region, &longer(0.8537529074463777)).stable, "{region:?}");
        // The edge that it says is on the unit circle.
        assert!(distance_from_circle(&examine(&region, &longer(1.0))) < 1e-6, "{region:?}");
    }
}

#[test]
fn inactive_hysterons_kept_as_states_are_eigenvalues_of_exactly_one() {
    let plant = thesis_plant();
    for active in [[true, true], [true, false], [false, true], [false, false]] {
        // The region with every hysteron as a state and the admittance of the inactive ones zero.
        let mut unreduced = all_active();
        for i in (0..2).filter(|&i| !active[i]) {
            unreduced.a[(2 + i, 2 + i)] = 0.0;
        }
        let n_inactive = active.iter().filter(|is_active| !**is_active).count();
        let at_one = |found: &Margins| found.eigenvalues.iter().filter(|z| (*z - 1.0).norm() < 1e-9).count();
        for law in [pi_1(20e3, 10.0), pi_1(40e3, 62.5), pi_2(5e3, 10.0)] {
            let kept = examine(&unreduced, &law);
            assert_eq!(at_one(&kept), n_inactive, "{:?}", kept.eigenvalues);
            let reduced = examine(&plant.linear_region(&active).expect("valid"), &law);
            assert_eq!(at_one(&reduced), 0);
            // The rest of the spectrum is the same; modes near 0 (a spent electrical mode, a held-back drive) are ill-conditioned.
            for z in reduced.eigenvalues.iter().filter(|z| z.norm() > 1e-3) {
                let nearest = kept.eigenvalues.iter().map(|other| (other - z).norm()).fold(f64::INFINITY, f64::min);
                assert!(nearest < 1e-9, "{z} is {nearest:e} away");
            }
        }
    }
}

#[test]
fn fast_sampling_approaches_the_continuous_poles() {
    // The thesis' closed loop with PI 1 (with the sign of its equation 3.29 corrected), and half of the last printed digit.
    let continuous = [
        (Complex::new(-1.0637e6, 0.0), 50.0),
        (Complex::new(-1511.8, 7946.6), 0.05 * std::f64::consts::SQRT_2),
        (Complex::new(-1511.8, -7946.6), 0.05 * std::f64::consts::SQRT_2),
        (Complex::new(-653.9, 0.0), 0.05),
        (Complex::new(-228.2, 0.0), 0.05),
    ];
    let poles = |rate_hz: f64| -> Vec<Complex<f64>> {
        let found = examine(&all_active(), &pi_1(rate_hz, 0.0));
        assert_eq!(found.eigenvalues.len(), continuous.len());
        found.eigenvalues.iter().map(|z| z.ln() * rate_hz).collect()
    };
    let nearest = |poles: &[Complex<f64>], to: Complex<f64>| {
        let distance = |z: &&Complex<f64>| (*z - to).norm();
        *poles.iter().min_by(|x, y| distance(x).total_cmp(&distance(y))).expect("five poles")
    };
    let (at_1_mhz, at_2_mhz) = (poles(1e6), poles(2e6));
    for (pole, rounding) in continuous {
        let (coarse, fine) = (nearest(&at_1_mhz, pole), nearest(&at_2_mhz, pole));
        if pole.re < -1e6 {
            // The electrical mode is hardly touched by the loop, and ln(z)/T undoes sampling exactly.
            assert!((coarse - pole).norm() < rounding, "{coarse}");
            continue;
        }
        // The hold acts like T/2 of delay, which turns the phase at the pole by |p| T/2 and so moves it by at most about |p|
        // times that (measured: 0.31 times that for the oscillating pair, less for the others).
        let period_s = 1e-6;
        let first_order = pole.norm_sqr() * period_s / 2.0;
        assert!((coarse - pole).norm() < rounding + first_order, "{coarse}");
        // Extrapolated to T = 0, what is left is of second order, at most |p| (|p| T)^2.
        let extrapolated = fine * 2.0 - coarse;
        let second_order = pole.norm() * (pole.norm() * period_s).powi(2);
        assert!((extrapolated - pole).norm() < rounding + second_order, "{extrapolated}");
    }
    // First order indeed: half the period, half the shift.
    let pair = continuous[1].0;
    let ratio = (nearest(&at_1_mhz, pair) - pair).norm() / (nearest(&at_2_mhz, pair) - pair).norm();
    assert!((1.9..2.1).contains(&ratio), "{ratio}");
}

#[test]
fn assessment_says_one_plain_line() {
    let say = |law: Loop| assess(&thesis_regions(), &law).expect("a valid loop").to_string();
    assert_eq!(say(pi_1(40e3, 10.0)), "stable: gain margin 10.0 dB (hysteron 1 active)");
    assert_eq!(say(pi_1(10e3, 10.0)), "stable, but the gain margin is 2.4 dB, below 6 dB (hysteron 1 active)");
    assert_eq!(say(pi_1(10e3, 100.0)), "unstable: spectral radius 1.0716 (hysteron 1 active)");
    let unstable = examine(&all_active(), &pi_1(10e3, 100.0)).to_string();
    assert_eq!(
        unstable,
        "hysterons 1, 2 active: unstable, spectral radius 1.0709; 3.9 dB less gain would stabilise it"
    );
}

#[test]
fn suggestions_do_what_they_say() {
    let suggest = |law: &Loop| nearest_stable(&thesis_regions(), law, TIMER_CLOCK_HZ).expect("a valid loop");
    assert!(matches!(suggest(&pi_1(20e3, 10.0)), Suggestion::AsAsked { .. }));

    // Too slow, with a delay that faster rates bear: 17 kHz falls short of 6 dB.
    let law = pi_1(10e3, 10.0);
    let Suggestion::Change { rate_hz, delay_s, keeps_delay, gain_margin_db } = suggest(&law) else {
        unreachable!("{}", suggest(&law))
    };
    assert_eq!((rate_hz, delay_s, keeps_delay), (20e3, law.delay_s, true));
    assert!(gain_margin_db >= 6.0);
    let said = suggest(&law).to_string();
    assert_eq!(said, "20 kHz with 10 us as asked would do: gain margin 6.5 dB in the worst region");

    // No rate bears 50 us; the asked rate does with less, and with no more than is said.
    let law = pi_1(20e3, 50.0);
    let Suggestion::Change { rate_hz, delay_s, keeps_delay, .. } = suggest(&law) else {
        unreachable!("{}", suggest(&law))
    };
    assert_eq!((rate_hz, keeps_delay), (20e3, false));
    let gain_margin_db = |delay_s: f64| {
        assess(&thesis_regions(), &Loop { rate_hz, delay_s, ..law }).expect("a valid loop").gain_margin_db.value
    };
    // Delays are rounded down to 0.1 us.
    assert!(gain_margin_db(delay_s) >= 6.0 && gain_margin_db(delay_s + 1.01e-7) < 6.0, "{delay_s}");

    // A rate that the timer cannot make is not offered, though it would do.
    let other = suggest(&pi_1(21e3, 10.0));
    assert!(matches!(other, Suggestion::Change { rate_hz: 20e3, keeps_delay: true, .. }), "{other}");

    assert_eq!(suggest(&with_gain(&pi_1(20e3, 10.0), 60.0)), Suggestion::Nothing);
}

#[test]
fn bad_input_is_named() {
    let region = all_active();
    let good = pi_1(20e3, 10.0);
    let error = |law: Loop| margins(&region, &law).expect_err("bad input");
    for rate_hz in [0.0, -1.0, f64::INFINITY, f64::NAN, 1e-320] {
        assert!(matches!(error(Loop { rate_hz, ..good }), MarginError::BadRate { .. }));
    }
    for delay_s in [-1e-9, f64::NAN, f64::INFINITY] {
        assert!(matches!(error(Loop { delay_s, ..good }), MarginError::BadDelay { .. }));
    }
    assert!(matches!(error(Loop { kp_v_per_m: f64::NAN, ..good }), MarginError::BadGain { .. }));
    assert!(matches!(error(Loop { ki_v_per_m_s: f64::INFINITY, ..good }), MarginError::BadGain { .. }));
    assert!(matches!(error(Loop { delay_s: 1.0, ..good }), MarginError::DelayTooLong { .. }));
    assert!(matches!(error(Loop { rate_hz: 1e-3, delay_s: 0.0, ..good }), MarginError::TooStiff { .. }));
    assert!(matches!(assess(&[], &good), Err(MarginError::NoRegion)));
    assert!(matches!(nearest_stable(&[], &good, TIMER_CLOCK_HZ), Err(MarginError::NoRegion)));
    assert!(nearest_stable(&thesis_regions(), &Loop { rate_hz: 0.0, ..good }, TIMER_CLOCK_HZ).is_err());
    // No timer, no rate.
    assert_eq!(nearest_stable(&thesis_regions(), &good, 0), Ok(Suggestion::Nothing));

    let mut not_finite = region.clone();
    not_finite.a[(0, 1)] = f64::NAN;
    assert!(matches!(margins(&not_finite, &good), Err(MarginError::BadRegion { .. })));
    let mut short = region.clone();
    short.b = DVector::zeros(2);
    assert!(matches!(margins(&short, &good), Err(MarginError::BadRegion { .. })));
    let mut plant = thesis_plant();
    plant.mass_kg = -1.0;
    let said = plant.linear_regions().expect_err("a negative mass").to_string();
    assert_eq!(said, "mass_kg must be positive, not -1");
    plant = thesis_plant();
    plant.hysterons = vec![plant.hysterons[0]; 17];
    assert!(matches!(plant.linear_regions(), Err(MarginError::TooManyHysterons { n_hysterons: 17, .. })));
}

/// A factor between 1/spread and spread, even in its logarithm.
fn factor(spread: f64) -> impl Strategy<Value = f64> {
    (-1.0..1.0).prop_map(move |power: f64| spread.powf(power))
}

/// The thesis plant with every coefficient moved by a factor of up to three, and up to three hysterons of any kind.
fn plants() -> impl Strategy<Value = Phs> {
    let hysteron = (factor(3.0), factor(300.0)).prop_map(|(c, beta)| Hysteron {
        capacitance_f: 5e-7 * c,
        slope_s: 8e-3 * beta,
        dead_zone_v: 10.0,
    });
    (factor(3.0), factor(3.0), factor(3.0), factor(3.0), prop::collection::vec(hysteron, 0..4)).prop_map(
        |(mass, stiffness, damping, alpha, hysterons)| Phs {
            mass_kg: 1e-3 * mass,
            stiffness_n_per_m: 24e3 * stiffness,
            damping_n_s_per_m: 3.7 * damping,
            transduction_c_per_m: 0.046 * alpha,
            hysterons,
        },
    )
}

fn laws() -> impl Strategy<Value = Loop> {
    (factor(10.0), factor(10.0), factor(4.0), 0.0..4.0).prop_map(|(kp, ki, rate, delay_samples)| {
        let rate_hz = 20e3 * rate;
        Loop { kp_v_per_m: 1e5 * kp, ki_v_per_m_s: 3e8 * ki, rate_hz, delay_s: delay_samples / rate_hz }
    })
}

/// Whether two results say the same, to `relative` of each number's size.
fn same(left: &Margins, right: &Margins, relative: f64) -> bool {
    let close = |x: f64, y: f64| x == y || (x - y).abs() <= relative * x.abs().max(y.abs());
    left.stable == right.stable
        && close(left.spectral_radius, right.spectral_radius)
        && close(left.gain_margin_db, right.gain_margin_db)
        && close(left.phase_margin_deg, right.phase_margin_deg)
        && close(left.delay_margin_s, right.delay_margin_s)
        && close(left.modulus_margin, right.modulus_margin)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

    /// A drive unit s times larger with gains s times smaller is the same loop.
    #[test]
    fn only_the_loop_gain_counts(plant in plants(), law in laws(), scale in factor(1e6)) {
        for region in plant.linear_regions().expect("positive coefficients") {
            let mut scaled = region.clone();
            scaled.b *= scale;
            let weaker =
                Loop { kp_v_per_m: law.kp_v_per_m / scale, ki_v_per_m_s: law.ki_v_per_m_s / scale, ..law };
            let (left, right) = (examine(&region, &law), examine(&scaled, &weaker));
            // Both are good to about 1e-10, and a margin can be a small difference.
            prop_assert!(same(&left, &right, 1e-7), "{left:?}\n{right:?}");
        }
    }

    /// Millimetres, kilovolts and mixtures of them for states: the loop does not know.
    #[test]
    fn state_coordinates_do_not_count(
        plant in plants(),
        law in laws(),
        scales in prop::collection::vec(factor(1e5), 5),
    ) {
        for region in plant.linear_regions().expect("positive coefficients") {
            let n_states = region.a.nrows();
            let scaled = LinearRegion {
                label: region.label.clone(),
                a: DMatrix::from_fn(n_states, n_states, |i, j| region.a[(i, j)] * scales[j] / scales[i]),
                b: DVector::from_fn(n_states, |i, _| region.b[i] / scales[i]),
                c: RowDVector::from_fn(n_states, |_, i| region.c[i] * scales[i]),
                d: region.d,
            };
            let (left, right) = (examine(&region, &law), examine(&scaled, &law));
            prop_assert!(same(&left, &right, 1e-7), "{left:?}\n{right:?}");
        }
    }

    /// Every finite margin, used up, puts an eigenvalue on the circle; part of it does not.
    #[test]
    fn margins_are_where_stability_ends(plant in plants(), law in laws(), part in 0.02..0.98) {
        for region in plant.linear_regions().expect("positive coefficients") {
            let found = examine(&region, &law);
            let gains = [Some(found.gain_margin_db), found.lower_gain_margin_db];
            for gain_db in gains.into_iter().flatten().filter(|gain_db| gain_db.is_finite()) {
                let there = examine(&region, &with_gain(&law, gain_db));
                prop_assert!(distance_from_circle(&there) < 1e-6, "{law:?} {gain_db} dB {there:?}");
                prop_assert!(!found.stable || examine(&region, &with_gain(&law, part * gain_db)).stable);
            }
            let with_delay = |part: f64| Loop { delay_s: law.delay_s + part * found.delay_margin_s, ..law };
            // Longer delays make this test slow, not wrong.
            if found.delay_margin_s.is_finite() && with_delay(1.0).delay_s * law.rate_hz < 60.0 {
                let there = examine(&region, &with_delay(1.0));
                prop_assert!(distance_from_circle(&there) < 1e-6, "{law:?} {found:?} {there:?}");
                let before = examine(&region, &with_delay(part));
                prop_assert!(!found.stable || before.stable, "{law:?} {found} {before}");
            }
            // |1 + L| cannot be further from 0 than the points of the same curve at which the two margins are taken.
            if found.stable && found.gain_margin_db.is_finite() {
                let at_gain = 1.0 - 10_f64.powf(-found.gain_margin_db / 20.0);
                prop_assert!(found.modulus_margin <= at_gain + 1e-9);
            }
            if found.stable && found.phase_margin_deg.is_finite() {
                let at_crossover = 2.0 * (0.5 * found.phase_margin_deg.to_radians()).sin();
                prop_assert!(found.modulus_margin <= at_crossover + 1e-9);
            }
        }
    }

    /// Whatever positive numbers come, the answer is a result or an error, and no NaN.
    #[test]
    fn never_panics(
        numbers in prop::collection::vec(factor(1e12), 8),
        rate_hz in factor(1e9),
        // Longer delays have an error and a test of their own.
        delay_samples in prop_oneof![Just(0.0), 0.0..4.0],
        kp_v_per_m in -1e12..1e12,
        ki_v_per_m_s in prop_oneof![Just(0.0), -1e12..1e12],
    ) {
        let plant = Phs {
            mass_kg: numbers[0],
            stiffness_n_per_m: numbers[1],
            damping_n_s_per_m: numbers[2],
            transduction_c_per_m: numbers[3],
            hysterons: numbers[4..]
                .chunks(2)
                .map(|pair| Hysteron { capacitance_f: pair[0], slope_s: pair[1], dead_zone_v: 10.0 })
                .collect(),
        };
        let law = Loop { kp_v_per_m, ki_v_per_m_s, rate_hz, delay_s: delay_samples / rate_hz };
        for region in &plant.linear_regions().expect("positive coefficients") {
            if let Ok(found) = margins(region, &law) {
                let numbers = [
                    found.spectral_radius,
                    found.gain_margin_db,
                    found.phase_margin_deg,
                    found.delay_margin_s,
                    found.modulus_margin,
                ];
                prop_assert!(numbers.iter().all(|x| !x.is_nan()), "{found:?}");
            }
        }
    }
}
