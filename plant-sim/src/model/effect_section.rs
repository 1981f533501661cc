//! `[[effect]]` in model files: an entry of the registry, its form and its numbers.
//!
//! ```toml
//! [[effect]]
//! id = "creep"
//! form = "kelvin-voigt"
//! [effect.parameters]
//! stiffness_ratio = { value = 0.02, sigma_abs = 0.001, source = "diagnosed from ladder.csv" }
//! time_constant_s = { value = 1.5, sigma = 0.1, source = "diagnosed from ladder.csv" }
//! ```
//!
//! Keys are the parameters' names, SI units as they end. A parameter that every log has of its own (the phase of a line) belongs to no
//! plant: it may be left out and is zero then.

use super::check_sigma;
use crate::chain::Chain;
use crate::effects::{self, Effect, Form, Kind, Parameter, Role, sane};
use crate::param::Param;
use crate::phs::Phs;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// `[[effect]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectSection {
    /// Identifier in the registry.
    pub id: String,
    /// Name of the form.
    pub form: String,
    /// Numbers by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, Param>,
}

impl EffectSection {
    /// An effect with parameters in the order of the form's.
    pub fn new(effect: &dyn Effect, form: &Form, parameters: &[Param]) -> Self {
        let names = (form.parameters)(&sane::EXAMPLE).into_iter().map(|p| p.name.to_owned());
        let parameters = names.zip(parameters.iter().cloned()).collect();
        Self { id: effect.id().to_owned(), form: form.name.to_owned(), parameters }
    }

    /// The entry and its form; `None` if the registry lacks one of them.
    pub fn entry(&self) -> Option<(&'static dyn Effect, &'static Form)> {
        effects::find_form(&self.id, &self.form)
    }

    /// Puts the effect into a chain, if the registry knows it.
    pub fn install(&self, chain: &mut Chain) {
        if let Some((_, form)) = self.entry() {
            let values: Vec<f64> = (form.parameters)(&sane::EXAMPLE).iter().map(|p| self.value(p)).collect();
            (form.install)(chain, &values);
        }
    }

    fn value(&self, parameter: &Parameter) -> f64 {
        self.parameters.get(parameter.name).map_or(0.0, |param| param.value)
    }

    /// The same; what is wrong if the plant has nothing for it to act on: a hysteron to bend, a hysteresis to join.
    pub(super) fn install_where_it_acts(&self, key: &str, chain: &mut Chain) -> Result<(), String> {
        let before = chain.clone();
        self.install(chain);
        let Some((_, form)) = self.entry().filter(|(_, form)| form.kind == Kind::Predictable) else { return Ok(()) };
        let is_some = |p: &Parameter| matches!(p.role, Role::Amplitude(_)) && self.value(p) != 0.0;
        if *chain == before && (form.parameters)(&sane::EXAMPLE).iter().any(is_some) {
            return Err(format!(
                "{key}: {} in its form {:?} finds nothing to act on in this plant: remove it or choose another form",
                self.id, self.form
            ));
        }
        Ok(())
    }

    /// What is wrong with it on this plant, if anything: where, what, what to do.
    pub(super) fn validate(&self, key: &str, plant: &Phs) -> Result<(), String> {
        let Some(effect) = effects::find(&self.id) else {
            return Err(format!(
                "{key}.id is {:?}, which is no known effect: did you mean {:?}? `hysteron effects` lists all",
                self.id,
                effects::nearest(&self.id)
            ));
        };
        let Some((_, form)) = self.entry() else {
            let names: Vec<String> = effect.forms().iter().map(|form| format!("{:?}", form.name)).collect();
            return Err(format!("{key}.form is {:?}: {} has {}", self.form, self.id, names.join(", ")));
        };
        let parameters = sane::anywhere(form, plant);
        if let Some(unknown) = self.parameters.keys().find(|name| parameters.iter().all(|p| p.name != name.as_str())) {
            let names: Vec<&str> = parameters.iter().map(|p| p.name).collect();
            let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
            return Err(format!(
                "{key}.parameters.{unknown}: {} in its form {:?} has no such parameter; it has: {names}",
                self.id, self.form
            ));
        }
        for parameter in parameters {
            let key = format!("{key}.parameters.{}", parameter.name);
            match self.parameters.get(parameter.name) {
                Some(param) => check(&key, &parameter, param)?,
                None if parameter.is_of_each_log() => {}
                None => return Err(format!("{key} is missing: {} in its form {:?} needs it", self.id, self.form)),
            }
        }
        Ok(())
    }

    /// Numbers that are possible but look like a wrong unit.
    pub(super) fn warnings(&self, key: &str, plant: &Phs) -> Vec<String> {
        let Some((_, form)) = self.entry() else { return Vec::new() };
        let outside = |parameter: Parameter| {
            let value = self.parameters.get(parameter.name)?.value;
            let ([low, high], unit) = (parameter.bounds, parameter.unit);
            (!(low..=high).contains(&value)).then(|| {
                let (name, low, high) = (parameter.name, sane::short(low), sane::short(high));
                format!("{key}.parameters.{name} = {value:e} is outside {low} .. {high} {unit}: check its unit")
            })
        };
        sane::plausible(form, plant).into_iter().filter_map(outside).collect()
    }
}

fn check(key: &str, parameter: &Parameter, param: &Param) -> Result<(), String> {
    let ([low, high], value) = (parameter.bounds, param.value);
    if !(low..=high).contains(&value) {
        let (low, high) = (sane::short(low), sane::short(high));
        let unit = if parameter.unit.is_empty() { String::new() } else { format!(" {} (SI)", parameter.unit) };
        return Err(format!("{key} is {value:?}: it must lie between {low} and {high}{unit}; correct it"));
    }
    check_sigma(key, param)
}
