//! Effects that the nominal numbers imitate exactly: a payload, the gains of sensor and amplifier, and a nominal number that is wrong.
//!
//! Each of them moves the refitted numbers along a known direction and leaves the fit as it is, so that nothing but the priors tells
//! them apart (the exact symmetries of the input-output map, `thesis.md` section 1). That is decided here in parameter space, at the
//! weight of the noise, without a simulation: how much cheaper do the shifts become if one direction is free?

use super::bench::{Bench, Rule, add_priors, factor, pin_idle};
use super::descend::Found;
use super::hypothesis::Hypothesis;
use super::refit::BENT_COST;
use super::search::{Candidate, Search};
use crate::identify::parameters::Quantity;
use nalgebra::{DMatrix, DVector};

/// A time constant below this many samples is instant.
const INSTANT: f64 = 0.05;
/// Chi-square that speaks for an offset against what shifts the displacement in the same way and is rarer: three to one.
pub(super) const RARER: f64 = 2.2;
/// Share of the priors that leaves numbers free which the logs determine.
const NEXT_TO_NOTHING: f64 = 1e-6;
/// Share of its own cost below which a direction is one that is free already.
const ALONG: f64 = 1e-6;
/// A direction explains a good part of a move if it leaves less than this of it.
const GOOD_PART: f64 = 0.75;

/// A direction in the nominal numbers, freed.
#[derive(Clone, Debug)]
pub struct Freed {
    /// The entry.
    pub effect: &'static str,
    /// Which nominal number, for `parameter_error`.
    pub quantity: Option<Quantity>,
    /// How far along the direction: a logarithm of 1 + payload, of the gain, or of the number over its nominal value; of an offset
    /// the multiple of its stated sigma.
    pub along: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// What that is in the entry's own parameter: a ratio less one, or metres.
    pub value: f64,
    /// Its standard deviation.
    pub value_sigma: f64,
    /// What the shifts cost once it is free, chi-square.
    pub cost: f64,
    /// What they cost without it.
    pub cost_without: f64,
    /// Chi-square that speaks against it beforehand, beside another one of the same direction.
    pub rarer: f64,
}

impl From<Freed> for Vec<Freed> {
    fn from(freed: Freed) -> Self {
        vec![freed]
    }
}

impl Freed {
    /// Chi-square that freeing the direction saves.
    pub fn gain(&self) -> f64 {
        self.cost_without - self.cost
    }

    /// Fraction of the shifts' cost, as amplitude, that stays once the direction is free, and that shifts within their sigmas do not have.
    pub fn unexplained(&self) -> f64 {
        unexplained(self.cost, self.cost_without)
    }

    fn is(&self, (effect, quantity, _): &Direction) -> bool {
        (self.effect, self.quantity) == (*effect, *quantity)
    }
}

/// Fraction of `whole`, what shifts cost, that stays as amplitude where they cost `cost`, beyond what shifts within their sigmas do.
pub(super) fn unexplained(cost: f64, whole: f64) -> f64 {
    ((cost - BENT_COST).max(0.0) / whole.max(f64::MIN_POSITIVE)).sqrt()
}

/// The identifiers decided here rather than by simulation: a drive monitor shows the amplifier's gain, and an offset is imitated where
/// the plant's file leaves the sensor's zero open.
pub fn symmetric(bench: &Bench<'_>) -> Vec<&'static str> {
    let mut all: Vec<&str> =
        directions(bench).iter().map(|(id, ..)| *id).filter(|id| *id != "parameter_error").collect();
    all.dedup();
    all
}

/// All directions, cheapest first.
pub fn freed(search: &Search<'_>, candidate: &Candidate) -> Vec<Freed> {
    Shifts::of(search, candidate).map_or_else(Vec::new, |shifts| shifts.freed(&[]))
}

/// How far a fit has shifted the nominal numbers, and what that costs.
pub(super) struct Shifts<'a> {
    bench: &'a Bench<'a>,
    directions: Vec<Direction>,
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    z: DVector<f64>,
    prior: DMatrix<f64>,
    least: f64,
}

