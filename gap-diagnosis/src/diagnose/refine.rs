//! Where the shapes of a form promise most: a search around the best start of the screening's grid, on the same linear terms.
//!
//! A grid is coarse, and a form that begins too strong, or on the wrong side of a kink, leads a descent astray: with the limit of a range
//! a little too low the nominal numbers bend first, and then the limit leaves the range and nothing pulls it back.

use super::screen::{Block, Scored};

/// Forms that promise this share of what the best one does are searched, from round to round a larger one; so many at most.
const SHARE: f64 = 0.5;
const MORE: f64 = 0.1;
const MOST: usize = 6;
/// Rounds of steps to either side of every shape.
const ROUNDS: usize = 5;
/// What becomes of a step that helped, and of one that didn't.
const LONGER: f64 = 1.5;
const SHORTER: f64 = 0.5;

struct Walk {
    /// Which of the forms.
    form: usize,
    /// Steps of its parameters, in coordinates.
    steps: Vec<f64>,
}

/// Moves the shapes of the first of `forms`, which are sorted by their gain, to where `score` says that they promise most.
pub fn refine(forms: &mut [Scored], score: impl Fn(Vec<Block>) -> Vec<Option<Scored>>) {
    let least = SHARE * forms.first().map_or(0.0, |best| best.gain);
    let worth = forms.iter().enumerate().take_while(|(_, scored)| scored.gain > least);
    let walks = worth.map(|(form, scored)| Walk { form, steps: scored.block.steps() });
    let mut walks: Vec<Walk> = walks.filter(|walk| walk.steps.iter().any(|step| *step > 0.0)).take(MOST).collect();
    for round in 0..ROUNDS {
        let best = forms.iter().map(|scored| scored.gain).fold(0.0, f64::max);
        walks.retain(|walk| forms[walk.form].gain > (SHARE + MORE * round as f64) * best);
        let trials = walks.iter().enumerate().flat_map(|(number, walk)| {
            let Scored { block, values, .. } = &forms[walk.form];
            let moving = walk.steps.iter().enumerate().filter(|(_, step)| **step > 0.0);
            let sides = moving.flat_map(|(i, step)| [(i, -step), (i, *step)]);
            sides.filter_map(move |(i, by)| Some(((number, i), block.moved(values, i, by)?)))
        });
        let (places, trials): (Vec<(usize, usize)>, Vec<Block>) = trials.unzip();
        if trials.is_empty() {
            return;
        }
        let mut helped = vec![None; walks.len()];
        for ((number, i), trial) in places.into_iter().zip(score(trials)) {
            let best = &mut forms[walks[number].form];
            if let Some(trial) = trial.filter(|trial| trial.whole > best.whole) {
                *best = Scored { gain: trial.gain.max(best.gain), ..trial };
                helped[number] = Some(i);
            }
        }
        for (walk, helped) in walks.iter_mut().zip(helped) {
            for (i, step) in walk.steps.iter_mut().enumerate() {
                *step *= if helped == Some(i) { LONGER } else { SHORTER };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::diagnose::bench::Bench;
    use crate::diagnose::hypothesis::Freedom;
    use crate::diagnose::records::record;
    use crate::diagnose::screen::Starts;
    use crate::diagnose::search::Search;
    use crate::diagnose::thesis;
    use plant_sim::chain::{Chain, Drive};
    use plant_sim::log::Log;
    use plant_sim::replay::{Start, predict};
    use std::sync::atomic::AtomicUsize;

    #[test]
    fn a_limit_between_the_starts_of_the_grid_is_promised_where_it_is() {
        let model = thesis();
        let mut log = Log { dt_s: 5e-5, ..Log::default() };
        log.command_v =
            (0..4000).map(|k| 30.0 * (0.01 * f64::from(k)).sin() + 28.0 * (0.0043 * f64::from(k)).sin()).collect();
        let limit_v = 46.0;
        let drive = Drive { range_v: [-limit_v, limit_v], ..Drive::IDEAL };
        let limited = Chain { drive, ..model.chain() };
        log.displacement_m = vec![0.0; log.command_v.len()];
        log.displacement_m = predict(&limited, &log, &Start::relaxed(&limited), log.len());
        let bench = Bench::new(&model, vec![record(&log, &model.chain(), None)]);
        let simulations = AtomicUsize::new(0);
        let search = Search { bench: &bench, simulations: &simulations };
        let refit = search.refit(Freedom::Rest);
        let leads = search.screen(&refit, &Starts::of(&bench, &search.play(&refit)), &[]);
        let both = leads.iter().find(|lead| lead.effect.id() == "amplifier_saturation" && lead.form.name == "both");
        let both = both.expect("screened");
        assert!((both.values[0] / limit_v - 1.0).abs() < 0.02, "{:?}", both.values);
    }
}
