//! Cases that `blind-truth` makes: their files, and what is so about them.

use super::plan::{Label, Order};
use super::runner::{Input, PLANT};
use super::store::{Store, json, write};
use crate::failure::Failure;
use blind_truth::{Case, EffectId, Record, Split, forms, make};
use gap_diagnosis::score::Truth;
use std::path::Path;

/// Makes the case of a label.
///
/// # Errors
/// If the label has no meaning, which one edited by hand may bring about.
pub fn case(label: &Label, order: &Order) -> Result<Case, Failure> {
    Ok(make(&label.request(order).map_err(Failure::file)?))
}

/// Puts plant and logs into `folder`.
///
/// # Errors
/// If they can't be written.
pub fn lay_out(case: &Case, folder: &Path) -> Result<Input, Failure> {
    write(&folder.join(PLANT), case.plant_toml.as_bytes())?;
    let lay = |records: &[Record]| records.iter().map(|record| lay_log(record, folder)).collect::<Result<Vec<_>, _>>();
    Ok(Input { logs: lay(&case.logs)?, held_out: lay(&case.held_out)?, arguments: Vec::new() })
}

/// Puts one log into `folder`.
///
/// # Errors
/// If it can't be written.
pub fn lay_log(record: &Record, folder: &Path) -> Result<String, Failure> {
    let name = format!("{}.csv", record.name);
    write(&folder.join(&name), record.to_csv().as_bytes())?;
    Ok(name)
}

/// What is so, for the score.
pub fn truth(case: &Case) -> Truth {
    let truth = &case.truth;
    let stage = match truth.effects.as_slice() {
        // A wrong number may be anywhere.
        [effect] if *effect != EffectId::ParameterError => Some(effect.stage().to_owned()),
        _ => None,
    };
    Truth {
        effects: truth.effects.iter().map(|effect| effect.id().to_owned()).collect(),
        foreign: truth.foreign.map(|kind| kind.id().to_owned()),
        stage,
        is_textbook_form: form_names(&truth.effects, &truth.form)
            .into_iter()
            .zip(&truth.effects)
            .all(|(name, effect)| is_textbook(*effect, name)),
        form: truth.form.clone(),
        gap_over_noise: Some(truth.gap_over_noise),
        noise_um: Some(truth.noise_um),
        parameters: truth.parameters.clone(),
    }
}

/// The forms' names, in the order of the effects. A name may hold a plus itself, so each ends where the next effect begins.
fn form_names<'a>(effects: &[EffectId], joined: &'a str) -> Vec<&'a str> {
    let mut rest = effects.first().map_or("", |first| joined.trim_start_matches(first.id()).trim_start_matches(": "));
    let mut names = Vec::new();
    for next in effects.iter().skip(1) {
        let (name, after) = rest.split_once(&format!(" + {}: ", next.id())).unwrap_or((rest, ""));
        names.push(name);
        rest = after;
    }
    names.push(rest);
    names
}

/// Whether a form is among those of textbooks: what the develop split shows, and the registry has.
fn is_textbook(effect: EffectId, name: &str) -> bool {
    forms().any(|form| form.effect == effect && form.name == name && form.splits.contains(&Split::Develop))
}

/// The truth as it is sealed.
///
/// # Errors
/// If it has no JSON.
pub fn truth_text(case: &Case) -> Result<String, Failure> {
    json(&truth(case))
}

/// Writes the truth of a case to its sealed place.
///
/// # Errors
/// If it can't be written.
pub fn seal_truth(store: &Store, id: &str, case: &Case) -> Result<(), Failure> {
    write(&store.truth(id), truth_text(case)?.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use gap_diagnosis::score::known_forms;
    use plant_sim::effects::sane::EXAMPLE;
    use plant_sim::effects::{Form, find};

    #[test]
    fn stages_are_the_registrys() {
        for effect in EffectId::all().filter(|effect| *effect != EffectId::ParameterError) {
            assert_eq!(find(effect.id()).map(|entry| entry.stage().name()), Some(effect.stage()), "{}", effect.id());
        }
    }

    #[test]
    fn forms_keep_their_names_in_pairs() {
        use EffectId::{Backlash, Creep, NoiseExcess};
        assert_eq!(form_names(&[NoiseExcess], "noise_excess: a + b/f"), ["a + b/f"]);
        assert_eq!(form_names(&[NoiseExcess, Backlash], "noise_excess: a + b/f + backlash: play"), ["a + b/f", "play"]);
        assert!(is_textbook(Creep, "Kelvin-Voigt chain") && !is_textbook(Creep, "fractional power law"));
        // Every form is found again under its own name.
        for form in forms() {
            let joined = format!("{}: {} + backlash: x", form.effect.id(), form.name);
            assert_eq!(form_names(&[form.effect, Backlash], &joined)[0], form.name);
        }
    }

    #[test]
    fn forms_whose_numbers_are_compared_are_forms_of_the_truth_and_of_the_registry() {
        for (known, numbers) in known_forms() {
            let (effect, name) = known.split_once(": ").expect(known);
            assert!(forms().any(|form| form.effect.id() == effect && form.name == name), "{known}");
            let entry = find(effect).expect(effect);
            let of = |form: &Form| -> Vec<&str> {
                (form.parameters)(&EXAMPLE).iter().map(|parameter| parameter.name).collect()
            };
            assert!(entry.forms().iter().any(|form| of(form) == numbers), "{known}");
        }
    }
}
