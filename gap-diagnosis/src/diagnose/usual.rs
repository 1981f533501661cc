//! What another log may be expected to have of what belongs to each: a drift that comes back, the phase of a line, how the sensor was set.

use super::bench::{Bench, factor};
use super::hypothesis::Hypothesis;
use nalgebra::{DMatrix, DVector};
use plant_sim::effects::Scope;

/// Least width of what other logs have of a number, in typical sizes.
const LEAST_WIDTH: f64 = 0.01;

impl Hypothesis {
    /// This for another log: of what belongs to each log it has what the logs of `bench` have at `z` in the mean. Where its first stretch tells it, give
    /// or take twice how these differ; where nothing does, as far as they have it in common.
    pub fn as_usual(&self, bench: &Bench<'_>, z: &[f64]) -> Self {
        let places: Vec<_> = (0..bench.records.len()).map(|index| bench.places(self, index)).collect();
        let mut usual = self.clone();
        for (at, installed) in usual.installed.iter_mut().enumerate() {
            for number in installed.of_scope(Scope::EachStart) {
                let of_logs: Vec<f64> = places.iter().map(|places| z[places[at][number]]).collect();
                let count = of_logs.len() as f64;
                let mean = of_logs.iter().sum::<f64>() / count;
                let spread2 = of_logs.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
                // One log says nothing of how they differ.
                let width = if of_logs.len() > 1 { 2.0 * spread2.sqrt() } else { mean.abs().max(1.0) };
                installed.axes[number].usual = Some([mean, width.max(LEAST_WIDTH)]);
            }
        }
        for (at, own, common) in self.in_common(bench, z) {
            for (i, &number) in own.iter().enumerate() {
                let width = (2.0 * common.spread[i]).max(LEAST_WIDTH);
                usual.installed[at].axes[number].usual = Some([common.expected[i], width]);
            }
        }
        usual
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
            let own = installed.of_scope(Scope::EachLog);
            let of_log = |(index, products): (usize, &&DMatrix<f64>)| {
                let place = |i: usize| places[index][at][own[i]] - begins[index] + shared;
                DMatrix::from_fn(own.len(), own.len(), |i, j| products[(place(i), place(j))])
            };
            installed.squares_of_own = products.iter().enumerate().map(of_log).collect();
        }
        self
    }

    /// What the logs of `bench` have in common at `z` of what belongs to each and no first stretch tells: of which form, which of its axes, and what.
    fn in_common(&self, bench: &Bench<'_>, z: &[f64]) -> Vec<(usize, Vec<usize>, Common)> {
        let places: Vec<_> = (0..bench.records.len()).map(|index| bench.places(self, index)).collect();
        let of_form = |at: usize| {
            let own = self.installed[at].of_scope(Scope::EachLog);
            let of_log = |places: &Vec<Vec<usize>>| DVector::from_fn(own.len(), |i, _| z[places[at][own[i]]]);
            let of_logs: Vec<DVector<f64>> = places.iter().map(of_log).collect();
            let common = (!own.is_empty()).then(|| Common::of(&of_logs, &self.installed[at].squares_of_own));
            common.map(|common| (at, own, common))
        };
        (0..self.installed.len()).filter_map(of_form).collect()
    }
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

    /// Of logs that tell one number each equally well.
    fn of(values: &[f64]) -> Common {
        let of_logs: Vec<DVector<f64>> = values.iter().map(|value| DVector::from_element(1, *value)).collect();
        Common::of(&of_logs, &vec![DMatrix::from_element(1, 1, 3.0); values.len()])
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
