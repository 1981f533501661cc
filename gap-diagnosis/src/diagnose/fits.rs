//! The order of full fits: what the screening left alone, then in pairs where one effect leaves too much.

use super::bench::Bench;
use super::directions::{FREED_BESIDES, NEARLY_ALL};
use super::judge::{RESOLVED, Say};
use super::refit::{AT_NOISE, BENT_COST, come_home, nominal};
use super::screen::{Lead, Starts};
use super::search::{Candidate, Remainder, Search, after_run_in};
use super::symmetry::along;
use plant_sim::effects::{Effect, Form, Kind, Parameter, REGISTRY, Scope, find, find_form};
use std::f64::consts::TAU;

/// A lead is followed if it explains this share of what the best one does, or is among the first few.
const LEAST_SHARE: f64 = 0.3;
const FIRST: usize = 3;
/// Share below which not even the best lead says anything.
pub(super) const HOPELESS: f64 = 0.1;
/// Once a fit leaves less than this, only leads are followed that explain as much as its own.
pub(super) const FOUND: f64 = 0.03;
const AS_MUCH: f64 = 0.85;
/// One that soon leaves so many times the squares is no rival of it then; of a fit that leaves more, so many times.
const NO_RIVAL: f64 = 2.0;
const FAR_BEHIND: f64 = 6.0;
const MOST_FITS: usize = 5;
/// So many effects at most may hide in the numbers of a refit, and the share of what the stated ones leave that counts as noise then.
const HIDDEN: usize = 8;
const AS_NOISE: f64 = 0.5;
/// Lags look alike to a score test: if one scores, all are fitted.
const LAGS: [&str; 4] = ["transport_delay", "amplifier_bandwidth", "sensor_bandwidth", "amplifier_slew"];
/// Damping ratio that a lag of second order is tried with: flat to its corner.
const DAMPING: f64 = 0.7;
/// An entry whose fit leaves more than this is tried in its other forms as well.
const WELL: f64 = 0.01;
/// .. if the screening promised this share of the same from them; so many at most.
const AS_PROMISING: f64 = 0.6;
const MOST_OTHERS: usize = 3;
/// .. but not where the first of them promised less than this: no form of it comes to the noise.
const LITTLE: f64 = 0.5;
/// Another form is given up where it soon leaves so many times the squares of the best so far.
const NOT_BETTER: f64 = 1.5;
/// A form of fewer numbers goes first if it promised this share of the best one's gain: the score hardly tells such forms apart.
const NO_LESS: f64 = 0.98;
/// So many more numbers a form may have that is tried beside one at the noise.
const FEW_MORE: usize = 2;
/// A fit that takes less than this share of what the screening promised to take of the gap is tried from elsewhere, ..
const MUCH_LESS: f64 = 0.5;
/// .. where that was at least so much of the gap's power.
const PROMISING: f64 = 0.3;
/// Beside a single explanation that leaves less than this a second effect has to leave nothing.
pub(super) const PAIR_BEYOND: f64 = 0.08;
/// A single explanation that leaves more than this, in units of the noise's power, invites a second effect: less is a matter of its form.
const NEAR_NOISE: f64 = 1.12;
/// .. and so do so many of the next best, if they leave less than this many times as much: the best may have many numbers, and imitate two effects.
const FIRSTS: usize = 2;
const AS_GOOD: f64 = 1.5;
/// A fit that leaves more than this takes less than half of the gap.
const HALF: f64 = 0.5;
/// No second effect stands beside a fit that leaves this much: the stronger of two takes half of the power, which leaves 0.71 of the gap.
const HARDLY_HALF: f64 = 0.75;
/// The second must promise this share of the power that was left, and then take this much of what was left, as amplitude.
const SECOND_SHARE: f64 = 0.4;
const PAIR_TAKES: f64 = 0.5;
/// .. or this much, before either is tried in its other forms.
const PAIR_NEARLY_TAKES: f64 = 0.3;
/// Forms of so few numbers are plain; so many of them are tried, if they promise this share of what the best lead does.
const PLAIN: usize = 2;
const MOST_PLAIN: usize = 1;
const PLAIN_SHARE: f64 = 0.5;
/// So many pairs at most are tried in their other forms.
const MOST_CHANGED: usize = 2;
/// Single fits that leave less than this many times as much as the first may stand in its place beside the second; so many at most.
const TWIN: f64 = 1.1;
const MOST_TWINS: usize = 2;
/// One effect fits as well as two if the mean square is no more than this many times theirs.
pub(super) const AS_WELL: f64 = 1.01;
/// Shows in the first tenth of the logs.
const START: &str = "initial_state";
/// Tried whatever its score.
const OFFSET: &str = "sensor_offset";
/// Share of the residual's power in the first tenth of the logs that suggests their start.
const START_SHARE: f64 = 0.4;

/// Full fits on top of a refit.
pub(super) struct Fits<'a> {
    /// The search.
    pub search: &'a Search<'a>,
    /// The refitted nominal plant.
    pub refit: &'a Candidate,
    /// Entries that are struck out.
    pub without: &'a [&'a str],
    /// Where progress goes.
    pub say: Say<'a>,
}

/// What the rivals of a fit must promise, as gain, and what they may cost soon.
struct Bar {
    least_gain: f64,
    most_cost: f64,
}

