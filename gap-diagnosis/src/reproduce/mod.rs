//! The thesis reproduced: every number of its tables and equations beside what the project computes, with a verdict.
//!
//! Numbers stand here as they are printed, as text; everything beside them is computed from the model and controller files. A number that
//! does not come out is an erratum with its cause, or [`Verdict::Differs`], which a test forbids.
//!
//! Not here: how anything is computed (`plant_sim`), and the page's looks ([`crate::page`]).

mod equations;
mod facts;
mod figures;
pub mod loops;
mod page;
mod printed;
mod trend;

pub use page::page;
pub use printed::{agrees, half_digit, value};
pub use trend::{Trend, trend};

use plant_sim::controller::Controller;
use plant_sim::model::Model;
use std::path::Path;

/// What became of a printed number.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// It comes out, to its printed digits.
    Agrees,
    /// An independent solver's number comes out within the larger of 1 % and half a unit of its last digit.
    Within,
    /// It can't come out; what is right, and why.
    Erratum {
        /// The corrected number, as the project's errata state it.
        corrected: String,
        /// Why the print is wrong.
        cause: String,
    },
    /// Measured or chosen by the thesis' author: an input, with nothing to compute it from.
    Given,
    /// It neither comes out nor is explained.
    Differs,
}

/// A printed number and ours.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Equation, table or section.
    pub place: String,
    /// What it is.
    pub what: String,
    /// As printed.
    pub printed: String,
    /// Ours, in the same unit; not a number for a given one.
    pub ours: f64,
    /// Unit as a reader writes it.
    pub unit: &'static str,
    /// What became of it.
    pub verdict: Verdict,
}

impl Entry {
    fn new(place: &str, what: &str, printed: &str, ours: f64, unit: &'static str, verdict: Verdict) -> Self {
        Self { place: place.into(), what: what.into(), printed: printed.into(), ours, unit, verdict }
    }

    /// A number that must come out to its printed digits.
    fn digits(place: &str, what: &str, printed: &str, ours: f64, unit: &'static str) -> Self {
        let verdict = if agrees(printed, ours) { Verdict::Agrees } else { Verdict::Differs };
        Self::new(place, what, printed, ours, unit, verdict)
    }

    /// A number that is wrong in print: ours must be the corrected one to its digits, and not the printed one.
    fn erratum(
        place: &str,
        what: &str,
        printed: &str,
        ours: f64,
        unit: &'static str,
        corrected: &str,
        cause: &str,
    ) -> Self {
        let verdict = if agrees(corrected, ours) && !agrees(printed, ours) {
            Verdict::Erratum { corrected: corrected.into(), cause: cause.into() }
        } else {
            Verdict::Differs
        };
        Self::new(place, what, printed, ours, unit, verdict)
    }

    /// A claim in words that a number refutes.
    fn refuted(
        place: &str,
        what: &str,
        claim: &str,
        ours: f64,
        unit: &'static str,
        corrected: &str,
        cause: &str,
    ) -> Self {
        let verdict = if agrees(corrected, ours) {
            Verdict::Erratum { corrected: corrected.into(), cause: cause.into() }
        } else {
            Verdict::Differs
        };
        Self::new(place, what, claim, ours, unit, verdict)
    }

    /// A number that the thesis measured or chose.
    fn given(place: &str, what: &str, printed: &str, unit: &'static str) -> Self {
        Self::new(place, what, printed, f64::NAN, unit, Verdict::Given)
    }
}

/// The models and controllers of the thesis, from the project's own files.
#[derive(Clone, Debug)]
pub struct Thesis {
    /// Table 2.1.
    pub phs: Model,
    /// Its reduction (3.9).
    pub phs2: Model,
    /// (3.15).
    pub newid2: Model,
    /// Table 2.2.
    pub bouc_wen: Model,
    /// PI 1 and PI 2 without limits.
    pub pi1: Controller,
    /// See `pi1`.
    pub pi2: Controller,
}

macro_rules! parsed {
    ($kind:ty, $path:literal) => {
        <$kind>::parse(include_str!(concat!("../../../", $path)), Path::new($path))
            .unwrap_or_else(|error| panic!("a file of the project, tested: {error}"))
    };
}

impl Default for Thesis {
    fn default() -> Self {
        Self {
            phs: parsed!(Model, "models/thesis-phs.toml"),
            phs2: parsed!(Model, "models/thesis-phs2.toml"),
            newid2: parsed!(Model, "models/thesis-newid2.toml"),
            bouc_wen: parsed!(Model, "models/thesis-bouc-wen.toml"),
            pi1: parsed!(Controller, "controllers/pi1-unlimited.toml"),
            pi2: parsed!(Controller, "controllers/pi2-unlimited.toml"),
        }
    }
}

/// A chapter of the report.
#[derive(Clone, Debug)]
pub struct Chapter {
    /// Heading.
    pub heading: &'static str,
    /// What it is about.
    pub text: &'static str,
    /// Its numbers.
    pub entries: Vec<Entry>,
}

/// Everything recomputed.
#[derive(Clone, Debug)]
pub struct Reproduction {
    /// Numbers, chapter by chapter.
    pub chapters: Vec<Chapter>,
    /// Table 2.3, model against model.
    pub trend: Trend,
    /// The loops' recordings that the figures show.
    pub loops: loops::Loops,
}

impl Reproduction {
    /// All numbers.
    pub fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.chapters.iter().flat_map(|chapter| &chapter.entries)
    }

    /// How many numbers got a verdict that `is` accepts.
    pub fn count(&self, is: impl Fn(&Verdict) -> bool) -> usize {
        self.entries().filter(|entry| is(&entry.verdict)).count()
    }
}

/// Recomputes everything; `progress` is told what is being done.
pub fn reproduce(thesis: &Thesis, progress: &(dyn Fn(&str) + Sync)) -> Reproduction {
    progress("the plant");
    let facts = facts::facts(thesis);
    progress("Table 2.3");
    let trend = trend(thesis);
    progress("equations");
    let design = equations::design(thesis);
    let stability = equations::stability(thesis);
    progress("closed loops at 1 MHz");
    let loops = loops::run(thesis);
    let chapters = vec![
        Chapter {
            heading: "Plant: Tables 2.1 and 2.2",
            text: "What follows from the identified parameters. (Table 2.1 prints the slopes of the hysterons as \"beta^-1\" in 1/ohm: \
                   they are the slopes of h, in siemens.)",
            entries: facts,
        },
        Chapter {
            heading: "Control design: equations (3.9) to (3.27), Table 3.1",
            text: "Linearised, reduced to second order, and closed by the two PI controllers.",
            entries: design,
        },
        Chapter {
            heading: "Stability: proposition 3.3.1, equations (3.28) to (3.31)",
            text: "The Lyapunov equation solved with a bound on its error; what the proposition proves, and what can be proven.",
            entries: stability,
        },
        Chapter {
            heading: "Closed loops: Figures 3.9 and 3.10",
            text: "The thesis shows these as figures without numbers. The numbers are those of an independent solver (LSODA, relative \
                   tolerance 1e-8, controller in continuous time); ours run the board's control law at 1 MHz without delay. 120 um; a step \
                   is judged over 20 ms, a sine over its third period.",
            entries: loops.entries.clone(),
        },
    ];
    Reproduction { chapters, trend, loops }
}
