//! The second tier: what takes too long for every change. Others add a line to [`TASKS`].

use crate::checks::{Step, run_steps, run_tests};
use crate::project::{Outcome, Project, passes};
use crate::{big_logs, firmware};
use anyhow::{Result, bail};

/// Cases per property where the environment does not say: about 80 times proptest's default of 256.
const PROPTEST_CASES: &str = "20000";

const TASKS: &[Step] = &[
    Step {
        name: "tests",
        what: "every test in release, HYSTERON_LONG=1, 20000 cases per property that does not fix its number",
        run: tests,
    },
    Step {
        name: "board-1e7",
        what: "1e7 samples of the flash image: none lost, none late, bit for bit the law's",
        run: board,
    },
    Step { name: "mat-oracle", what: "MAT files against another program's reader and writer", run: mat_oracle },
    Step { name: "formats", what: "logs as Parquet and MDF 4, which a plain build leaves out", run: formats },
    Step { name: "firmware-twice", what: "the flash images built twice, the same bytes", run: firmware::twice },
    Step {
        name: "replay-2gb",
        what: "a 2 GB log replayed under a 600 MB address limit, peak memory printed",
        run: big_logs::replay,
    },
    Step {
        name: "diagnose-10min",
        what: "ten minutes at 20 kHz diagnosed in less than 1 GB, peak memory printed",
        run: big_logs::diagnose,
    },
];

/// Runs the named tasks, or all; lists them if asked.
pub fn run(project: &Project, names: &[String], list: bool) -> Result<Outcome> {
    if list {
        for task in TASKS {
            println!("{:12} {}", task.name, task.what);
        }
        return Ok(Outcome::Passed);
    }
    run_steps(project, chosen(names)?.into_iter())
}

fn chosen(names: &[String]) -> Result<Vec<&'static Step>> {
    if names.is_empty() {
        return Ok(TASKS.iter().collect());
    }
    let mut tasks = Vec::new();
    for name in names {
        match TASKS.iter().find(|task| task.name == name) {
            Some(task) => tasks.push(task),
            None => bail!("no long task `{name}`; `cargo xtask long --list` names them"),
        }
    }
    Ok(tasks)
}

/// In the workspace that builds what nobody else needs: the other program takes a minute to compile.
fn mat_oracle(project: &Project) -> Result<Outcome> {
    run_tests(project.cargo().args([
        "test",
        "--locked",
        "--manifest-path",
        "benches/Cargo.toml",
        "--test",
        "mat_oracle",
    ]))
}

/// Tests read HYSTERON_LONG to widen what they sweep; proptest reads its own variable.
fn tests(project: &Project) -> Result<Outcome> {
    let cases = std::env::var("PROPTEST_CASES").unwrap_or_else(|_| PROPTEST_CASES.to_owned());
    let mut command = project.cargo();
    command.env("HYSTERON_LONG", "1").env("PROPTEST_CASES", cases);
    run_tests(command.args(["test", "--release", "--workspace", "--locked", "--no-fail-fast", "--", "--show-output"]))
}

/// The optional formats bring crates of their own, which would cost every change a minute of building.
fn formats(project: &Project) -> Result<Outcome> {
    let formats = ["--locked", "-p", "plant-sim", "--features", "parquet,mf4"];
    passes(project.cargo().arg("clippy").args(formats).args(["--all-targets", "--", "-D", "warnings"]))?;
    run_tests(project.cargo().arg("test").args(formats).args(["--test", "log_export"]))
}

/// 500 s of the time of a board that streams at full rate; 28 minutes on a busy machine, 2026-11-21.
fn board(project: &Project) -> Result<Outcome> {
    let mut command = project.cargo();
    command.env("HYSTERON_BOARD_SAMPLES", "10000000");
    run_tests(command.args([
        "test",
        "--release",
        "--locked",
        "-p",
        "virtual-board",
        "--test",
        "soak",
        "--",
        "--nocapture",
    ]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_choose_in_the_order_given() {
        for task in TASKS {
            assert_eq!(TASKS.iter().filter(|other| other.name == task.name).count(), 1);
        }
        let two = chosen(&["replay-2gb".to_owned(), "tests".to_owned()]).unwrap();
        assert_eq!(two.iter().map(|task| task.name).collect::<Vec<_>>(), ["replay-2gb", "tests"]);
        assert_eq!(chosen(&[]).unwrap().len(), TASKS.len());
        assert!(chosen(&["soup".to_owned()]).is_err());
    }
}
