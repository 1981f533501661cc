//! One case: what is so, what was answered, and whether that is right.

use crate::diagnose::leading;
use serde::{Deserialize, Serialize};

/// The answer that there is no gap.
pub const NO_GAP: &str = "no_gap";
/// The answer that no entry of the registry explains the gap.
pub const UNKNOWN: &str = "unknown";
/// What stands in the place of an answer where the diagnosis failed.
pub const DEFECT: &str = "defect";

/// What is so.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Identifiers of the effects on the bench; none for a null and for something foreign.
    pub effects: Vec<String>,
    /// Something that no entry of the registry explains.
    pub foreign: Option<String>,
    /// Stage of a single effect, where it has one.
    pub stage: Option<String>,
    /// In which form each occurs.
    pub form: String,
    /// Whether these are forms of textbooks, which the registry has too.
    pub is_textbook_form: bool,
    /// Gap over noise before any refit; unknown for real data.
    pub gap_over_noise: Option<f64>,
    /// Rms of the sensor's noise; unknown for real data.
    pub noise_um: Option<f64>,
    /// Sizes of effects and nuisances, unit in the name.
    #[serde(default)]
    pub parameters: Vec<(String, f64)>,
}

/// What kind of case it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Nothing but the nominal plant within its sigma.
    Null,
    /// One effect.
    Single,
    /// Two or more.
    Pair,
    /// Something outside the registry.
    Foreign,
}

impl Truth {
    /// Its kind.
    pub fn kind(&self) -> Kind {
        match (&self.foreign, self.effects.len()) {
            (Some(_), _) => Kind::Foreign,
            (None, 0) => Kind::Null,
            (None, 1) => Kind::Single,
            _ => Kind::Pair,
        }
    }

    /// The names that an answer should lead with: any of the effects, `unknown` or `no_gap`.
    pub fn names(&self) -> Vec<&str> {
        match self.kind() {
            Kind::Foreign => vec![UNKNOWN],
            Kind::Null => vec![NO_GAP],
            _ => self.effects.iter().map(String::as_str).collect(),
        }
    }

    /// In words, for tables.
    pub fn words(&self) -> String {
        match &self.foreign {
            Some(kind) => format!("foreign: {kind}"),
            None if self.effects.is_empty() => "null".to_owned(),
            None => self.effects.join(" + "),
        }
    }
}

/// The part of a `diagnosis.json` that is scored.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Answer {
    verdict: Verdict,
    /// Named effects, largest share first.
    pub effects: Vec<String>,
    /// Stage of the chain.
    #[serde(default)]
    pub stage: Option<String>,
    ranking: Vec<Ranked>,
    /// Smallest set holding 90 % of the probability.
    pub set90: Vec<String>,
    /// Entries that the logs cannot tell apart.
    #[serde(default)]
    pub classes: Vec<Vec<String>>,
    /// Sizes of the gap.
    #[serde(default)]
    pub gap: Gap,
    /// What was fitted that leaves least; none where nothing was fitted, or by a version that does not say it.
    #[serde(default)]
    pub best_fit: Option<BestFit>,
    /// Numbers of the named effects.
    #[serde(default)]
    pub parameters: Vec<Estimate>,
    /// What would split the set.
    #[serde(default)]
    pub next_experiment: Option<NextExperiment>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Verdict {
    NoGap,
    Explained,
    Unknown,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
struct Ranked {
    effect: String,
    probability: f64,
}

/// Sizes of the gap on data that were not fitted.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct Gap {
    /// What the refitted nominal plant leaves.
    pub refit_rms_um: Option<f64>,
    /// What the plant with the named effects leaves.
    pub augmented_rms_um: Option<f64>,
    /// What the diagnosis takes the noise for.
    pub noise_rms_um: Option<f64>,
    /// How far the gap shrank.
    pub shrink_percent: Option<f64>,
    /// How far it was said to shrink before that was tried.
    pub predicted_shrink_percent: Option<f64>,
    /// The 95 % interval of that.
    pub predicted_shrink_percent_ci95: Option<(f64, f64)>,
    /// How far the gap closed, noise taken off.
    pub closure_percent: Option<f64>,
}

/// The fit that leaves least, named or not.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct BestFit {
    /// What it leaves of the fitted rows, in units of what the diagnosis takes the noise for.
    pub rms_over_noise: f64,
}

/// A number of a named effect.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Estimate {
    /// The effect.
    pub effect: String,
    /// Its name in the registry, unit in the name.
    pub name: String,
    /// What was found, SI.
    pub value: f64,
    /// Its standard deviation; none where it is not known.
    pub sigma: Option<f64>,
}

/// An experiment that splits the set.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct NextExperiment {
    /// What to drive with; none where no command splits it.
    #[serde(default)]
    pub spec: Option<String>,
    /// Samples per second.
    #[serde(default)]
    pub rate_hz: Option<f64>,
}

