//! Everything a developer or CI runs, behind `cargo xtask`.
//!
//! Three tiers: `ci` (minutes, on every change), `long` (soaks and big inputs), `report` (the tables in `docs/`).
//! This crate depends on no other room: it runs cargo and the built `hysteron` as a user would.

mod arrows;
mod bare;
mod big_logs;
mod checks;
mod closed_loop;
mod deny;
mod firmware;
mod long;
mod project;
mod report;
mod tidy;

use anyhow::{Result, bail};
use clap::{Parser, Subcommand};
use project::{Outcome, Project};
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "cargo xtask", about = "Developer and CI tasks of hysteron")]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// All checks of the first tier, each with its time; ends with the tests' closing lines
    Ci,
    /// Formatting, checked and not changed
    Fmt,
    /// Lints of every target, warnings denied
    Clippy,
    /// Documentation with private items, warnings denied
    Doc,
    /// All tests of the host workspace
    Test,
    /// The no_std rooms, built for thumbv7em-none-eabihf
    NoStd {
        /// Which compiler builds them; by default rustup's where its target is installed, else Debian's
        #[arg(long = "with", value_enum)]
        toolchain: Option<bare::Toolchain>,
    },
    /// The flash images, built for thumbv7em-none-eabihf
    Firmware {
        /// Which compiler builds them; by default rustup's where its target is installed, else Debian's
        #[arg(long = "with", value_enum)]
        toolchain: Option<bare::Toolchain>,
    },
    /// Builds an image and flashes it with probe-rs
    Flash {
        /// The board: a file of firmware/src/bin
        #[arg(default_value = "nucleo-g474re")]
        board: String,
    },
    /// The dependency arrows between our rooms, held to the allowed list
    Arrows,
    /// House rules that a text search can hold
    Tidy,
    /// cargo-deny: licences, sources, bans, and advisories where their database can be had
    Deny,
    /// Nonsense on the link, seed after seed, for a limited time
    Fuzz {
        /// For so many seconds
        #[arg(long, default_value_t = checks::FUZZ_SECONDS)]
        seconds: u32,
        /// The first seed; from the clock where not given
        #[arg(long)]
        seed: Option<u32>,
    },
    /// Second tier: soaks and big inputs, minutes to hours
    Long {
        /// Tasks to run; all by default
        names: Vec<String>,
        /// Only list them
        #[arg(long)]
        list: bool,
    },
    /// Third tier: writes docs/tables.md from the release build, with commit and seed
    Report,
    /// The speed comparisons in benches/
    Bench {
        /// Which: solvers, link, diagnosis; all by default
        name: Option<String>,
    },
    /// Installs what the checks need (.ci/setup)
    Setup {
        /// Also cargo-deny, which takes a minute or two to build
        #[arg(long)]
        deny: bool,
    },
}

fn main() -> ExitCode {
    match run(Cli::parse().task) {
        Ok(Outcome::Passed) => ExitCode::SUCCESS,
        Ok(Outcome::NotRun(reason)) => {
            println!("not run: {reason}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("xtask: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(task: Task) -> Result<Outcome> {
    let project = Project::find()?;
    match task {
        Task::Ci => checks::all(&project),
        Task::Fmt => checks::fmt(&project),
        Task::Clippy => checks::clippy(&project),
        Task::Doc => checks::doc(&project),
        Task::Test => checks::test(&project),
        Task::NoStd { toolchain } => bare::build(&project, toolchain),
        Task::Firmware { toolchain } => firmware::build(&project, toolchain),
        Task::Flash { board } => firmware::flash(&project, &board),
        Task::Arrows => arrows::run(&project),
        Task::Tidy => tidy::run(&project),
        Task::Deny => deny::run(&project),
        Task::Fuzz { seconds, seed } => checks::fuzz(&project, seconds, seed),
        Task::Long { names, list } => long::run(&project, &names, list),
        Task::Report => report::run(&project),
        Task::Bench { name } => bench(&project, name.as_deref()),
        Task::Setup { deny } => setup(&project, deny),
    }
}

/// `benches/` is a workspace of its own, because it builds rival solvers that nobody else needs.
fn bench(project: &Project, name: Option<&str>) -> Result<Outcome> {
    let all = [("solvers", "hysteron-benches"), ("link", "link"), ("diagnosis", "diagnosis")];
    let chosen: Vec<_> = all.into_iter().filter(|(known, _)| name.is_none_or(|name| name == *known)).collect();
    if chosen.is_empty() {
        bail!("no comparison of this name; there are: solvers, link, diagnosis");
    }
    if !project.root.join("benches/Cargo.toml").exists() {
        return Ok(Outcome::NotRun("benches/ does not exist yet".into()));
    }
    // For this machine's processor, ours and the rivals alike: the question is the method, not the instruction set.
    for (_, program) in chosen {
        let mut cargo = project.cargo();
        cargo.env("RUSTFLAGS", "-C target-cpu=native");
        cargo.args(["run", "--release", "--locked", "--manifest-path", "benches/Cargo.toml", "--bin", program]);
        project::passes(&mut cargo)?;
    }
    Ok(Outcome::Passed)
}

/// One script installs, for CI and developers: see there what and why.
fn setup(project: &Project, deny: bool) -> Result<Outcome> {
    let mut command = project.command(project.root.join(".ci/setup"));
    if deny {
        command.arg("--deny");
    }
    project::passes(&mut command)
}
