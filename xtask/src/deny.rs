//! cargo-deny, as far as it can be had: the program may be missing, and its advisory database is a git fetch away.
//!
//! Bans, licences and sources need no network and always count. deny.toml gives a reason for each exception.

use crate::project::{Outcome, Project, is_there, passes, passes_within};
use anyhow::Result;
use std::time::Duration;

/// The database is a shallow clone of some megabytes; a closed network should not hold CI up for longer.
const FETCH_LIMIT: Duration = Duration::from_secs(60);

/// Runs what can be run, and says what was not.
pub fn run(project: &Project) -> Result<Outcome> {
    if !is_there(project.cargo().args(["deny", "--version"])) {
        return Ok(Outcome::NotRun("cargo-deny is not installed (cargo xtask setup --deny)".into()));
    }
    passes(project.cargo().args(["deny", "--locked", "check", "bans", "licenses", "sources"]))?;
    if passes_within(project.cargo().args(["deny", "fetch", "db"]), FETCH_LIMIT).is_err() {
        let reason = "advisories: their database could not be fetched; bans, licences and sources passed";
        return Ok(Outcome::NotRun(reason.into()));
    }
    // Offline, since all it needs is here now; the fetch above is the only step that may hang.
    passes(project.cargo().args(["deny", "--locked", "--offline", "check", "advisories"]))
}
