//! The search: refit of the nominal plant, screening, full fits of what survives, alone and in pairs.

use super::bench::{Bench, Freedom, Hypothesis};
use super::descend::{Found, LAST_STAGES, STAGES, descend, noise_weights};
use super::lines::resonances;
use super::normal::reader;
use super::screen::{Lead, copy_base, screen};
use super::symmetry::symmetric;
use rayon::prelude::*;
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

impl Candidate {
    /// Fraction of the gap of `refit` that this leaves, as amplitude, where `noise` is the mean square of a fit at the noise.
    pub fn left(&self, refit: &Candidate, noise: f64) -> f64 {
        ((self.chi - noise).max(0.0) / (refit.chi - noise).max(1e-12)).sqrt()
    }

    /// Rows that were fitted.
    pub fn rows(&self) -> usize {
        self.found.normal.logs.iter().map(|log| log.rows).sum()
    }
}

/// What a candidate leaves of one log.
pub struct Remainder {
    /// Measured minus predicted, metres.
    pub residual_m: Vec<f64>,
    /// Velocity of the plant.
    pub velocity_m_per_s: Vec<f64>,
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
        let mut candidate = Candidate { hypothesis, found, chi: 0.0 };
        candidate.chi = candidate.found.normal.cost(&noise_weights(self.bench)) / candidate.rows().max(1) as f64;
        candidate
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

    /// What stays of every row of each log, and how fast the plant moved there.
    pub fn play(&self, candidate: &Candidate) -> Vec<Remainder> {
        let one = |index: usize| {
            let log = self.bench.records[index].log;
            let mut reader = reader(self.bench, &candidate.hypothesis, &candidate.found.z, index);
            let row = |y: &f64| (y - reader.next_m(), reader.motion.1);
            let (residual_m, velocity_m_per_s) = log.displacement_m.iter().map(row).unzip();
            Remainder { residual_m, velocity_m_per_s }
        };
        (0..self.bench.records.len()).into_par_iter().map(one).collect()
    }

    /// Screens the registry for what `candidate` leaves; forms whose frequency is free start where the remainder has lines and peaks.
    pub fn screen(
        &self,
        candidate: &Candidate,
        remainders: &[Remainder],
        line_hz: &[f64],
        without: &[&str],
    ) -> Vec<Lead> {
        let resonance_hz = resonances(self.bench, remainders);
        let skipped: Vec<&str> = symmetric(self.bench).iter().chain(without).copied().collect();
        let starts = [line_hz, &resonance_hz];
        screen(self.bench, &candidate.hypothesis, &candidate.found, starts, &skipped, self.simulations)
    }
}

fn total(candidate: &Candidate) -> f64 {
    candidate.found.data_cost + candidate.found.prior_cost
}