type Direction = (&'static str, Option<Quantity>, DVector<f64>);

impl<'a> Shifts<'a> {
    /// Those of `candidate`; none where its logs determine nothing.
    pub fn of(search: &Search<'a>, candidate: &Candidate) -> Option<Self> {
        let (bench, Candidate { hypothesis, found, .. }) = (search.bench, candidate);
        // Coloured noise moves the numbers by more than as many independent readings would.
        let weights = search.independent_weights(candidate);
        let (information, gradient) = reduced(bench, hypothesis, found, &weights)?;
        let z = DVector::from_column_slice(&found.z[..bench.free.len()]);
        let prior = prior(bench)?;
        let least = least_misfit(&information, &gradient, &z, &prior)?;
        Some(Self { bench, directions: directions(bench), information, gradient, z, prior, least })
    }

    /// All directions with `beside` free already, cheapest first.
    pub fn freed(&self, beside: &[Freed]) -> Vec<Freed> {
        let prior = beside.iter().fold(self.prior.clone(), |prior, known| {
            self.directions.iter().find(|of| known.is(of)).map_or(prior.clone(), |(.., along)| open(&prior, along))
        });
        // Any of the nominal numbers may be the wrong one: which, has to be found as well.
        let wrong = self.directions.iter().filter(|(effect, ..)| *effect == "parameter_error").count();
        let among_many = 2.0 * (wrong.max(1) as f64).ln();
        let one = |(effect, quantity, direction): &Direction| {
            // What moves nothing but what is free already is no direction of its own.
            let norm = |prior: &DMatrix<f64>| direction.dot(&(prior * direction));
            if norm(&prior) < ALONG * norm(&self.prior) {
                return None;
            }
            let Self { information, gradient, z, .. } = self;
            let (along, sigma, cost, cost_without) = free_one(information, gradient, z, &prior, direction)?;
            let offset = self.bench.free.iter().zip(direction).find(|(free, _)| free.quantity == Quantity::Offset);
            let (value, value_sigma) = match offset {
                Some((free, &is_moved)) if is_moved != 0.0 => {
                    (free.at(along) - free.prior, free.number_sigma(along, sigma))
                }
                _ => (along.exp_m1(), along.exp() * sigma),
            };
            let rarer = match *effect {
                "asymmetric_hysteresis" => RARER,
                "parameter_error" => among_many,
                _ => 0.0,
            };
            let [cost, cost_without] = [cost, cost_without].map(|cost| (cost - self.least).max(0.0));
            Some(Freed { effect, quantity: *quantity, along, sigma, value, value_sigma, cost, cost_without, rarer })
        };
        let mut all: Vec<Freed> = self.directions.iter().filter_map(one).collect();
        all.sort_by(|a, b| (a.cost + a.rarer).total_cmp(&(b.cost + b.rarer)));
        all
    }

    /// Two directions of different entries at once, cheapest first. Each costs what both do, and without it what the other does alone.
    pub fn in_pairs(&self) -> Vec<[Freed; 2]> {
        let singles = self.freed(&[]);
        let mut pairs: Vec<[Freed; 2]> = Vec::new();
        for (number, first) in singles.iter().enumerate() {
            let beside_first = self.freed(std::slice::from_ref(first));
            for second in singles[number + 1..].iter().filter(|second| second.effect != first.effect) {
                let same = |of: &Freed, known: &Freed| (of.effect, of.quantity) == (known.effect, known.quantity);
                let beside_second = self.freed(std::slice::from_ref(second));
                let both = beside_second.into_iter().find(|of| same(of, first));
                let both = both.zip(beside_first.iter().find(|of| same(of, second)).cloned());
                pairs.extend(both.map(|(first, second)| [first, second]));
            }
        }
        let price = |[first, second]: &[Freed; 2]| first.cost + first.rarer + second.rarer;
        pairs.sort_by(|a, b| price(a).total_cmp(&price(b)));
        pairs
    }
}

/// `prior` once the shift along a direction costs nothing.
fn open(prior: &DMatrix<f64>, along: &DVector<f64>) -> DMatrix<f64> {
    let weighed = prior * along;
    let norm = weighed.dot(along);
    if norm > 0.0 { prior - &weighed * weighed.transpose() / norm } else { prior.clone() }
}

/// Coordinates of the nominal numbers where a payload or a gain would have put them, if one explains a good part of how far `found` has moved
/// them. What moves them all locks dead zones and capacitances on the way; so distances count as they are, not squared: the few numbers
/// that went astray are no part of it.
pub(super) fn along(bench: &Bench<'_>, found: &Found) -> Option<Vec<f64>> {
    towards(bench, &found.z[..bench.free.len()])
}

fn towards(bench: &Bench<'_>, z: &[f64]) -> Option<Vec<f64>> {
    let away = |direction: &DVector<f64>, by: f64| -> f64 {
        let moved = bench.free.iter().zip(z).zip(direction.iter());
        moved.map(|((free, z), d)| (z - by * d).abs() / free.prior_sigma).sum()
    };
    let mut best: Option<(f64, DVector<f64>)> = None;
    for (_, _, direction) in directions(bench).into_iter().filter(|(id, ..)| *id != "parameter_error") {
        for by in z.iter().zip(direction.iter()).filter(|(_, d)| **d != 0.0).map(|(z, d)| z / d) {
            let left = away(&direction, by);
            if best.as_ref().is_none_or(|(least, _)| left < *least) {
                best = Some((left, &direction * by));
            }
        }
    }
    let whole = away(&DVector::zeros(z.len()), 0.0);
    best.filter(|(left, _)| *left < GOOD_PART * whole).map(|(_, numbers)| numbers.iter().copied().collect())
}

/// Inverse covariance of the nominal numbers under the priors. The mass is not among them: what it is off by shifts those along the
/// payload's direction.
fn prior(bench: &Bench<'_>) -> Option<DMatrix<f64>> {
    let own = DVector::from_iterator(bench.free.len(), bench.free.iter().map(|free| free.prior_sigma.powi(2)));
    let (_, _, payload) = directions(bench).into_iter().find(|(id, ..)| *id == "payload_mass")?;
    let covariance = DMatrix::from_diagonal(&own) + &payload * payload.transpose() * bench.mass_sigma.powi(2);
    covariance.cholesky().map(|factor| factor.inverse())
}

/// Data information and gradient of the nominal numbers once everything else is free to follow.
fn reduced(
    bench: &Bench<'_>,
    hypothesis: &Hypothesis,
    found: &Found,
    weights: &[f64],
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let nominal = bench.free.len();
    let (mut information, mut gradient) = found.normal.assemble(weights);
    let size = information.nrows();
    // The nominal numbers' own priors are what the directions are judged by.
    let rules: Vec<Rule> = bench
        .rules(hypothesis)
        .into_iter()
        .enumerate()
        .map(|(i, rule)| if i < nominal { Rule { sigma: f64::INFINITY, ..rule } } else { rule })
        .collect();
    add_priors(&rules, &found.z, &mut information, &mut gradient);
    pin_idle(&mut information);
    let rest = size - nominal;
    if rest == 0 {
        return Some((information, gradient));
    }
    let own = factor(information.view((nominal, nominal), (rest, rest)).into_owned())?;
    let cross = information.view((0, nominal), (nominal, rest)).into_owned();
    let reduced = information.view((0, 0), (nominal, nominal)).into_owned() - &cross * own.solve(&cross.transpose());
    let gradient =
        gradient.rows(0, nominal).into_owned() - &cross * own.solve(&gradient.rows(nominal, rest).into_owned());
    Some((reduced, gradient))
}

pub(super) fn directions(bench: &Bench<'_>) -> Vec<Direction> {
    let along = |of: &dyn Fn(Quantity) -> f64| {
        DVector::from_iterator(bench.free.len(), bench.free.iter().map(|f| of(f.quantity)))
    };
    let payload = along(&|q| match q {
        Quantity::DeadZone(_) | Quantity::Delay | Quantity::Offset => 0.0,
        _ => -1.0,
    });
    let gain = |dead_zone: f64| {
        along(&|q| match q {
            Quantity::Transduction => 1.0,
            Quantity::Capacitance(_) | Quantity::Slope(_) => 2.0,
            Quantity::DeadZone(_) => dead_zone,
            _ => 0.0,
        })
    };
    let mut all = vec![("payload_mass", None, payload), ("sensor_gain", None, gain(0.0))];
    if !bench.is_monitored() {
        all.push(("amplifier_gain", None, gain(-1.0)));
    }
    for free in bench.free.iter().filter(|free| is_seen(bench, free.quantity)) {
        let alone = along(&|q| f64::from(u8::from(q == free.quantity)));
        match free.quantity {
            // A hysteron that turns back about another voltage than zero pulls with a constant force.
            Quantity::Offset => {
                all.push(("sensor_offset", None, alone.clone()));
                all.push(("asymmetric_hysteresis", None, alone));
            }
            wrong => all.push(("parameter_error", Some(wrong), alone)),
        }
    }
    all
}

/// Whether logs sampled like these can show a number to be wrong: how fast a hysteron discharges that is done within a small part of a
/// sample is a matter of how it is integrated.
fn is_seen(bench: &Bench<'_>, quantity: Quantity) -> bool {
    let Quantity::Slope(i) = quantity else { return true };
    let sample_s = bench.records.iter().map(|record| record.log.dt_s).fold(f64::INFINITY, f64::min);
    let hysterons = &bench.chain.plant.hysterons;
    hysterons.get(i).is_none_or(|hysteron| hysteron.capacitance_f / hysteron.slope_s > INSTANT * sample_s)
}

/// Misfit beside that of the numbers z if no shift cost anything (next to nothing, where the logs leave a number open): what shifts cost counts
/// from there.
fn least_misfit(
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
    z: &DVector<f64>,
    prior: &DMatrix<f64>,
) -> Option<f64> {
    let weak = prior * NEXT_TO_NOTHING;
    let change = (information + &weak).cholesky()?.solve(&(gradient - &weak * z));
    Some(-2.0 * gradient.dot(&change) + change.dot(&(information * &change)))
}

/// Minimises misfit and shifts over the numbers x = z + d and the free factor m: -2 g.d + d.I.d + (x - m s).P.(x - m s).
fn free_one(
    information: &DMatrix<f64>,
    gradient: &DVector<f64>,
    z: &DVector<f64>,
    prior: &DMatrix<f64>,
    direction: &DVector<f64>,
) -> Option<(f64, f64, f64, f64)> {
    let n = z.len();
    let cost = |d: &DVector<f64>, m: f64| {
        let away = z + d - direction * m;
        -2.0 * gradient.dot(d) + d.dot(&(information * d)) + away.dot(&(prior * &away))
    };
    let weighed = prior * direction;
    let pulled = prior * z;
    let mut a = DMatrix::zeros(n + 1, n + 1);
    let mut b = DVector::zeros(n + 1);
    for i in 0..n {
        for j in 0..n {
            a[(i, j)] = information[(i, j)] + prior[(i, j)];
        }
        a[(i, n)] = -weighed[i];
        a[(n, i)] = -weighed[i];
        b[i] = gradient[i] - pulled[i];
    }
    a[(n, n)] = weighed.dot(direction) * (1.0 + 1e-12);
    b[n] = weighed.dot(z);
    let factor = a.clone().cholesky()?;
    let solved = factor.solve(&b);
    let without = a.view((0, 0), (n, n)).into_owned().cholesky()?.solve(&b.rows(0, n).into_owned());
    let (d, m) = (solved.rows(0, n).into_owned(), solved[n]);
    let sigma = factor.inverse()[(n, n)].sqrt();
    Some((m, sigma, cost(&d, m), cost(&without, 0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::thesis;
    use plant_sim::param::Param;

    /// A payload is seen in numbers of which two have locked one another; numbers that moved each for itself show none.
    #[test]
    fn a_payload_is_seen_beside_numbers_that_went_astray() {
        let model = thesis();
        let bench = Bench::new(&model, Vec::new());
        let payload = |q: Quantity| if matches!(q, Quantity::DeadZone(_)) { 0.0 } else { -0.27 };
        let moved = |q: Quantity| match q {
            Quantity::Capacitance(0) => 0.36,
            Quantity::DeadZone(0) => -0.5,
            other => payload(other),
        };
        let of = |to: &dyn Fn(Quantity) -> f64| bench.free.iter().map(|f| to(f.quantity)).collect::<Vec<_>>();
        let found = towards(&bench, &of(&moved)).expect("a direction");
        assert!(found.iter().zip(of(&payload)).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        let apart: Vec<f64> = (0..bench.free.len()).map(|i| if i % 2 == 0 { 0.1 } else { -0.1 }).collect();
        assert_eq!(towards(&bench, &apart), None);
    }

    /// A mass that is off by its sigma shifts all numbers along the payload's direction; that costs what one number's sigma costs at the
    /// most, however many numbers it shifts. Any other shift of one number costs its own sigma.
    #[test]
    fn a_mass_within_its_sigma_is_no_payload() {
        let model = thesis();
        let bench = Bench::new(&model, Vec::new());
        let prior = prior(&bench).expect("a prior");
        let (_, _, payload) = directions(&bench).into_iter().find(|(id, ..)| *id == "payload_mass").expect("payload");
        let shift = &payload * bench.mass_sigma;
        let cost = shift.dot(&(&prior * &shift));
        let apart: f64 = bench.free.iter().zip(shift.iter()).map(|(free, z)| (z / free.prior_sigma).powi(2)).sum();
        assert!((cost - apart / (1.0 + apart)).abs() < 1e-9, "{cost} against {apart}");
        let mut one = DVector::zeros(bench.free.len());
        let dead_zone = bench.free.iter().position(|free| matches!(free.quantity, Quantity::DeadZone(_))).expect("one");
        one[dead_zone] = bench.free[dead_zone].prior_sigma;
        assert!((one.dot(&(&prior * &one)) - 1.0).abs() < 1e-9);
    }

    /// A zero that is off and a wrong number shift other coordinates: neither alone pays for both, and what shifts the same is no second one.
    #[test]
    fn two_that_are_off_are_told_together() {
        let mut model = thesis();
        model.sensor.offset_um = Some(Param::absolute(0.0, 0.6, ""));
        let bench = Bench::new(&model, Vec::new());
        let directions = directions(&bench);
        let prior = prior(&bench).expect("a prior");
        let place = |quantity: Quantity| bench.free.iter().position(|free| free.quantity == quantity).expect("free");
        let off = [(Quantity::Offset, 9.0), (Quantity::Damping, -12.0)];
        let mut z = DVector::zeros(bench.free.len());
        off.iter()
            .for_each(|(quantity, sigmas)| z[place(*quantity)] = sigmas * bench.free[place(*quantity)].prior_sigma);
        let information = DMatrix::from_diagonal_element(z.len(), z.len(), 1e9);
        let gradient = DVector::zeros(z.len());
        let shifts = Shifts { bench: &bench, directions, information, gradient, z, prior, least: 0.0 };
        let best = &shifts.freed(&[])[0];
        let alone = best.gain();
        assert_eq!((best.quantity, best.cost.round()), (Some(Quantity::Damping), 81.0));
        let pairs = shifts.in_pairs();
        let [first, second] = &pairs[0];
        assert_eq!([first.effect, second.effect], ["parameter_error", "sensor_offset"]);
        assert!(first.cost < 0.01, "{}", first.cost);
        // A mass that is off as well would pay for a little of the damping.
        assert!((second.gain() - 81.0).abs() < 0.1, "{}", second.gain());
        assert!((first.gain() - alone).abs() < 0.1 && first.gain() > 100.0, "{} {alone}", first.gain());
        let beside_offset = shifts.freed(std::slice::from_ref(second));
        assert!(beside_offset.iter().all(|freed| !["sensor_offset", "asymmetric_hysteresis"].contains(&freed.effect)));
    }

    /// Where a fit ended on other weights than those that judge it, the misfit there is no zero to count from.
    #[test]
    fn what_shifts_cost_counts_from_the_least_misfit() {
        let information = DMatrix::from_diagonal(&DVector::from_vec(vec![1e9, 4e9]));
        let prior = DMatrix::from_diagonal(&DVector::from_vec(vec![1.0, 1.0]));
        // The logs want the numbers at 3 and -1, the fit ended a little beside that.
        let (wanted, z) = (DVector::from_vec(vec![3.0, -1.0]), DVector::from_vec(vec![3.0002, -1.0001]));
        let gradient = &information * (&wanted - &z);
        let least = least_misfit(&information, &gradient, &z, &prior).expect("determined");
        let direction = DVector::from_vec(vec![1.0, 0.0]);
        let (along, _, cost, without) = free_one(&information, &gradient, &z, &prior, &direction).expect("determined");
        assert!(cost < -30.0, "{cost}");
        assert!((along - 3.0).abs() < 1e-6 && (cost - least - 1.0).abs() < 1e-6, "{along} {}", cost - least);
        assert!((without - least - 10.0).abs() < 1e-6, "{}", without - least);
    }
}
