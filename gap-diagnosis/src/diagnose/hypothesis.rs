//! Hypotheses: forms of effects on top of the nominal plant, and how logs may start.

use nalgebra::DMatrix;
use plant_sim::chain::{Chain, Drive, Parts, Sensor};
use plant_sim::effects::{Effect, Form, Kind, Parameter, Role, Scales, Scope};

/// How a log may start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// In equilibrium, hysterons anywhere inside their dead zones.
    Rest,
    /// Relaxed, at the drive that was held before.
    Relaxed,
    /// Anywhere.
    Any,
}

/// One form of one effect, with its axes.
#[derive(Clone)]
pub struct Installed {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// The form.
    pub form: &'static Form,
    /// One axis for each parameter.
    pub axes: Vec<Axis>,
    /// Whether each of the hysterons that it adds to the plant holds something at rest: one without a dead zone leaks until it holds nothing.
    pub holds: Vec<bool>,
    /// Oscillators that it adds, modes and arms: a log that may begin anywhere begins with each of them somewhere.
    pub modes: usize,
    /// Whether it has a memory besides, a play or a presliding friction.
    pub remembers: bool,
    /// Products of the sensitivities to what belongs to each log, of each log, metres squared; none where that is not known.
    pub(super) squares_of_own: Vec<DMatrix<f64>>,
    /// The same of what the first stretch of each log tells.
    pub(super) squares_of_start: Vec<DMatrix<f64>>,
}

impl Installed {
    /// Whether parts of it belong to each log, and neither another one nor its own first stretch tells them.
    pub fn has_own_parts(&self) -> bool {
        self.axes.iter().any(|axis| axis.parameter.scope == Scope::EachLog)
    }

    /// Whether the first stretch of each log tells parts of it.
    pub fn is_told_at_once(&self) -> bool {
        self.axes.iter().any(|axis| axis.parameter.scope == Scope::EachStart)
    }

    /// Numbers of the axes of this scope.
    pub(super) fn of_scope(&self, scope: Scope) -> Vec<usize> {
        (0..self.axes.len()).filter(|number| self.axes[*number].parameter.scope == scope).collect()
    }

    /// Whether it is how something was set before each log: one number that stays.
    pub fn is_setting(&self) -> bool {
        self.axes.len() == 1 && self.is_told_at_once()
    }
}

/// One parameter as the search walks it.
#[derive(Clone, Debug)]
pub struct Axis {
    /// The parameter.
    pub parameter: Parameter,
    /// What one coordinate unit is worth (amplitudes and places).
    unit: f64,
    /// Mean and width of what other logs have of it, as coordinates; none where nothing is known of it.
    pub(super) usual: Option<[f64; 2]>,
}

impl Axis {
    fn new(parameter: Parameter) -> Self {
        let unit = match &parameter.role {
            Role::Amplitude(typical) => typical.abs(),
            Role::Shape(_) => 1.0,
            Role::Place(_) => 0.1 * (parameter.bounds[1] - parameter.bounds[0]),
        };
        Self { parameter, unit, usual: None }
    }

    /// Whether the effect vanishes at zero.
    pub fn is_amplitude(&self) -> bool {
        matches!(self.parameter.role, Role::Amplitude(_))
    }

    /// Values from which a search may start; the typical one for an amplitude.
    pub fn starts(&self) -> Vec<f64> {
        match &self.parameter.role {
            Role::Amplitude(typical) => vec![*typical],
            Role::Shape(starts) | Role::Place(starts) => starts.clone(),
        }
    }

    /// The value at coordinate `z`.
    pub fn value(&self, z: f64) -> f64 {
        let [low, high] = self.parameter.bounds;
        match self.parameter.role {
            Role::Shape(_) => z.exp().clamp(low, high),
            _ => (self.unit * z).clamp(low, high),
        }
    }

    /// The coordinate of `value`.
    pub fn coordinate(&self, value: f64) -> f64 {
        let [low, high] = self.parameter.bounds;
        let value = value.clamp(low, high);
        match self.parameter.role {
            Role::Shape(_) => value.max(f64::MIN_POSITIVE).ln(),
            _ => value / self.unit,
        }
    }

    pub(super) fn bounds(&self) -> [f64; 2] {
        self.parameter.bounds.map(|bound| self.coordinate(bound))
    }

    /// What another log may be expected to have and how logs differ in it, if that is known.
    pub fn usual(&self) -> Option<[f64; 2]> {
        // The width of its prior is twice as much.
        self.usual.map(|[z, width]| [self.value(z), 0.5 * width * self.slope(z).abs()])
    }

