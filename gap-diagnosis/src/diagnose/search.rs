//! The search: refit of the nominal plant, screening, full fits of what survives, alone and in pairs.

use super::bench::{Bench, Freedom, Hypothesis};
use super::descend::{Found, LAST_STAGES, STAGES, descend, noise_weights};
use super::normal::reader;
use super::screen::{Lead, copy_base};
use std::sync::atomic::AtomicUsize;

/// A hypothesis, fitted.
#[derive(Clone)]
pub struct Candidate {
    /// What was fitted.
    pub hypothesis: Hypothesis,
    /// Where it ended.
    pub found: Found,
    /// Mean square of the fitted rows in units of the noise; one at the noise.
    pub chi: f64,
}

/// A search on one bench.
pub struct Search<'a> {
    /// The bench.
    pub bench: &'a Bench<'a>,
    /// Logs simulated so far.
    pub simulations: &'a AtomicUsize,
}

impl Search<'_> {
    fn candidate(&self, hypothesis: Hypothesis, found: Found) -> Candidate {
        let rows: usize = found.normal.logs.iter().map(|log| log.rows).sum();
        let chi = found.normal.cost(&noise_weights(self.bench)) / rows.max(1) as f64;
        Candidate { hypothesis, found, chi }
    }

    fn descend(&self, hypothesis: &Hypothesis, z: Vec<f64>, stages: &[f64]) -> Candidate {
        let found = descend(self.bench, hypothesis, z, stages, self.simulations);
        self.candidate(hypothesis.clone(), found)
    }

    /// The nominal plant, refitted under its priors.
    pub fn refit(&self, freedom: Freedom) -> Candidate {
        let hypothesis = Hypothesis::nominal(freedom);
        let z = self.bench.origin(&hypothesis, &[]);
        self.descend(&hypothesis, z, &STAGES)
    }

    /// `base` with the form of `lead`, fitted from there.
    pub fn extend(&self, base: &Candidate, lead: &Lead, from_nominal: bool) -> Candidate {
        let hypothesis = base.hypothesis.with(lead.effect, lead.form, &self.bench.scales());
        let mut values = self.bench.values(&base.hypothesis, &base.found.z, 0);
        values.push(lead.values.clone());
        let mut z = self.bench.origin(&hypothesis, &values);
        copy_base(self.bench, &base.hypothesis, &hypothesis, &base.found.z, &mut z);
        if from_nominal {
            z[..self.bench.free.len()].fill(0.0);
            self.descend(&hypothesis, z, &STAGES[1..])
        } else {
            self.descend(&hypothesis, z, &LAST_STAGES)
        }
    }

    /// The candidate again, its nominal numbers put back at nominal; the better of both.
    pub fn polish(&self, candidate: Candidate) -> Candidate {
        let mut z = candidate.found.z.clone();
        z[..self.bench.free.len()].fill(0.0);
        let again = self.descend(&candidate.hypothesis, z, &STAGES);
        if total(&again) < total(&candidate) { again } else { candidate }
    }

    /// Measured minus predicted of every row of each log.
    pub fn residuals_m(&self, candidate: &Candidate) -> Vec<Vec<f64>> {
        let one = |index: usize| {
            let log = self.bench.records[index].log;
            let mut reader = reader(self.bench, &candidate.hypothesis, &candidate.found.z, index);
            log.displacement_m.iter().map(|y| y - reader.next_m()).collect()
        };
        (0..self.bench.records.len()).map(one).collect()
    }
}

fn total(candidate: &Candidate) -> f64 {
    candidate.found.data_cost + candidate.found.prior_cost
}
