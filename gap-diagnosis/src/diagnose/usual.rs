//! What another log may be expected to have of what belongs to each: a drift that comes back, the phase of a line, how the sensor was set, what
//! hysterons hold.

use super::bench::{Bench, Rule, factor};
use super::hypothesis::{Held, Hypothesis};
use nalgebra::{DMatrix, DVector};
use plant_sim::effects::Scope;

/// Least width of what other logs have of a number, in typical sizes.
const LEAST_WIDTH: f64 = 0.01;
/// A log tells what a hysteron holds where it makes that so many times better known than it is beforehand, ..
const TOLD: f64 = 4.0;
/// .. and so many logs tell what hysterons hold elsewhere, ..
const ENOUGH: usize = 3;
/// .. to this error of each at the least: they make up for numbers that are a little off.
const LEAST_HELD: f64 = 0.01;
/// Logarithm of the odds below which a hysteron did not rest when logs began: those that tell nothing have even odds.
const AGAINST: f64 = -0.5;

impl Hypothesis {
    /// This for another log: of what belongs to each log it has what the logs of `bench` have at `z` in the mean. Where its first stretch tells it, give
    /// or take twice how these differ; where nothing does, as far as they have it in common.
    pub fn as_usual(&self, bench: &Bench<'_>, z: &[f64]) -> Self {
        let places: Vec<_> = (0..bench.records.len()).map(|index| bench.places(self, index)).collect();
        let mut usual = self.clone();
        for (at, installed) in usual.installed.iter_mut().enumerate() {
            let numbers = installed.of_scope(Scope::EachStart);
            let of_logs = of_each_log(&places, at, &numbers, z);
            // Lines side by side make up for one another in a log that is too short to tell them apart, and in another log they need not.
            let most = if numbers.len() > 2 { share(&of_logs, &installed.squares_of_start) } else { None };
            for (i, number) in numbers.into_iter().enumerate() {
                let of_logs: Vec<f64> = of_logs.iter().map(|of_log| of_log[i]).collect();
                let count = of_logs.len() as f64;
                let mean = of_logs.iter().sum::<f64>() / count;
                let spread2 = of_logs.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
                // One log says nothing of how they differ.
                let width = if of_logs.len() > 1 { 2.0 * spread2.sqrt() } else { mean.abs().max(1.0) };
                let most = most.as_ref().map_or(f64::INFINITY, |most| most[i]);
                installed.axes[number].usual = Some([mean.clamp(-most, most), width.min(2.0 * most).max(LEAST_WIDTH)]);
            }
        }
        for (at, own, common) in self.in_common(bench, z) {
            for (i, &number) in own.iter().enumerate() {
                let width = (2.0 * common.spread[i]).max(LEAST_WIDTH);
                usual.installed[at].axes[number].usual = Some([common.expected[i], width]);
            }
        }
        usual.usually_held = self.held(bench, z);
        usual
    }

    /// This for a log of which others do not tell what its hysterons hold.
    pub fn alone(&self) -> Self {
        Self { usually_held: Vec::new(), ..self.clone() }
    }

    /// What each hysteron holds when the logs of `bench` begin that tell it. Logs of one bench begin in like manner or they do not, and what they hold
    /// says so.
    fn held(&self, bench: &Bench<'_>, z: &[f64]) -> Vec<Option<Held>> {
        let of_hysteron = |i: usize| {
            let of_log = |(log, variances): (usize, &Vec<f64>)| {
                let held = bench.held_places(self, log).start;
                [z[held + i], variances[i]]
            };
            Held::of(&self.variances_of_held.iter().enumerate().map(of_log).collect::<Vec<_>>())
        };
        (0..bench.held_places(self, 0).len()).map(of_hysteron).collect()
    }

    /// This where it is known how well each log tells what hysterons hold, by the `covariance` of its coordinates.
    pub fn telling_held(mut self, bench: &Bench<'_>, covariance: &DMatrix<f64>) -> Self {
        let rules = bench.rules(&self);
        let variance = |place: usize| {
            // What is hardly better known than beforehand is what was thought beforehand.
            if is_told(covariance, &rules, place) { covariance[(place, place)] } else { f64::INFINITY }
        };
        let of_log = |log: usize| bench.held_places(&self, log).map(variance).collect();
        self.variances_of_held = (0..bench.records.len()).map(of_log).collect();
        self
    }

