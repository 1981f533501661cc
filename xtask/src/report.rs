//! The third tier: `docs/tables.md`, written from the release build. Others add a line to [`TABLES`].
//!
//! Every number comes from running the built `hysteron` as a user would: no room is linked in here.

use crate::closed_loop;
use crate::project::{Outcome, Project, output};
use anyhow::{Context, Result};
use serde_json::Value;
use std::fs;
use std::path::PathBuf;

/// For tables that draw random numbers; printed with them. Chosen once, so that two runs compare.
const SEED: u64 = 1;

/// One table of the document.
pub struct Table {
    pub title: &'static str,
    /// What is run and how to read it, in one paragraph.
    pub about: &'static str,
    /// Makes the table's Markdown.
    pub rows: fn(&mut dyn Runner) -> Result<String>,
}

/// In the order of the document.
const TABLES: &[&Table] = &[&closed_loop::TABLE];

/// Runs `hysteron ARGS --out SOMEWHERE --json` and reads what it prints; the tests give a made one.
pub trait Runner {
    fn json(&mut self, args: &[String]) -> Result<Value>;

    /// The seed for tables that need one.
    fn seed(&self) -> u64;
}

/// Writes the document; a table that cannot be made is an error, never a gap.
pub fn run(project: &Project) -> Result<Outcome> {
    let program = project.release_binary()?;
    let scratch = project.root.join("target/report");
    fs::create_dir_all(&scratch).context("making target/report")?;
    let mut runner = Program { project, program, out: scratch.join("log.csv") };
    let text = document(&commit(project)?, &mut runner)?;
    let path = project.root.join("docs/tables.md");
    fs::create_dir_all(project.root.join("docs")).context("making docs/")?;
    fs::write(&path, text).context("writing docs/tables.md")?;
    fs::remove_dir_all(&scratch).context("emptying target/report")?;
    println!("wrote docs/tables.md");
    Ok(Outcome::Passed)
}

struct Program<'a> {
    project: &'a Project,
    program: PathBuf,
    /// Overwritten by each run: the tables need only what is printed.
    out: PathBuf,
}

impl Runner for Program<'_> {
    fn json(&mut self, args: &[String]) -> Result<Value> {
        println!("  hysteron {}", args.join(" "));
        let text = output(self.project.command(&self.program).args(args).arg("--out").arg(&self.out).arg("--json"))?;
        serde_json::from_str(&text).with_context(|| format!("hysteron {}: no JSON in {text:?}", args.join(" ")))
    }

    fn seed(&self) -> u64 {
        SEED
    }
}

fn document(commit: &str, runner: &mut dyn Runner) -> Result<String> {
    let mut text = format!(
        "# Tables\n\nWritten by `cargo xtask report`, not by hand: commit {commit}, seed {}, release build.\n",
        runner.seed()
    );
    for table in TABLES {
        println!("{}", table.title);
        let rows = (table.rows)(runner).with_context(|| format!("table `{}`", table.title))?;
        text.push_str(&format!("\n## {}\n\n{}\n\n{rows}", table.title, table.about));
    }
    Ok(text)
}

/// The commit the numbers belong to; a changed file is said, since then they belong to none.
fn commit(project: &Project) -> Result<String> {
    let git = |args: &[&str]| output(project.command("git").args(["-c", "safe.directory=*"]).args(args));
    let hash = git(&["rev-parse", "--short=12", "HEAD"])?;
    // The document itself is about to change: it does not count.
    let changes = git(&["status", "--porcelain", "--", ".", ":!docs/tables.md"])?;
    let remark = if changes.is_empty() { "" } else { " with uncommitted changes" };
    Ok(format!("{}{remark}", hash.trim()))
}

/// The value of a key that the contract promises, with `digits` after the point.
pub fn number(json: &Value, key: &str, digits: usize) -> Result<String> {
    let value = json.get(key).with_context(|| format!("hysteron printed no `{key}`"))?;
    // A step that never settles has no settling time: the contract's numbers may be null.
    if value.is_null() {
        return Ok("-".to_owned());
    }
    let value = value.as_f64().with_context(|| format!("`{key}` is no number: {value}"))?;
    Ok(format!("{value:.digits$}"))
}

/// A Markdown table; numbers read best to the right.
pub fn markdown(header: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = line(&header.iter().map(|&cell| cell.to_owned()).collect::<Vec<_>>());
    text.push_str(&line(&vec!["---:".to_owned(); header.len()]));
    rows.iter().for_each(|row| text.push_str(&line(row)));
    text
}

#[cfg(test)]
pub mod fake {
    //! A made `hysteron`: remembers how it was called and prints the contract's keys.

    use super::*;
    use serde_json::json;

    #[derive(Default)]
    pub struct Fake {
        pub calls: Vec<Vec<String>>,
    }

    impl Runner for Fake {
        fn json(&mut self, args: &[String]) -> Result<Value> {
            self.calls.push(args.to_vec());
            Ok(json!({
                "rise_ms": 0.153, "overshoot_percent": 46.15, "settle_2_percent_ms": null,
                "rms_error_um": 0.066, "rms_error_percent": 0.055, "gain": 1.0001, "phase_deg": -0.04,
                "peak_um": 175.6, "peak_V": 167.8, "limited_samples": 0,
            }))
        }

        fn seed(&self) -> u64 {
            7
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_document_says_commit_and_seed_and_has_every_table() {
        let text = document("abc123", &mut fake::Fake::default()).unwrap();
        assert!(text.contains("commit abc123, seed 7"), "{text}");
        for table in TABLES {
            assert!(text.contains(&format!("## {}\n", table.title)));
        }
        assert!(text.lines().all(|line| line == line.trim_end()), "tidy holds for generated pages too");
    }

    #[test]
    fn a_missing_key_is_an_error_and_a_null_a_dash() {
        let json = json!({ "gain": 1.00006, "settle_2_percent_ms": null, "peak_um": "high" });
        assert_eq!(number(&json, "gain", 4).unwrap(), "1.0001");
        assert_eq!(number(&json, "settle_2_percent_ms", 3).unwrap(), "-");
        assert!(number(&json, "peak_um", 1).is_err());
        assert!(number(&json, "rise_ms", 1).is_err());
    }
}