    /// Change of the value for one of the coordinate, at `z`.
    pub fn slope(&self, z: f64) -> f64 {
        if matches!(self.parameter.role, Role::Shape(_)) { self.value(z) } else { self.unit }
    }
}

/// A set of forms on top of the nominal plant.
#[derive(Clone)]
pub struct Hypothesis {
    /// The forms, in the order in which they are installed.
    pub installed: Vec<Installed>,
    /// How logs may start.
    pub freedom: Freedom,
    /// The same without a form of the start.
    pub(super) own_freedom: Freedom,
    /// How well each log tells what each hysteron holds when it begins, as variances of coordinates; nothing where that is not known.
    pub(super) variances_of_held: Vec<Vec<f64>>,
    /// What each hysteron holds when other logs begin; none where nothing is known of it.
    pub(super) usually_held: Vec<Option<Held>>,
}

/// What a hysteron holds when logs begin, as coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    /// Mean and width.
    pub mean: f64,
    /// See `mean`.
    pub width: f64,
    /// Square of the mean in units of its own error: what speaks against a hysteron that holds nothing.
    pub against_nothing: f64,
}

impl Hypothesis {
    /// The nominal plant alone.
    pub fn nominal(freedom: Freedom) -> Self {
        Self {
            installed: Vec::new(),
            freedom,
            own_freedom: freedom,
            variances_of_held: Vec::new(),
            usually_held: Vec::new(),
        }
    }

    /// This with those of its forms that `keep`, given the place of each, says. A start that is not kept leaves no state free, which would do the work of others.
    pub fn keeping(&self, keep: impl Fn(usize, &Installed) -> bool) -> Self {
        let added: usize = self.installed.iter().map(|installed| installed.holds.len()).sum();
        // Of the plant's own hysterons first, then of those of each form.
        let mut at = self.usually_held.len().saturating_sub(added);
        let (mut installed, mut usually_held) = (Vec::new(), self.usually_held[..at].to_vec());
        for (place, form) in self.installed.iter().enumerate() {
            let held = at..at + form.holds.len();
            at = held.end;
            if keep(place, form) {
                usually_held.extend_from_slice(self.usually_held.get(held).unwrap_or_default());
                installed.push(form.clone());
            }
        }
        let kept = Self { installed, usually_held, ..Self::nominal(self.own_freedom) };
        if kept.has_start() { Self { freedom: self.freedom, ..kept } } else { kept }
    }

    /// This with one form more.
    pub fn with(&self, effect: &'static dyn Effect, form: &'static Form, scales: &Scales<'_>) -> Self {
        let axes: Vec<Axis> = (form.parameters)(scales).into_iter().map(Axis::new).collect();
        let values: Vec<f64> = axes.iter().filter_map(|axis| axis.starts().first().copied()).collect();
        let plant = scales.plant.clone();
        let mut chain = Chain { drive: Drive::IDEAL, plant, parts: Parts::default(), sensor: Sensor::IDEAL };
        (form.install)(&mut chain, &values);
        let holds =
            chain.plant.hysterons.iter().skip(scales.plant.hysterons.len()).map(|one| one.edge_v() > 0.0).collect();
        let remembers = chain.sensor.play_m > 0.0 || chain.parts.holdable_n() > 0.0;
        let mut installed = self.installed.clone();
        let modes = chain.parts.modes.len() + chain.parts.arms.len();
        let (squares_of_own, squares_of_start) = (Vec::new(), Vec::new());
        installed.push(Installed { effect, form, axes, holds, modes, remembers, squares_of_own, squares_of_start });
        let freedom = if form.kind == Kind::Start { Freedom::Any } else { self.freedom };
        Self { installed, freedom, ..Self::nominal(self.own_freedom) }
    }

    /// Whether logs begin with a memory besides that of hysterons.
    pub fn remembers(&self) -> bool {
        self.installed.iter().any(|installed| installed.remembers)
    }

    /// Parameters of its forms.
    pub fn parameters(&self) -> usize {
        self.installed.iter().map(|installed| installed.axes.len()).sum()
    }

    /// Whether one of its forms is how logs start.
    pub fn has_start(&self) -> bool {
        self.installed.iter().any(|installed| installed.form.kind == Kind::Start)
    }

    /// Identifiers of its effects.
    pub fn ids(&self) -> Vec<&'static str> {
        self.installed.iter().map(|i| i.effect.id()).collect()
    }

    /// Whether its effects are those of `other`, in whatever order.
    pub fn has_effects_of(&self, other: &Self) -> bool {
        let (own, theirs) = (self.ids(), other.ids());
        own.len() == theirs.len() && own.iter().all(|id| theirs.contains(id))
    }
}