    /// This where hysterons hold nothing that agree with it in all logs of `bench`, going by the `covariance` of its coordinates `z`, and the probability
    /// that they do not: a start that could be anywhere is hardly at rest by chance. The odds of numbers to be nothing are their density there against
    /// what that was beforehand (Dickey 1971): of all logs together, and for the probability of one alone, as all may have begun in one other state.
    pub fn resting(&self, bench: &Bench<'_>, z: &[f64], covariance: &DMatrix<f64>) -> Option<(Self, f64)> {
        let rules = bench.rules(self);
        let of_hysteron = |i: usize| {
            let places: Vec<usize> =
                (0..bench.records.len()).map(|log| bench.held_places(self, log).start + i).collect();
            let log_odds = |places: &[usize]| {
                let known = DMatrix::from_fn(places.len(), places.len(), |i, j| {
                    let least = if i == j { LEAST_HELD.powi(2) } else { 0.0 };
                    (covariance[(places[i], places[j])] + least) / (rules[places[i]].sigma * rules[places[j]].sigma)
                });
                let away =
                    DVector::from_iterator(places.len(), places.iter().map(|place| z[*place] / rules[*place].sigma));
                known.cholesky().map(|known| -0.5 * (known.ln_determinant() + away.dot(&known.solve(&away))))
            };
            let of_all = log_odds(&places)?;
            let told = places.iter().filter(|place| is_told(covariance, &rules, **place));
            let of_one = told.filter_map(|place| log_odds(&[*place])).reduce(f64::max).unwrap_or(0.0);
            // Logs that agree with one another speak for what they agree on, rest or not.
            (of_all.min(of_one) > AGAINST).then_some(1.0 / (1.0 + of_one.exp()))
        };
        let memories = bench.memories(self);
        let of = |i: usize| if memories.contains(&i) { of_hysteron(i) } else { None };
        let charged: Vec<Option<f64>> = (0..bench.held_places(self, 0).len()).map(of).collect();
        let usually_held = charged.iter().map(|charged| charged.map(|_| Held::NOTHING)).collect();
        let probability = charged.into_iter().flatten().reduce(f64::max)?;
        Some((Self { usually_held, ..self.clone() }, probability))
    }

    /// This where all hysterons that may hold something when a log begins hold nothing, and its coordinates `z` there; none where none may.
    pub fn at_rest(&self, bench: &Bench<'_>, z: &[f64]) -> Option<(Self, Vec<f64>)> {
        let memories = bench.memories(self);
        let count = bench.held_places(self, 0).len();
        let usually_held = (0..count).map(|i| memories.contains(&i).then_some(Held::NOTHING)).collect();
        let mut there = z.to_vec();
        for log in 0..bench.records.len() {
            let held = &mut there[bench.held_places(self, log)];
            memories.iter().for_each(|memory| held[*memory] = 0.0);
        }
        (!memories.is_empty()).then(|| (Self { usually_held, ..self.clone() }, there))
    }

    /// Coordinates `z` of the logs of `bench` where each has of what no first stretch tells what the others let expect.
    pub fn as_others(&self, bench: &Bench<'_>, z: &[f64]) -> Vec<f64> {
        let mut as_others = z.to_vec();
        for (at, own, common) in self.in_common(bench, z) {
            for (index, by_others) in common.by_others.iter().enumerate() {
                let places = &bench.places(self, index)[at];
                own.iter().zip(by_others).for_each(|(number, z)| as_others[places[*number]] = *z);
            }
        }
        as_others
    }

    /// This where it is known what a unit of what belongs to each log makes of it, by the `products` of each log's sensitivities.
    pub fn knowing(mut self, bench: &Bench<'_>, products: &[&DMatrix<f64>]) -> Self {
        let places: Vec<_> = (0..bench.records.len()).map(|index| bench.places(&self, index)).collect();
        let begins: Vec<usize> = (0..bench.records.len()).map(|index| bench.own_start(&self, index)).collect();
        let shared = bench.shared(&self);
        for (at, installed) in self.installed.iter_mut().enumerate() {
            let squares_of = |numbers: Vec<usize>| -> Vec<DMatrix<f64>> {
                let of_log = |(index, products): (usize, &&DMatrix<f64>)| {
                    let place = |i: usize| places[index][at][numbers[i]] - begins[index] + shared;
                    DMatrix::from_fn(numbers.len(), numbers.len(), |i, j| products[(place(i), place(j))])
                };
                products.iter().enumerate().map(of_log).collect()
            };
            installed.squares_of_start = squares_of(installed.of_scope(Scope::EachStart));
            installed.squares_of_own = squares_of(installed.of_scope(Scope::EachLog));
        }
        self
    }