impl Answer {
    /// Reads a `diagnosis.json`, strictly enough that whatever is scored is there and means something.
    ///
    /// # Errors
    /// What is missing or contradicts itself.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut answer: Self = serde_json::from_str(text).map_err(|e| e.to_string())?;
        let total: f64 = answer.ranking.iter().map(|r| r.probability).sum();
        let is_probability = |r: &Ranked| (0.0..=1.0 + 1e-9).contains(&r.probability);
        if !answer.ranking.iter().all(is_probability) || (total - 1.0).abs() > 0.01 {
            return Err(format!("the ranking's probabilities sum to {total:.4}"));
        }
        if (answer.verdict == Verdict::Explained) == answer.effects.is_empty() {
            return Err("the named effects contradict the verdict".into());
        }
        if answer.set90.is_empty() {
            return Err("set90 is empty".into());
        }
        answer.ranking.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        Ok(answer)
    }

    /// The leading name: the most probable of the named effects, `unknown` or `no_gap`.
    pub fn name(&self) -> &str {
        match self.verdict {
            Verdict::NoGap => NO_GAP,
            Verdict::Unknown => UNKNOWN,
            // An explained gap has a name, `parse` has seen to that.
            Verdict::Explained => leading(&self.effects, |name| self.probability(name)).unwrap_or(UNKNOWN),
        }
    }

    /// Whether it names an effect.
    pub fn is_named(&self) -> bool {
        self.verdict == Verdict::Explained
    }

    /// Probability of one entry.
    pub fn probability(&self, name: &str) -> f64 {
        self.ranking.iter().filter(|r| r.effect == name).map(|r| r.probability).sum()
    }

    /// The `count` most probable answers, `unknown` and `no_gap` among them.
    pub fn first(&self, count: usize) -> impl Iterator<Item = &str> {
        self.ranking.iter().take(count).map(|r| r.effect.as_str())
    }

    /// The most probable entry of the registry: what is answered if both `unknown` and `no_gap` are ruled out.
    pub fn best_entry(&self) -> Option<&str> {
        self.ranking.iter().map(|r| r.effect.as_str()).find(|name| ![UNKNOWN, NO_GAP].contains(name))
    }

    /// The class rule of contracts.md: the truth itself, or an entry in one class with it while the truth is in `set90`.
    pub fn counts_as(&self, named: &str, truth: &str) -> bool {
        named == truth || (self.in_set(truth) && self.in_one_class(named, truth))
    }

    /// Whether `set90` holds `name`.
    pub fn in_set(&self, name: &str) -> bool {
        self.set90.iter().any(|member| member == name)
    }

    /// Whether both are in one class.
    pub fn in_one_class(&self, a: &str, b: &str) -> bool {
        let holds = |class: &[String], name: &str| class.iter().any(|member| member == name);
        self.classes.iter().any(|class| holds(class, a) && holds(class, b))
    }

    /// Probability that the answer gives to its being right by the class rule: that of the named effects and of whatever
    /// would count as one of them.
    pub fn confidence(&self) -> f64 {
        if !self.is_named() {
            return self.probability(self.name());
        }
        let claimed = |r: &&Ranked| self.effects.iter().any(|effect| self.counts_as(effect, &r.effect));
        self.ranking.iter().filter(claimed).map(|r| r.probability).sum::<f64>().min(1.0)
    }
}

/// A case that was answered, or should have been.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Opaque identifier.
    pub id: String,
    /// What is so.
    pub truth: Truth,
    /// What was answered, or why there is no answer.
    pub answer: Result<Answer, String>,
}

impl Case {
    /// The answer, if there is one.
    pub fn answered(&self) -> Option<&Answer> {
        self.answer.as_ref().ok()
    }

    /// Name that leads the answer; `defect` where there is none.
    pub fn name(&self) -> &str {
        self.answered().map_or(DEFECT, Answer::name)
    }

    /// Whether the leading name is right by the class rule.
    pub fn is_right(&self) -> bool {
        self.answered().is_some_and(|a| self.truth.names().iter().any(|truth| a.counts_as(a.name(), truth)))
    }

    /// Probability that the answer gives to its being right; nothing without an answer.
    pub fn confidence(&self) -> f64 {
        self.answered().map_or(0.0, Answer::confidence)
    }

    /// Named effects matched one to one with true ones, the exact matches first; `(matches, named, true)`.
    pub fn matches(&self) -> (usize, usize, usize) {
        let Some(answer) = self.answered() else { return (0, 0, self.truth.effects.len()) };
        let named = if answer.is_named() { answer.effects.as_slice() } else { &[] };
        let mut open: Vec<&String> = self.truth.effects.iter().collect();
        let mut left: Vec<&String> = Vec::new();
        for name in named {
            match open.iter().position(|truth| *truth == name) {
                Some(at) => drop(open.remove(at)),
                None => left.push(name),
            }
        }
        for name in left {
            if let Some(at) = open.iter().position(|truth| answer.counts_as(name, truth)) {
                open.remove(at);
            }
        }
        (self.truth.effects.len() - open.len(), named.len(), self.truth.effects.len())
    }

    /// Gap that is left after the answer's refit, in units of the true noise.
    pub fn refit_over_noise(&self) -> Option<f64> {
        let refit_um = self.answered()?.gap.refit_rms_um?;
        let noise_um = self.truth.noise_um.filter(|noise_um| *noise_um > 0.0)?;
        Some((refit_um * refit_um - noise_um * noise_um).max(0.0).sqrt() / noise_um)
    }
}
