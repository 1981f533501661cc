//! The forms in which each effect occurs, and which split shows which: the table of tables is [`all`].
//!
//! A form draws its shape from the typical ranges of anchors.md section F and leaves one amplitude open; `case` finds
//! the amplitude that gives the wanted gap.

mod actuator;
mod contact;
mod drive;
mod foreign;
mod hysteresis;
mod noise;
mod sensor;
mod structure;
mod timing;

use crate::bench::Bench;
use crate::effects::{EffectId, ForeignKind, Split};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Mid stroke of the bender in metres: what 60 V reach. Sizes are given relative to it.
pub(crate) const STROKE_M: f64 = 100e-6;

/// Shown in `Develop` only.
pub(crate) const D: &[Split] = &[Split::Develop];
/// Shown in `Calibrate` only.
pub(crate) const C: &[Split] = &[Split::Calibrate];
/// Shown in `Report` only.
pub(crate) const R: &[Split] = &[Split::Report];
/// Shown in `Develop` and `Calibrate`.
pub(crate) const DC: &[Split] = &[Split::Develop, Split::Calibrate];
/// Shown in `Develop` and `Report`.
pub(crate) const DR: &[Split] = &[Split::Develop, Split::Report];
/// Shown in `Calibrate` and `Report`.
pub(crate) const CR: &[Split] = &[Split::Calibrate, Split::Report];
/// Shown in all three: where nature knows one form only.
pub(crate) const DCR: &[Split] = &[Split::Develop, Split::Calibrate, Split::Report];

/// One way in which an effect occurs.
pub struct Form {
    /// The effect.
    pub effect: EffectId,
    /// Name of the form, unique within the effect.
    pub name: &'static str,
    /// Splits that show it.
    pub splits: &'static [Split],
    /// Draws its shape.
    pub(crate) draw: fn(&mut Pcg64) -> Planted,
}

/// A number that the bench sets a bound to, from the amplitude and the rows' period in seconds.
type Installed = Box<dyn Fn(f64, f64) -> f64 + Send + Sync>;

/// How an amplitude changes a bench.
type Apply = Box<dyn Fn(f64, &mut Bench) + Send + Sync>;

/// A form with its shape drawn and its amplitude open.
pub struct Planted {
    /// Shape parameters for `truth`: name with unit, value.
    pub(crate) parameters: Vec<(&'static str, f64)>,
    /// More of them, that hang on what the bench makes of the amplitude: the truth states what is installed.
    pub(crate) installed: Vec<(&'static str, Installed)>,
    /// Name of the amplitude, with unit. A larger amplitude makes a larger gap.
    pub(crate) amplitude: &'static str,
    /// What is physically sane.
    pub(crate) bounds: (f64, f64),
    /// Gap over noise to aim at; `None`: the amplitude is drawn within its bounds, whatever gap that makes.
    pub(crate) band: Option<(f64, f64)>,
    /// Puts it on the bench.
    pub(crate) apply: Apply,
}

/// Raw gap over noise to aim at where the effect has no reason for another: after a refit, 3 to 40 of it are left.
pub const BAND: (f64, f64) = (5.0, 60.0);

impl Planted {
    pub(crate) fn new(
        amplitude: &'static str,
        bounds: (f64, f64),
        apply: impl Fn(f64, &mut Bench) + Send + Sync + 'static,
    ) -> Self {
        Self {
            parameters: Vec::new(),
            installed: Vec::new(),
            amplitude,
            bounds,
            band: Some(BAND),
            apply: Box::new(apply),
        }
    }

    pub(crate) fn with(mut self, name: &'static str, value: f64) -> Self {
        self.parameters.push((name, value));
        self
    }

    pub(crate) fn installed(
        mut self,
        name: &'static str,
        value: impl Fn(f64, f64) -> f64 + Send + Sync + 'static,
    ) -> Self {
        self.installed.push((name, Box::new(value)));
        self
    }

    /// Every parameter for `truth` at this amplitude and period of the rows.
    pub(crate) fn stated(&self, amplitude: f64, period_s: f64) -> Vec<(&'static str, f64)> {
        let installed = self.installed.iter().map(|(name, value)| (*name, value(amplitude, period_s)));
        self.parameters.iter().copied().chain(installed).collect()
    }

    pub(crate) fn band(mut self, low: f64, high: f64) -> Self {
        self.band = Some((low, high));
        self
    }

    pub(crate) fn any_gap(mut self) -> Self {
        self.band = None;
        self
    }
}

/// Every form of every effect with the splits that show it.
pub fn all() -> impl Iterator<Item = &'static Form> {
    let tables = [
        drive::FORMS,
        actuator::FORMS,
        hysteresis::FORMS,
        structure::FORMS,
        contact::FORMS,
        sensor::FORMS,
        noise::FORMS,
        timing::FORMS,
    ];
    tables.into_iter().flatten()
}

/// Draws one of the forms that a split shows.
pub(crate) fn draw(effect: EffectId, split: Split, rng: &mut Pcg64) -> (&'static str, Planted) {
    let shown: Vec<&Form> = all().filter(|form| form.effect == effect && form.splits.contains(&split)).collect();
    // The table test holds that no pair of effect and split is empty.
    let form = shown[rng.random_range(0..shown.len())];
    (form.name, (form.draw)(rng))
}

/// A foreign kind with its shape drawn.
pub(crate) fn foreign(kind: ForeignKind, rng: &mut Pcg64) -> Planted {
    foreign::draw(kind, rng)
}

/// Uniform on a logarithmic scale.
pub(crate) fn log_uniform(rng: &mut Pcg64, low: f64, high: f64) -> f64 {
    low * (high / low).powf(rng.random::<f64>())
}

/// +1 or -1.
pub(crate) fn sign(rng: &mut Pcg64) -> f64 {
    if rng.random::<bool>() { 1.0 } else { -1.0 }
}