    /// What the logs of `bench` have in common at `z` of what belongs to each and no first stretch tells: of which form, which of its axes, and what.
    fn in_common(&self, bench: &Bench<'_>, z: &[f64]) -> Vec<(usize, Vec<usize>, Common)> {
        let places: Vec<_> = (0..bench.records.len()).map(|index| bench.places(self, index)).collect();
        let of_form = |at: usize| {
            let own = self.installed[at].of_scope(Scope::EachLog);
            let of_logs = of_each_log(&places, at, &own, z);
            let common = (!own.is_empty()).then(|| Common::of(&of_logs, &self.installed[at].squares_of_own));
            common.map(|common| (at, own, common))
        };
        (0..self.installed.len()).filter_map(of_form).collect()
    }
}

/// Whether the logs tell the coordinate at `place`, by the `covariance` of all and what `rules` know beforehand.
fn is_told(covariance: &DMatrix<f64>, rules: &[Rule], place: usize) -> bool {
    covariance[(place, place)].sqrt() * TOLD < rules[place].sigma
}

impl Held {
    /// What a hysteron at rest holds.
    const NOTHING: Self = Self { mean: 0.0, width: 1e-6, against_nothing: 0.0 };

    /// Of logs with these coordinates and variances, by how much more they differ than these explain (DerSimonian and Laird 1986).
    fn of(logs: &[[f64; 2]]) -> Option<Self> {
        let telling: Vec<[f64; 2]> = logs.iter().filter(|[_, variance]| variance.is_finite()).copied().collect();
        if telling.len() < ENOUGH {
            return None;
        }
        let sums = |apart2: f64| {
            let weights = telling.iter().map(|[z, variance]| (1.0 / (variance + LEAST_HELD.powi(2) + apart2), z));
            weights.fold([0.0; 3], |[sum, of_z, of_squares], (w, z)| [sum + w, of_z + w * z, of_squares + w * w])
        };
        let [sum, of_z, of_squares] = sums(0.0);
        let squares = |[z, variance]: &[f64; 2]| (z - of_z / sum).powi(2) / (variance + LEAST_HELD.powi(2));
        let beyond = telling.iter().map(squares).sum::<f64>() - (telling.len() as f64 - 1.0);
        let apart2 = (beyond / (sum - of_squares / sum)).max(0.0);
        let [sum, of_z, _] = sums(apart2);
        let (mean, error2) = (of_z / sum, 1.0 / sum);
        let width = (4.0 * apart2 + error2 + LEAST_HELD.powi(2)).sqrt();
        Some(Self { mean, width, against_nothing: mean.powi(2) / error2 })
    }
}

/// Coordinates `z` of the `numbers` of form `at`, of each log whose forms have these `places`.
fn of_each_log(places: &[Vec<Vec<usize>>], at: usize, numbers: &[usize], z: &[f64]) -> Vec<DVector<f64>> {
    let of_log = |places: &Vec<Vec<usize>>| DVector::from_fn(numbers.len(), |i, _| z[places[at][numbers[i]]]);
    places.iter().map(of_log).collect()
}

/// What each number of a log would be if all made the same share of what they make of it together, rms over the logs; `None` where a number
/// makes nothing.
fn share(of_logs: &[DVector<f64>], squares: &[DMatrix<f64>]) -> Option<DVector<f64>> {
    let (first, logs) = (squares.first()?, of_logs.len().min(squares.len()) as f64);
    let mut squares_of_all = DVector::zeros(first.nrows());
    for (of_log, squares) in of_logs.iter().zip(squares) {
        let made = (squares * of_log).dot(of_log).max(0.0);
        squares_of_all += squares.diagonal().map(|one| made / one / (logs * of_log.len() as f64));
    }
    let most = squares_of_all.map(f64::sqrt);
    most.iter().all(|most| most.is_finite()).then_some(most)
}