impl Fits<'_> {
    /// Fits of what the screening left, alone and in pairs; best first, pairs last.
    pub fn all(&self, leads: &[Lead], remainders: &[Remainder]) -> Vec<Candidate> {
        let mut fits = self.singles(leads, remainders);
        // What no direction of the registry imitates at all is not the sum of two of them either, but for starts, which have no direction.
        let is_start = |fit: &Candidate| fit.hypothesis.ids() == [START] && self.left(fit) < HALF;
        if leads.first().is_none_or(|lead| lead.share < HOPELESS) && !fits.first().is_some_and(is_start) {
            return fits;
        }
        if let Some(best) = fits.first().filter(|best| best.chi > NEAR_NOISE) {
            // Where the first leaves little, its form may be what is wrong: only a second that leaves nothing is one, or that brings numbers home which the
            // first has bent.
            let is_little = self.left(best) < PAIR_BEYOND;
            let bent = best.found.prior_cost;
            let pairs = self.pairs(&fits, leads);
            let is_home = |pair: &Candidate| pair.found.prior_cost < (bent - FREED_BESIDES).min(0.5 * bent);
            fits.extend(pairs.into_iter().filter(|pair| !is_little || pair.chi < AT_NOISE || is_home(pair)));
        }
        fits
    }

    /// The refit with what scatter of `effect` does in the mean, if the registry has a form for it.
    pub fn mean_of(&self, effect: &'static dyn Effect) -> Option<Candidate> {
        let form = effect.forms().iter().find(|form| form.kind == Kind::Mean)?;
        let nothing = Lead { effect, form, values: vec![0.0], gain: 0.0, share: 0.0 };
        Some(self.search.extend_below(self.refit, &nothing, false, f64::INFINITY))
    }

    /// Fits of the first few leads on top of `base`, however little they promise.
    pub fn of_little(&self, base: &Candidate) -> Vec<Candidate> {
        (self.say)("looking for what is small", 0.66);
        let starts = Starts::of(self.search.bench, &self.search.play(base));
        let leads = self.search.screen(base, &starts, self.without);
        let first = distinct(&leads).into_iter().take(FIRST).map(|lead| self.simplest(lead, &leads));
        first.map(|lead| self.search.extend_below(base, lead, false, f64::INFINITY)).collect()
    }

    /// Fits of what hides in the numbers of a refit: where half of what the numbers as they are stated leave counts as noise, their priors
    /// may hold them, and what has bent them shows.
    pub fn hidden_in_numbers(&self) -> Vec<Candidate> {
        (self.say)("looking for what the numbers hide", 0.66);
        let times = AS_NOISE * self.search.unfitted(&self.refit.hypothesis).sqrt();
        // What is no larger than the noise has bent no number far.
        if times.is_nan() || times < 1.0 {
            return Vec::new();
        }
        let bench = self.search.bench.noisier(times);
        let held = Search { bench: &bench, ..*self.search };
        let refit = held.refit(self.refit.hypothesis.freedom);
        let leads = held.screen(&refit, &Starts::of(&bench, &held.play(&refit)), self.without);
        let worth = distinct(&leads).into_iter().filter(|lead| lead.gain > RESOLVED).take(HIDDEN);
        let fits = worth.map(|lead| held.extend_below(&refit, self.simplest(lead, &leads), true, f64::INFINITY));
        let is_ordinary = |fit: &Candidate| fit.found.prior_cost < BENT_COST;
        fits.filter(is_ordinary).map(|fit| self.search.taken_on(&fit)).collect()
    }

    fn left(&self, candidate: &Candidate) -> f64 {
        candidate.left(self.refit, 1.0)
    }

    /// A second effect beside each of the two best, and beside a plain one.
    fn pairs(&self, singles: &[Candidate], leads: &[Lead]) -> Vec<Candidate> {
        let mut pairs = Vec::new();
        let is_as_good = |fit: &Candidate| self.left(fit) < (AS_GOOD * self.left(&singles[0])).min(HARDLY_HALF);
        let best: Vec<Candidate> = singles.iter().take(FIRSTS).filter(|fit| is_as_good(fit)).cloned().collect();
        // One by one: the first pair that is found ends the search.
        let plain = self.plain(leads, &best).into_iter().map(|lead| self.fit_of(lead, f64::INFINITY));
        for (number, first) in best.into_iter().chain(plain.filter(|fit| self.left(fit) < HARDLY_HALF)).enumerate() {
            (self.say)("looking for a second effect", 0.6 + 0.07 * number as f64);
            let beside = self.beside(&first, singles, leads);
            // What each log has of its own imitates much, another effect beside it the rest.
            let is_own =
                |pair: &Candidate| pair.hypothesis.installed.iter().any(|i| !i.of_scope(Scope::EachLog).is_empty());
            let is_found = beside.first().is_some_and(|pair| self.is_found(pair) && !is_own(pair));
            // Either effect of a pair may have been the first.
            beside.into_iter().for_each(|pair| keep_better(&mut pairs, pair));
            if is_found {
                break;
            }
        }
        pairs
    }

    /// Leads of few numbers, but for those that `known` fits have: a form of many imitates two effects at once, and nothing shows beside it.
    fn plain<'l>(&self, leads: &'l [Lead], known: &[Candidate]) -> Vec<&'l Lead> {
        let most = leads.first().map_or(0.0, |lead| lead.gain);
        let is_known = |lead: &Lead| {
            let mut installed = known.iter().filter_map(|fit| fit.hypothesis.installed.last());
            installed.any(|own| (own.effect.id(), own.form.name) == (lead.effect.id(), lead.form.name))
        };
        let worth = leads.iter().filter(|lead| lead.gain > PLAIN_SHARE * most && self.numbers(lead.form) <= PLAIN);
        distinct(worth).into_iter().filter(|lead| !is_known(lead)).take(MOST_PLAIN).collect()
    }

    /// Pairs of `first` with what shows beside it, the best first; if it is found, what it may be taken for follows.
    fn beside(&self, first: &Candidate, singles: &[Candidate], leads: &[Lead]) -> Vec<Candidate> {
        let remainders = self.search.play(first);
        let seconds = self.search.screen(first, &Starts::of(self.search.bench, &remainders), self.without);
        let taken = |pair: &Candidate| 1.0 - pair.left(first, 1.0);
        let start = self.start(first, &remainders);
        let promising: Vec<&Lead> =
            distinct(&seconds).into_iter().take(3).filter(|lead| lead.share > SECOND_SHARE).collect();
        let known = first.hypothesis.ids().into_iter().chain(promising.iter().map(|lead| lead.effect.id()));
        let offset = if known.into_iter().any(|id| id == OFFSET) { None } else { offset(&seconds) };
        let mut pairs: Vec<(Candidate, &Lead)> = Vec::new();
        for lead in start.iter().chain(promising).chain(&offset) {
            let mut pair = self.search.extend(first, lead, false);
            // Numbers that the first effect has bent alone hold the second back.
            if !self.is_found(&pair) && taken(&pair) < PAIR_TAKES && first.found.prior_cost > FREED_BESIDES {
                pair = better(pair, self.search.extend(first, lead, true));
            }
            pairs.push((pair, lead));
            if pairs.last().is_some_and(|(pair, _)| pair.chi < AT_NOISE) {
                break;
            }
        }
        let by_chi = |a: &(Candidate, &Lead), b: &(Candidate, &Lead)| a.0.chi.total_cmp(&b.0.chi);
        // Numbers that the first effect has bent alone may hold both in a local minimum.
        let is_held = |pair: &Candidate| pair.chi > AT_NOISE && pair.found.prior_cost > FREED_BESIDES;
        pairs.sort_by(by_chi);
        let near = pairs.iter_mut().map(|(pair, _)| pair).take(MOST_CHANGED);
        for near in near.filter(|pair| is_held(pair) && taken(pair) > PAIR_NEARLY_TAKES) {
            *near = self.search.polish(near.clone());
        }
        pairs.sort_by(by_chi);
        let near = pairs.iter_mut().map(|(pair, _)| pair).take(MOST_CHANGED);
        for near in near.take_while(|pair| !self.is_found(pair) && taken(pair) > PAIR_NEARLY_TAKES) {
            *near = self.search.led_by_others(near.clone());
            self.change_forms(near, leads, &seconds);
            if !self.is_found(near) {
                let richer = self.with_richer_kin(near);
                *near = richer.into_iter().fold(near.clone(), better);
            }
        }
        pairs.sort_by(by_chi);
        let mut twins = Vec::new();
        if let Some((best, lead)) = pairs.first_mut().filter(|(best, _)| self.is_found(best)) {
            twins = self.twins(best, singles, first, [leads, &seconds], lead);
            *best = self.sparest(self.least(best.clone()), leads);
        }
        let worth =
            pairs.into_iter().map(|(pair, _)| pair).filter(|pair| self.is_found(pair) || taken(pair) > PAIR_TAKES);
        worth.chain(twins).collect()
    }

    /// Whether nothing to speak of stays: next to nothing of the gap, or little of it and no more than the noise is known to.
    fn is_all(&self, fit: &Candidate) -> bool {
        let left = self.left(fit);
        left < FOUND || left < NEARLY_ALL && fit.chi < AT_NOISE
    }

    fn is_found(&self, fit: &Candidate) -> bool {
        self.left(fit) < FOUND || fit.chi < AT_NOISE
    }

    /// Either effect of a pair in its other forms: the first was chosen while it stood for both.
    fn change_forms(&self, pair: &mut Candidate, firsts: &[Lead], seconds: &[Lead]) {
        for (place, leads) in [seconds, firsts].into_iter().enumerate() {
            let Some(own) = pair.hypothesis.installed.iter().rev().nth(place).map(|i| (i.effect.id(), i.form.name))
            else {
                continue;
            };
            let most = leads.iter().find(|lead| lead.effect.id() == own.0).map_or(0.0, |lead| lead.gain);
            let mut best = pair.clone();
            let own_lead = in_form(leads, own);
            let plainest = own_lead.and_then(|lead| self.plainest(lead, leads));
            for other in and(self.others(own, leads, most), plainest) {
                if self.is_found(&best) {
                    break;
                }
                if let Some(changed) = self.search.in_form(pair, other.effect, other.form, &other.values) {
                    best = better(best, changed);
                }
            }
            *pair = best;
        }
    }

    /// What a found `pair`, `first` with the effect of `lead`, may be taken for: either of them with what was as good as the other, from where the
    /// pair ended, as its forms need not be those that it began with.
    fn twins(
        &self,
        pair: &Candidate,
        singles: &[Candidate],
        first: &Candidate,
        [leads, seconds]: [&[Lead]; 2],
        lead: &Lead,
    ) -> Vec<Candidate> {
        let is_new = |id: &str| !pair.hypothesis.ids().contains(&id);
        let firsts = singles.iter().filter(|other| {
            other.hypothesis.ids().into_iter().all(is_new) && self.left(other) < TWIN * self.left(first)
        });
        let of_first = first.hypothesis.ids();
        let instead_of_first = |other: &Candidate| self.search.in_valley_of(pair, of_first.first()?, other);
        let mut twins: Vec<Candidate> = firsts.take(MOST_TWINS).filter_map(instead_of_first).collect();
        // Alone no other lag may have been as good as the first; beside what it left over any may be.
        if let Some(id) = of_first.first().filter(|id| LAGS.contains(id)) {
            let is_tried = |id: &str| twins.iter().any(|twin| twin.hypothesis.ids().contains(&id));
            let lags = distinct(leads).into_iter().filter(|other| is_lag(other) && is_new(other.effect.id()));
            let lags: Vec<&Lead> = lags.filter(|other| !is_tried(other.effect.id())).collect();
            let instead = |lag: &Lead| self.search.instead(pair, id, (lag.effect, lag.form), &lag.values);
            twins.extend(lags.into_iter().filter_map(instead));
        }
        let is_as_good = |other: &&Lead| {
            is_new(other.effect.id()) && (other.gain > AS_MUCH * lead.gain || is_lag(lead) && is_lag(other))
        };
        let instead_of_lead =
            |other: &Lead| self.search.instead(pair, lead.effect.id(), (other.effect, other.form), &other.values);
        twins.extend(distinct(seconds).into_iter().filter(is_as_good).take(MOST_TWINS).filter_map(instead_of_lead));
        twins
    }

    /// One of a pair's effects, if that alone fits as well: the other only led it out of a local minimum.
    fn least(&self, pair: Candidate) -> Candidate {
        let mut alone = (0..pair.hypothesis.installed.len()).map(|kept| self.search.only(&pair, kept));
        alone.find(|alone| alone.chi < AS_WELL * pair.chi).unwrap_or(pair)
    }

    fn singles(&self, leads: &[Lead], remainders: &[Remainder]) -> Vec<Candidate> {
        let start = self.start(self.refit, remainders);
        let chosen = chosen(leads);
        let offset = offset(leads).filter(|_| chosen.iter().all(|lead| lead.effect.id() != OFFSET));
        let mut all: Vec<&Lead> = start.iter().chain(&offset).chain(chosen).collect();
        all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut fits: Vec<Candidate> = Vec::new();
        // What the best fit so far asks of the others.
        let mut bar = Bar { least_gain: 0.0, most_cost: f64::INFINITY };
        let mut is_all = false;
        for (number, lead) in all.iter().enumerate() {
            // What a lag's own numbers do to a score is not what they do to a fit: no lag is left out beside another.
            let is_beside_lag = is_lag(lead) && all[..number].iter().any(|before| is_lag(before));
            if lead.gain < bar.least_gain && !is_beside_lag {
                continue;
            }
            (self.say)(&format!("fitting {}", lead.effect.id()), 0.2 + 0.4 * number as f64 / all.len() as f64);
            let fit = self.best_form(lead, leads, &bar);
            if !is_all && self.is_all(&fit) {
                is_all = true;
                bar = Bar { least_gain: AS_MUCH * lead.gain, most_cost: NO_RIVAL * fit.found.data_cost };
            } else if !is_all {
                bar.most_cost = bar.most_cost.min(FAR_BEHIND * fit.found.data_cost);
            }
            fits.push(fit);
        }
        fits = fits.into_iter().map(|fit| self.search.led_by_others(fit)).collect();
        // The finalists once more from the nominal numbers: a fit a little above the noise is usually a local minimum, and so is one that
        // bends the nominal numbers as if they were wrong besides. Then from where a payload or a gain would have put them.
        fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
        let finalists = if fits.first().is_some_and(|fit| self.left(fit) < FOUND) { 1 } else { 2 };
        let least = fits.first().map_or(0.0, |fit| self.left(fit));
        for fit in fits.iter_mut().take(finalists).take_while(|fit| self.left(fit) <= AS_GOOD * least) {
            let is_above = (WELL..0.5).contains(&self.left(fit)) && fit.chi > AT_NOISE;
            let is_bent = self.left(fit) < FOUND && fit.found.prior_cost > FREED_BESIDES;
            if is_above || is_bent {
                (self.say)("polishing", 0.6);
                *fit = self.search.polish(fit.clone());
                let numbers = along(self.search.bench, &self.refit.found);
                if let Some(numbers) = numbers.filter(|_| self.left(fit) > WELL) {
                    *fit = self.search.polish_from(fit.clone(), &numbers);
                }
                if fit.chi < AT_NOISE && fit.found.prior_cost > FREED_BESIDES {
                    *fit = come_home(self.search, fit.clone(), &nominal(self.search));
                }
            }
        }
        fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
        self.lags_as_long(&mut fits);
        // Where a start is off, numbers in the place of another's take for themselves what the start did.
        if start.is_none() {
            self.richer_kin(&mut fits);
        }
        self.kin(&mut fits);
        self.gap_of_bend(&mut fits);
        let fits = self.rivals(fits, leads);
        let at_noise = |fit: Candidate| self.sparest(self.shared(fit), leads);
        let mut fits: Vec<Candidate> =
            fits.into_iter().map(|fit| if fit.chi < AT_NOISE { at_noise(fit) } else { fit }).collect();
        if let Some(best) = fits.first_mut().filter(|best| self.left(best) < HALF)
            && let Some(sparer) = self.sparer(best)
        {
            *best = sparer;
        }
        fits
    }

    /// A fit in a form of its last effect with fewer numbers, screened where the fit's numbers and starts are, if it fits as well: beside those that a
    /// refit has bent a form of many numbers promises more, and may end where one of few would not.
    fn sparer(&self, fit: &Candidate) -> Option<Candidate> {
        let installed = fit.hypothesis.installed.last()?;
        let (effect, own) = (installed.effect, self.numbers(installed.form));
        let is_sparer = |form: &Form| form.kind == Kind::Predictable && self.numbers(form) < own;
        effect.forms().iter().find(|form| is_sparer(form))?;
        let base = self.search.stripped(fit);
        let starts = Starts::of(self.search.bench, &self.search.play(&base));
        let others: Vec<&str> = REGISTRY.iter().map(|other| other.id()).filter(|id| *id != effect.id()).collect();
        let leads = self.search.screen(&base, &starts, &others);
        let promised = leads.first()?.gain;
        let sparer = leads.iter().filter(|lead| is_sparer(lead.form) && lead.gain > AS_PROMISING * promised);
        let to_beat = NOT_BETTER * fit.found.data_cost;
        self.sparest_of(sparer, fit, |lead| Some(self.search.extend_below(&base, lead, false, to_beat)))
    }

    /// What `seek` makes of the one of `sparer` with the fewest numbers that fits as well as `fit`; so many are tried.
    fn sparest_of<'l>(
        &self,
        sparer: impl Iterator<Item = &'l Lead>,
        fit: &Candidate,
        seek: impl Fn(&Lead) -> Option<Candidate>,
    ) -> Option<Candidate> {
        let mut sparer: Vec<&Lead> = sparer.collect();
        sparer.sort_by_key(|lead| self.numbers(lead.form));
        let mut sought = sparer.into_iter().take(MOST_OTHERS).filter_map(seek);
        sought.find(|sparer| sparer.chi < AS_WELL * fit.chi)
    }

    /// The fit that leaves least, if it has taken most of the gap, and the numbers of its last effect.
    fn best_with_numbers(&self, fits: &[Candidate]) -> Option<(Candidate, Vec<f64>)> {
        let best = fits.first().filter(|best| self.left(best) < HALF)?;
        Some((best.clone(), self.search.bench.means(&best.hypothesis, &best.found.z).pop()?))
    }

    /// Over a joint's gap readings stay, over a sensor's bend they rise less, and a bend has a least width, so that it takes a narrow gap for one: where a bend is
    /// the best fit, the gap of its height is fitted from there.
    fn gap_of_bend(&self, fits: &mut Vec<Candidate>) {
        let Some((best, values)) = self.best_with_numbers(fits) else { return };
        let Some(own) = best.hypothesis.installed.last() else { return };
        let gap = find_form("backlash", "gap").filter(|(backlash, _)| !self.without.contains(&backlash.id()));
        let (Some(gap), "another-slope", &[height_m, at_m, _]) = (gap, own.form.name, &values[..]) else {
            return;
        };
        if height_m < 0.0 {
            let fit = self.search.instead(&best, own.effect.id(), gap, &[-2.0 * height_m, at_m]);
            fit.into_iter().for_each(|fit| keep_better(fits, fit));
            fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
        }
    }

    /// A lag may be another one, or of another order: beside numbers that a refit has bent the screening says little of either. Plain lags are fitted
    /// from where the best one ended, as long as that is, but those that leave as little already.
    fn lags_as_long(&self, fits: &mut Vec<Candidate>) {
        let Some((best, values)) = self.best_with_numbers(fits) else { return };
        let Some(own) = best.hypothesis.installed.last() else { return };
        let bench = self.search.bench;
        let of = |name: &str| own.axes.iter().position(|axis| axis.parameter.name == name).map(|at| values[at]);
        let of_second_order = || Some(2.0 * of("damping_ratio")? / (TAU * of("natural_hz")?));
        let length_s = of("delay_s").or_else(|| of("time_constant_s")).or_else(of_second_order);
        let Some(length_s) = length_s.filter(|_| LAGS.contains(&own.effect.id())) else { return };
        let begins = |parameter: &Parameter| {
            let value = match parameter.name {
                "delay_s" | "time_constant_s" => length_s,
                "natural_hz" => 2.0 * DAMPING / (TAU * length_s),
                "damping_ratio" => DAMPING,
                _ => return None,
            };
            Some(value.clamp(parameter.bounds[0], parameter.bounds[1]))
        };
        let is_as_good = |fit: &Candidate| (fit.chi - best.chi) * (best.rows() as f64) < RESOLVED;
        let is_done = |id: &str| match fits.iter().find(|fit| fit.hypothesis.ids() == [id]) {
            _ if self.without.contains(&id) => true,
            Some(fit) => is_as_good(fit) && (id != own.effect.id() || fit.chi < AT_NOISE),
            None => false,
        };
        let effects: Vec<&dyn Effect> = LAGS.iter().filter(|id| !is_done(id)).filter_map(|id| find(id)).collect();
        let forms = effects.into_iter().flat_map(|effect| effect.forms().iter().map(move |form| (effect, form)));
        let is_other = |(effect, form): &(&dyn Effect, &Form)| {
            form.kind == Kind::Predictable && (effect.id(), form.name) != (own.effect.id(), own.form.name)
        };
        for (effect, form) in forms.filter(is_other) {
            let values: Option<Vec<f64>> = (form.parameters)(&bench.scales()).iter().map(begins).collect();
            let fit = values.and_then(|values| self.search.instead(&best, own.effect.id(), (effect, form), &values));
            fit.into_iter().for_each(|fit| keep_better(fits, fit));
        }
        fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
    }

    /// What the best fit leaves above the noise may be what a rival's form has besides.
    fn richer_kin(&self, fits: &mut Vec<Candidate>) {
        let Some(best) = fits.first().filter(|best| self.left(best) < HALF && best.chi > AT_NOISE) else { return };
        let Some(richer) = self.with_richer_kin(best) else { return };
        keep_better(fits, richer);
        fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
    }

    /// `fit` with a rival in the place of one of its effects, in a form that has the same numbers and others, fitted from there, whatever the screening
    /// promised of it; none unless that takes much of what stays.
    fn with_richer_kin(&self, fit: &Candidate) -> Option<Candidate> {
        let rivals = fit.hypothesis.installed.iter().enumerate().flat_map(|(place, installed)| {
            let rivals = installed.effect.about().rivals.iter().filter_map(|id| find(id));
            rivals.map(move |effect| (place, effect))
        });
        let ids = fit.hypothesis.ids();
        let is_new = |effect: &str| !self.without.contains(&effect) && !ids.contains(&effect);
        let forms = rivals.filter(|(_, effect)| is_new(effect.id())).flat_map(|(place, effect)| {
            let forms = effect.forms().iter().filter(|form| form.kind == Kind::Predictable);
            forms.map(move |form| (place, (effect, form)))
        });
        let richer = forms.filter_map(|(place, form)| self.search.in_richer_kin(fit, place, form, FEW_MORE));
        richer.reduce(better).filter(|richer| 1.0 - richer.left(fit, 1.0) > PAIR_TAKES)
    }

    /// A rival must not hang on where its own search began: plants forget nothing, so that one log may be locked in another valley. Rivals of the
    /// best are fitted from where that ended as well, with the numbers of their own, or, where the best is at the noise, with a form of the same
    /// numbers, as a mass on a mount and a mode that is attached have.
    fn kin(&self, fits: &mut Vec<Candidate>) {
        let Some(first) = fits.first().filter(|first| self.left(first) < PAIR_BEYOND) else { return };
        // Of several at the noise the best is not the one that bends numbers most: it leaves a hair less.
        let cost = |fit: &&Candidate| fit.found.data_cost + fit.found.prior_cost;
        let at_noise = fits.iter().filter(|fit| fit.chi < AT_NOISE);
        let best = at_noise.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or(first).clone();
        let Some(own) = best.hypothesis.installed.last() else { return };
        let is_at_noise = best.chi < AT_NOISE;
        // Numbers that are bent much more than the best one's are where a search happened to end as well.
        let is_bent = |fit: &Candidate| fit.found.prior_cost > best.found.prior_cost + FREED_BESIDES;
        for effect in own.effect.about().rivals.iter().filter_map(|id| find(id)) {
            let is_as_good = |fit: &Candidate| (fit.chi - best.chi) * (best.rows() as f64) < RESOLVED;
            let known = fits.iter().position(|fit| fit.hypothesis.ids() == [effect.id()]);
            let is_known = known.is_some_and(|known| is_as_good(&fits[known]) && !is_bent(&fits[known]));
            if self.without.contains(&effect.id()) || is_known {
                continue;
            }
            let forms = effect.forms().iter().filter(|form| is_at_noise && form.kind == Kind::Predictable);
            let kin = forms.filter_map(|form| self.search.in_kin(&best, effect, form));
            let moved = known.and_then(|known| self.search.in_valley_of(&best, own.effect.id(), &fits[known]));
            let Some(nearest) = kin.chain(moved).min_by(|a, b| a.chi.total_cmp(&b.chi)) else { continue };
            match known {
                Some(known) if is_bent(&fits[known]) && nearest.chi < AT_NOISE || nearest.chi < fits[known].chi => {
                    fits[known] = nearest;
                }
                None if nearest.chi < AT_NOISE => fits.push(nearest),
                _ => {}
            }
        }
        fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
    }

    /// A fit whose numbers belong to each log with one for all logs, if that fits as well: only such a number says anything of another log.
    fn shared(&self, fit: Candidate) -> Candidate {
        let bench = self.search.bench;
        let Some(installed) = fit.hypothesis.installed.last() else { return fit };
        let scales = bench.scales();
        let own = (installed.form.parameters)(&scales);
        if own.is_empty() || own.iter().any(|parameter| !parameter.is_of_each_log()) {
            return fit;
        }
        let is_same = |form: &&Form| {
            let parameters = (form.parameters)(&scales);
            parameters.len() == own.len()
                && parameters.iter().zip(&own).all(|(shared, own)| shared.name == own.name && !shared.is_of_each_log())
        };
        let Some(form) = installed.effect.forms().iter().find(is_same) else { return fit };
        let Some(means) = bench.means(&fit.hypothesis, &fit.found.z).pop() else { return fit };
        let shared = self.search.in_form(&fit, installed.effect, form, &means);
        shared.filter(|shared| shared.chi < AS_WELL * fit.chi).unwrap_or(fit)
    }

    /// A fit in the form of its effect with the fewest numbers that fits as well from there: what nothing needs goes astray on another log.
    fn sparest(&self, fit: Candidate, leads: &[Lead]) -> Candidate {
        let Some(installed) = fit.hypothesis.installed.last() else { return fit };
        let own = in_form(leads, (installed.effect.id(), installed.form.name));
        let Some(numbers) = own.map(|lead| self.numbers(lead.form)) else { return fit };
        let is_sparer = |lead: &&Lead| {
            lead.effect.id() == installed.effect.id() && self.numbers(lead.form) < numbers && lead.share > HOPELESS
        };
        let in_form = |lead: &Lead| self.search.in_form(&fit, lead.effect, lead.form, &lead.values);
        self.sparest_of(leads.iter().filter(is_sparer), &fit, in_form).unwrap_or(fit)
    }

    /// The state at the start as a lead, if much of what `fit` leaves lies there: no direction shows how much of it a start explains.
    fn start(&self, fit: &Candidate, remainders: &[Remainder]) -> Option<Lead> {
        let share = early_share(self.search.bench, remainders);
        let effect = find(START).filter(|effect| !self.without.contains(&effect.id()) && share > START_SHARE)?;
        let form = effect.forms().iter().find(|form| form.kind == Kind::Start)?;
        if fit.hypothesis.ids().contains(&START) {
            return None;
        }
        let excess = (fit.chi - 1.0) * fit.rows() as f64;
        Some(Lead { effect, form, values: Vec::new(), gain: share * excess, share })
    }

    /// A wrong form leaves something; the entry's other forms are tried where they promised as much, and no less than the best fit so far asks
    /// for.
    fn best_form(&self, lead: &Lead, leads: &[Lead], bar: &Bar) -> Candidate {
        let (least, most) = (bar.least_gain, bar.most_cost);
        let lead = self.simplest(lead, leads);
        let mut fit = self.fit_of(lead, most);
        let first = fit.clone();
        let promising = self
            .others((lead.effect.id(), lead.form.name), leads, lead.gain)
            .filter(|other| other.gain > least && lead.share >= LITTLE);
        for other in and(promising, self.plainest(lead, leads)) {
            if self.left(&fit) < WELL || fit.chi < AT_NOISE {
                break;
            }
            let to_beat = NOT_BETTER * fit.found.data_cost;
            let next = self.fit_of(other, most.min(to_beat));
            // A form that is a part of another cannot leave less, but where the other was led astray.
            let (part, whole) = if next.chi < first.chi { (&next, lead) } else { (&first, other) };
            let again = self.search.in_richer(part, whole);
            fit = again.into_iter().chain([next]).fold(fit, better);
        }
        fit
    }

    /// The form of `lead`'s effect with the fewest numbers of those that promise as much.
    fn simplest<'l>(&self, lead: &'l Lead, leads: &'l [Lead]) -> &'l Lead {
        let same = leads.iter().filter(|l| l.effect.id() == lead.effect.id() && l.gain > NO_LESS * lead.gain);
        same.min_by_key(|lead| self.numbers(lead.form)).unwrap_or(lead)
    }

    /// The form of `lead`'s effect with the fewest numbers of all, if it promised anything and is another: where the refit has bent the plant's
    /// numbers, a form of many imitates what bent them, and the plain one shows from the nominal numbers only.
    fn plainest<'l>(&self, lead: &Lead, leads: &'l [Lead]) -> Option<&'l Lead> {
        let same = leads.iter().filter(|l| l.effect.id() == lead.effect.id());
        let plainest = same.min_by_key(|lead| self.numbers(lead.form))?;
        (plainest.share > HOPELESS && self.numbers(plainest.form) < self.numbers(lead.form)).then_some(plainest)
    }

    /// Leads of the effect in other forms than its `own` that promise as much as the `gain` of that: the few best forms, the best of each kin, and
    /// those that no score tells from the best. Forms whose numbers are mostly the same are kin: where one is wrong the others may be, and go last.
    fn others<'l>(
        &self,
        (id, own): (&'l str, &'l str),
        leads: &'l [Lead],
        gain: f64,
    ) -> impl Iterator<Item = &'l Lead> {
        let scales = self.search.bench.scales();
        let names = |form: &Form| (form.parameters)(&scales).iter().map(|p| p.name).collect::<Vec<_>>();
        let (own, same): (Vec<&Lead>, Vec<&Lead>) =
            leads.iter().filter(|lead| lead.effect.id() == id).partition(|lead| lead.form.name == own);
        let mut kins: Vec<Vec<&str>> = own.iter().map(|lead| names(lead.form)).collect();
        let (mut firsts, mut kin) = (Vec::new(), Vec::new());
        for (rank, lead) in same.into_iter().enumerate() {
            let names = names(lead.form);
            let shared = |kin: &Vec<&str>| names.iter().filter(|name| kin.contains(name)).count();
            let is_first = !kins.iter().any(|kin| 2 * shared(kin) > names.len().max(kin.len()));
            let is_early = rank < MOST_OTHERS || is_first && kins.len() <= MOST_OTHERS;
            let is_worth = lead.gain > if is_early { AS_PROMISING } else { NO_LESS } * gain;
            if is_worth {
                if is_first { &mut firsts } else { &mut kin }.push(lead);
            }
            if is_first {
                kins.push(names);
            }
        }
        firsts.into_iter().chain(kin)
    }

    /// How many numbers a form has; what belongs to each log counts for each.
    fn numbers(&self, form: &Form) -> usize {
        let logs = self.search.bench.records.len();
        let parameters = (form.parameters)(&self.search.bench.scales());
        parameters.iter().map(|parameter| if parameter.is_of_each_log() { logs } else { 1 }).sum()
    }

    /// A fit from where the screening says: numbers at nominal, or, where that leaves much more than was promised or bends them, as the refit has
    /// them.
    /// It is given up where it soon costs more than `most`.
    fn fit_of(&self, lead: &Lead, most: f64) -> Candidate {
        let to_beat = most.min(self.search.worth_more(self.refit));
        let fit = self.search.extend_below(self.refit, lead, true, to_beat);
        let promised = 1.0 - (1.0 - lead.share).max(0.0).sqrt();
        let taken = 1.0 - self.left(&fit);
        let is_as_promised = taken > MUCH_LESS * promised && fit.found.prior_cost < FREED_BESIDES;
        if lead.share < PROMISING || fit.chi < AT_NOISE || is_as_promised {
            return fit;
        }
        better(fit, self.search.extend_below(self.refit, lead, false, to_beat))
    }

    /// Where several fits came to the noise, each is tried in its other forms, the best as well: which of them is named must not hang on a
    /// form that the screening could not tell from the next.
    fn rivals(&self, mut fits: Vec<Candidate>, leads: &[Lead]) -> Vec<Candidate> {
        if fits.iter().filter(|fit| fit.chi < AT_NOISE).count() < 2 {
            return fits;
        }
        let most_numbers = fits.first().map_or(0, |best| best.hypothesis.parameters());
        for fit in fits.iter_mut().filter(|fit| fit.chi < AT_NOISE) {
            let Some(own) = fit.hypothesis.installed.last().map(|i| (i.effect.id(), i.form.name)) else { continue };
            let Some(lead) = in_form(leads, own) else { continue };
            let most = NO_RIVAL * fit.found.data_cost;
            // At the noise a form of many more numbers says nothing that one of few does not, unless the best has as many.
            let numbers = most_numbers.max(self.numbers(lead.form) + FEW_MORE);
            for other in self.others(own, leads, lead.gain).filter(|other| self.numbers(other.form) <= numbers) {
                *fit = better(fit.clone(), self.fit_of(other, most));
            }
        }
        fits.sort_by(|a, b| a.chi.total_cmp(&b.chi));
        // The best may have another form now.
        self.kin(&mut fits);
        fits
    }
}

