//! Measured-looking logs from a true piezo bench that contains a known effect.
//!
//! A diagnosis is tested on cases whose answer is known. That test is worth something only if the cases do not share
//! the diagnosis' equations, so this room depends on no other of ours: it has its own integrator, loop, excitation and
//! text writing, and besides the textbook forms of each effect others, by [`Split`]. It diagnoses and scores nothing.
//!
//! ```
//! use blind_truth::{EffectId, Request, Size, Split, Subject, make};
//!
//! let subject = Subject::Effects(vec![EffectId::Backlash]);
//! let case = make(&Request { seed: 7, subject, split: Split::Develop, size: Size::Short, strength: None });
//! assert_eq!(case.logs.len(), 5);
//! assert!(case.truth.gap_over_noise > 3.0);
//! assert!(case.logs[0].to_csv().starts_with("# rate_hz: 20000\n"));
//! ```

mod bench;
mod case;
mod digitise;
mod drive;
mod effects;
#[cfg(test)]
mod form_tests;
mod forms;
mod hysteron;
#[cfg(test)]
mod integrator_tests;
#[cfg(test)]
mod log_tests;
mod nominal;
mod plan;
mod record;
mod sensor;
mod structure;

pub use bench::{Bench, run, run_monitored};
pub use case::{Case, Request, Truth, make};
pub use effects::{EffectId, ForeignKind, Split, Subject};
pub use forms::{Form, all as forms};
pub use plan::Size;
pub use record::Record;