/// What logs have in common of numbers that each has of its own.
struct Common {
    /// What another log may be expected to have.
    expected: DVector<f64>,
    /// What the others let expect of each.
    by_others: Vec<DVector<f64>>,
    /// How logs differ in each number.
    spread: DVector<f64>,
}

impl Common {
    /// Of logs with `of_logs`, of which a unit makes `squares`. Logs are compared by the courses that these make, as a short one hardly tells what only a
    /// long one shows. What they have in common is the share of their mean that tells each log by all others: in the mean of all it may be one log's.
    fn of(of_logs: &[DVector<f64>], squares: &[DMatrix<f64>]) -> Self {
        let zero = || DVector::zeros(of_logs[0].len());
        let whole = squares.iter().fold(DMatrix::zeros(zero().len(), zero().len()), |sum, squares| sum + squares);
        let logs = || of_logs.iter().zip(squares);
        let weighed = logs().fold(zero(), |sum, (of_log, squares)| sum + squares * of_log);
        let mean = |whole: DMatrix<f64>, weighed: &DVector<f64>| {
            factor(whole).map_or_else(zero, |factor| factor.solve(weighed))
        };
        let all = mean(whole.clone(), &weighed);
        let others = |(of_log, squares): (&DVector<f64>, &DMatrix<f64>)| {
            // One log says nothing of another one.
            if of_logs.len() < 2 { zero() } else { mean(&whole - squares, &(&weighed - squares * of_log)) }
        };
        let by_others: Vec<DVector<f64>> = logs().map(others).collect();
        let product = |squares: &DMatrix<f64>, one: &DVector<f64>, other: &DVector<f64>| (squares * one).dot(other);
        let (mut told, mut power, mut apart) = (0.0, 0.0, 0.0);
        for ((of_log, squares), by_others) in logs().zip(&by_others) {
            let away = of_log - &all;
            told += product(squares, by_others, of_log);
            power += product(squares, by_others, by_others);
            apart += product(squares, &away, &away);
        }
        let share = if power > 0.0 { (told / power).clamp(0.0, 1.0) } else { 0.0 };
        let variance = apart / of_logs.len().saturating_sub(1).max(1) as f64;
        let spread = |i: usize, _| (variance * of_logs.len() as f64 / whole[(i, i)].max(f64::MIN_POSITIVE)).sqrt();
        Self {
            spread: DVector::from_fn(zero().len(), spread),
            expected: share * all,
            by_others: by_others.into_iter().map(|by_others| share * by_others).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::hypothesis::Freedom;
    use crate::diagnose::records::record;
    use crate::diagnose::thesis;
    use plant_sim::effects::find;
    use plant_sim::log::Log;

    /// Of logs that tell one number each equally well.
    fn of(values: &[f64]) -> Common {
        let of_logs: Vec<DVector<f64>> = values.iter().map(|value| DVector::from_element(1, *value)).collect();
        Common::of(&of_logs, &vec![DMatrix::from_element(1, 1, 3.0); values.len()])
    }

    #[test]
    fn logs_that_begin_alike_tell_how_others_begin() {
        let known = |z: [f64; 4]| Held::of(&z.map(|z| [z, 1e-6])).expect("four logs");
        let alike = known([0.5, 0.502, 0.498, 0.5]);
        assert!((alike.mean - 0.5).abs() < 1e-9 && alike.width < 0.013, "{alike:?}");
        assert!(alike.against_nothing > 1000.0 && known([0.0, 2e-3, -2e-3, 0.0]).against_nothing < 1e-9);
        // Twice how much logs differ, and the error of their mean.
        let differing = known([1.0, 0.0, -1.0, 0.0]);
        let expected = (4.0 * 2.0 / 3.0 + 2.0 / 3.0 / 4.0f64).sqrt();
        assert!((differing.width / expected - 1.0).abs() < 1e-3, "{} {expected}", differing.width);
        // Logs that differ by no more than they are known differ by nothing.
        let vague = Held::of(&[[0.3, 0.09], [-0.3, 0.09], [0.0, 0.09]]).expect("three logs");
        assert!((vague.width - (0.03f64 + 1e-4).sqrt()).abs() < 1e-3, "{vague:?}");
        assert!(Held::of(&[[0.5, 1e-6], [0.5, 1e-6], [0.0, f64::INFINITY]]).is_none());
    }

    #[test]
    fn hysterons_rest_that_agree_with_it_in_all_logs() {
        let model = thesis();
        let log = Log { dt_s: 5e-5, command_v: vec![0.0; 400], displacement_m: vec![0.0; 400], ..Log::default() };
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None); 3]);
        let hypothesis = Hypothesis::nominal(Freedom::Rest);
        let place = |log: usize, hysteron: usize| bench.held_places(&hypothesis, log).start + hysteron;
        let (mut z, size) = (bench.origin(&hypothesis), bench.coordinates(&hypothesis));
        let rules = bench.rules(&hypothesis);
        let mut covariance = DMatrix::from_fn(size, size, |i, j| if i == j { rules[i].sigma.powi(2) } else { 0.0 });
        for log in 0..3 {
            covariance[(place(log, 0), place(log, 0))] = 0.01 * rules[place(log, 0)].sigma.powi(2);
            covariance[(place(log, 1), place(log, 1))] = 1e-6;
        }
        z[place(2, 1)] = 0.5;
        let (resting, charged) = hypothesis.resting(&bench, &z, &covariance).expect("one rests");
        assert!(resting.usually_held[0].is_some() && resting.usually_held[1].is_none());
        assert!((charged - 1.0 / 11.0).abs() < 2e-3, "{charged}");
        // A sensor's zero leaves open what all hold alike, and not that they differ.
        let (mut alike, sigma2) = (covariance.clone(), rules[place(0, 0)].sigma.powi(2));
        (0..9).filter(|k| k / 3 != k % 3).for_each(|k| alike[(place(k / 3, 0), place(k % 3, 0))] = 0.00999 * sigma2);
        let mut differing = z.clone();
        [0.1, -0.1, 0.1].iter().enumerate().for_each(|(log, share)| differing[place(log, 0)] = share * sigma2.sqrt());
        assert!(hypothesis.resting(&bench, &differing, &covariance).is_some());
        assert!(hypothesis.resting(&bench, &differing, &alike).is_none());
        // What a log does not tell is no sign of rest, and none of the contrary.
        covariance[(place(1, 0), place(1, 0))] = rules[place(1, 0)].sigma.powi(2);
        assert!(hypothesis.resting(&bench, &z, &covariance).is_some());
        z[place(2, 0)] = 0.5 * rules[place(2, 0)].sigma;
        assert!(hypothesis.resting(&bench, &z, &covariance).is_none());
    }

    #[test]
    fn logs_that_agree_on_a_charge_do_not_rest_and_what_leaks_is_no_memory() {
        let model = thesis();
        let log = Log { dt_s: 5e-5, command_v: vec![0.0; 400], displacement_m: vec![0.0; 400], ..Log::default() };
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None); 4]);
        let creep = find("creep").expect("an entry");
        let hypothesis = Hypothesis::nominal(Freedom::Rest).with(creep, &creep.forms()[0], &bench.scales());
        assert!(bench.hysterons(&hypothesis) > 2);
        assert_eq!(bench.memories(&hypothesis), [0, 1]);
        let anywhere = Hypothesis { freedom: Freedom::Any, ..hypothesis.clone() };
        assert_eq!(bench.memories(&anywhere).len(), bench.hysterons(&hypothesis));
        let place = |log: usize, hysteron: usize| bench.held_places(&hypothesis, log).start + hysteron;
        let (mut z, rules) = (bench.origin(&hypothesis), bench.rules(&hypothesis));
        let sigma2 = |i: usize| rules[i].sigma.min(10.0).powi(2);
        let mut covariance = DMatrix::from_fn(z.len(), z.len(), |i, j| if i == j { sigma2(i) } else { 0.0 });
        for k in 0..16 {
            covariance[(place(k / 4, 0), place(k % 4, 0))] =
                if k / 4 == k % 4 { 0.01 } else { 0.00999 } * sigma2(place(0, 0));
            covariance[(place(k / 4, 1), place(k / 4, 1))] = 1e-2 * sigma2(place(0, 1));
        }
        let (_, charged) = hypothesis.resting(&bench, &z, &covariance).expect("all rest");
        assert!((charged - 1.0 / 11.0).abs() < 2e-3, "{charged}");
        // All logs have five sigma of it, and agree to a seventh of one.
        (0..4).for_each(|log| z[place(log, 0)] = 0.5 * rules[place(log, 0)].sigma);
        let (resting, _) = hypothesis.resting(&bench, &z, &covariance).expect("the other one rests");
        assert!(resting.usually_held[0].is_none() && resting.usually_held[1].is_some());
    }

    #[test]
    fn what_hysterons_usually_hold_goes_with_their_form() {
        let model = thesis();
        let log = Log { dt_s: 5e-5, command_v: vec![0.0; 400], displacement_m: vec![0.0; 400], ..Log::default() };
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let with = |hypothesis: Hypothesis, id: &str| {
            let effect = find(id).expect("an entry");
            hypothesis.with(effect, &effect.forms()[0], &bench.scales())
        };
        let mut both = with(with(Hypothesis::nominal(Freedom::Rest), "creep"), "extra_hysteron");
        let [own, creep, extra] = [2, both.installed[0].holds.len(), both.installed[1].holds.len()];
        assert!(creep > 0 && extra > 0);
        let held = |i: usize| Some(Held { mean: i as f64, ..Held::NOTHING });
        both.usually_held = (0..own + creep + extra).map(held).collect();
        let kept = |keep: usize| -> Vec<f64> {
            let kept = both.keeping(|place, _| place == keep);
            kept.usually_held.iter().flatten().map(|held| held.mean).collect()
        };
        let numbers = |of: std::ops::Range<usize>| (0..own).chain(of).map(|i| i as f64).collect::<Vec<_>>();
        assert_eq!(kept(0), numbers(own..own + creep));
        assert_eq!(kept(1), numbers(own + creep..own + creep + extra));
        both.usually_held.clear();
        assert!(both.keeping(|_, _| true).usually_held.is_empty());
    }

    #[test]
    fn another_log_has_what_the_logs_have_in_common_and_no_more() {
        let near = |one: f64, other: f64| (one - other).abs() < 1e-12;
        let same = of(&[2.0, 2.0, 2.0]);
        assert!(near(same.expected[0], 2.0) && same.by_others.iter().all(|others| near(others[0], 2.0)));
        assert!(near(same.spread[0], 0.0));
        // By hand: the others of 1, 3 and 2 have 2.5, 1.5 and 2 in the mean, which tells 11 of their power of 12.5.
        let about = of(&[1.0, 3.0, 2.0]);
        assert!(near(about.expected[0], 2.0 * 11.0 / 12.5) && near(about.by_others[0][0], 2.5 * 11.0 / 12.5));
        assert!(near(about.spread[0], 1.0));
        // Either way, and one log alone: nothing.
        assert_eq!([of(&[-2.0, 3.0, -1.0]).expected[0], of(&[5.0]).expected[0]], [0.0; 2]);
    }

    #[test]
    fn a_log_that_does_not_tell_a_number_does_not_spoil_the_mean() {
        // Two logs tell both numbers, a third only their sum, and was led astray along what it doesn't tell.
        let [told, sum] = [[100.0, 0.0, 0.0, 100.0], [1.0; 4]].map(|of| DMatrix::from_row_slice(2, 2, &of));
        let of_logs = [[1.0, 2.0], [1.0, 2.0], [40.0, -37.0]].map(|of| DVector::from_row_slice(&of));
        let common = Common::of(&of_logs, &[told.clone(), told, sum.clone()]);
        assert!(
            (common.expected[0] - 1.0).abs() < 1e-9 && (common.expected[1] - 2.0).abs() < 1e-9,
            "{}",
            common.expected
        );
        // What one log alone tells is no more than its own.
        let one = DMatrix::from_row_slice(2, 2, &[100.0, 0.0, 0.0, 1e-6]);
        let both = DMatrix::from_row_slice(2, 2, &[100.0, 0.0, 0.0, 100.0]);
        let of_logs = [[0.1, 500.0], [-0.1, -700.0], [0.1, 5.0]].map(|of| DVector::from_row_slice(&of));
        let common = Common::of(&of_logs, &[one.clone(), one, both]);
        assert!(common.expected.norm() < 0.1, "{}", common.expected);
    }
}