/// The lead of an effect in a form.
fn in_form<'l>(leads: &'l [Lead], (id, form): (&str, &str)) -> Option<&'l Lead> {
    leads.iter().find(|lead| (lead.effect.id(), lead.form.name) == (id, form))
}

/// `leads` and one more, unless it is among them.
fn and<'l>(leads: impl Iterator<Item = &'l Lead>, more: Option<&'l Lead>) -> Vec<&'l Lead> {
    let mut leads: Vec<&Lead> = leads.collect();
    let more = more.filter(|more| !leads.iter().any(|lead| std::ptr::eq(*lead, *more)));
    leads.extend(more);
    leads
}

fn better(one: Candidate, other: Candidate) -> Candidate {
    if other.chi < one.chi { other } else { one }
}

/// Puts `fit` among `fits`, in the place of one of the same effects if it leaves less.
fn keep_better(fits: &mut Vec<Candidate>, fit: Candidate) {
    match fits.iter_mut().find(|known| known.hypothesis.has_effects_of(&fit.hypothesis)) {
        Some(known) if fit.chi < known.chi => *known = fit,
        Some(_) => {}
        None => fits.push(fit),
    }
}

/// The leads that are worth a fit, one for each effect.
fn chosen(leads: &[Lead]) -> Vec<&Lead> {
    let entries = distinct(leads);
    let best = entries.first().map_or(0.0, |lead| lead.gain);
    let is_hopeless = entries.first().is_none_or(|lead| lead.share < HOPELESS);
    let lag = entries.iter().take(3).any(|lead| is_lag(lead));
    let is_chosen =
        |(rank, lead): &(usize, &Lead)| *rank < FIRST || lead.gain > LEAST_SHARE * best || lag && is_lag(lead);
    let most = if is_hopeless { 1 } else { MOST_FITS };
    entries.into_iter().enumerate().filter(is_chosen).map(|(_, lead)| lead).take(most).collect()
}

/// A shifted reading, with the gain of the best lead: hysterons that hold something imitate it near where a refit ends and nowhere else, so
/// that no score says anything of it, and it costs little to try.
fn offset(leads: &[Lead]) -> Option<Lead> {
    let lead = leads.iter().find(|lead| lead.effect.id() == OFFSET && lead.form.name == "constant")?;
    Some(Lead { gain: leads.first()?.gain, ..lead.clone() })
}

fn is_lag(lead: &Lead) -> bool {
    LAGS.contains(&lead.effect.id())
}

/// The best lead of each effect, in order.
pub(super) fn distinct<'l>(leads: impl IntoIterator<Item = &'l Lead>) -> Vec<&'l Lead> {
    let mut seen: Vec<&str> = Vec::new();
    leads
        .into_iter()
        .filter(|lead| {
            let new = !seen.contains(&lead.effect.id());
            seen.push(lead.effect.id());
            new
        })
        .collect()
}

/// Share of the excess power in the first tenth of the logs.
fn early_share(bench: &Bench<'_>, remainders: &[Remainder]) -> f64 {
    let (mut early, mut all) = (0.0, 0.0);
    for (record, residual_m) in after_run_in(bench, remainders) {
        let noise2 = record.noise_m * record.noise_m;
        let tenth = residual_m.len() / 10;
        early += residual_m[..tenth].iter().map(|r| r * r - noise2).sum::<f64>() / noise2;
        all += residual_m.iter().map(|r| r * r - noise2).sum::<f64>() / noise2;
    }
    if all > 0.0 { early / all } else { 0.0 }
}
