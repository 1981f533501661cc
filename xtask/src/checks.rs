//! The first tier: the checks of every change, alone or all together.

use crate::project::{Outcome, Project, passes};
use crate::{arrows, bare, deny, firmware, tidy};
use anyhow::{Context, Result, bail};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, UNIX_EPOCH};

/// One thing to run, in a tier's table.
pub struct Step {
    pub name: &'static str,
    pub what: &'static str,
    pub run: fn(&Project) -> Result<Outcome>,
}

/// How long the link is fuzzed in this tier.
pub const FUZZ_SECONDS: u32 = 20;

/// Quick ones first, so that a slip in form is seen before minutes of tests.
const STEPS: &[Step] = &[
    Step { name: "fmt", what: "formatting", run: fmt },
    Step { name: "arrows", what: "dependencies between our rooms", run: arrows::run },
    Step { name: "tidy", what: "house rules", run: tidy::run },
    Step { name: "deny", what: "licences, sources, bans, advisories", run: deny::run },
    Step {
        name: "no-std",
        what: "the rooms that run on the chip, built for it",
        run: |project| bare::build(project, None),
    },
    // Before the tests, which run these images and would build them in silence.
    Step { name: "firmware", what: "the flash images", run: |project| firmware::build(project, None) },
    Step { name: "clippy", what: "lints, warnings denied", run: clippy },
    Step { name: "doc", what: "documentation, warnings denied", run: doc },
    Step { name: "test", what: "all tests", run: test },
    Step {
        name: "fuzz",
        what: "nonsense on the link, other seeds each time",
        run: |project| fuzz(project, FUZZ_SECONDS, None),
    },
];

/// The whole first tier.
pub fn all(project: &Project) -> Result<Outcome> {
    run_steps(project, STEPS.iter())
}

/// Runs every step, also after a failed one: one CI run should tell all that is wrong. Ends with a line for each.
pub fn run_steps<'a>(project: &Project, steps: impl Iterator<Item = &'a Step>) -> Result<Outcome> {
    let mut lines = Vec::new();
    let mut failed = Vec::new();
    for step in steps {
        println!("\n== {}: {} ==", step.name, step.what);
        let started = Instant::now();
        let word = match (step.run)(project) {
            Ok(Outcome::Passed) => "ok".to_owned(),
            Ok(Outcome::NotRun(reason)) => format!("not run: {reason}"),
            Err(error) => {
                failed.push(step.name);
                format!("FAILED: {error:#}")
            }
        };
        let line = summary_line(step.name, started.elapsed(), &word);
        println!("{line}");
        // The full text stands above; a list of complaints would drown the summary.
        lines.push(line.lines().next().unwrap_or_default().to_owned());
    }
    println!("\n== summary ==\n{}", lines.join("\n"));
    if !failed.is_empty() {
        bail!("failed: {}", failed.join(", "));
    }
    Ok(Outcome::Passed)
}

fn summary_line(name: &str, took: Duration, word: &str) -> String {
    format!("{name:10} {:7.1} s  {word}", took.as_secs_f64())
}

/// `cargo fmt --check`, in every workspace here.
pub fn fmt(project: &Project) -> Result<Outcome> {
    for manifest in project.manifests() {
        passes(project.cargo().args(["fmt", "--all", "--check", "--manifest-path"]).arg(manifest))?;
    }
    Ok(Outcome::Passed)
}

/// Lints of the library, the command, the tests, the examples and the flash images, warnings denied.
pub fn clippy(project: &Project) -> Result<Outcome> {
    let args = ["clippy", "--workspace", "--all-targets", "--locked", "--", "-D", "warnings"];
    passes(project.cargo().args(args))?;
    firmware::clippy(project)
}

/// Documentation with private items: a dead link is an error.
pub fn doc(project: &Project) -> Result<Outcome> {
    let args = ["doc", "--workspace", "--no-deps", "--document-private-items", "--locked"];
    passes(project.cargo().env("RUSTDOCFLAGS", "-D warnings").args(args))
}

/// `cargo test`, with the runner's closing lines once more at the end, where a reader of a long log looks.
pub fn test(project: &Project) -> Result<Outcome> {
    // What a passing test prints is where it says that it was not run.
    run_tests(project.cargo().args(["test", "--workspace", "--locked", "--no-fail-fast", "--", "--show-output"]))
}

/// Both directions of the link at once, for `seconds`. The first seed is printed; a failing one is named, and repeats alone.
pub fn fuzz(project: &Project, seconds: u32, seed: Option<u32>) -> Result<Outcome> {
    let from_clock = || UNIX_EPOCH.elapsed().map_or(1, |since| since.subsec_nanos() ^ since.as_secs() as u32);
    let seed = seed.unwrap_or_else(from_clock);
    println!("fuzz: {seconds} s from seed {seed}");
    let mut command = project.cargo();
    command.env("HYSTERON_FUZZ_SECONDS", seconds.to_string()).env("HYSTERON_FUZZ_SEED", seed.to_string());
    // As all tests are built: of one package alone, the features of what it stands on would be others, and all of it built again.
    run_tests(command.args(["test", "--workspace", "--locked", "--test", "fuzz", "--", "--nocapture"]))
}

/// Runs a test command, passes its output on and repeats the closing lines; `long` uses it too.
pub fn run_tests(command: &mut Command) -> Result<Outcome> {
    let mut child = command.stdout(Stdio::piped()).spawn().context("starting the tests")?;
    let stdout = child.stdout.take().context("the tests have no output")?;
    let (mut closing, mut not_run) = (Vec::new(), BTreeSet::new());
    for line in BufReader::new(stdout).split(b'\n') {
        let line = line.context("reading the tests' output")?;
        let line = String::from_utf8_lossy(&line);
        println!("{line}");
        if line.starts_with("test result: ") {
            closing.push(line.into_owned());
        } else if line.starts_with("not run: ") {
            not_run.insert(line.into_owned());
        }
    }
    let status = child.wait().context("waiting for the tests")?;
    println!("\nclosing lines of {} test programs:\n{}", closing.len(), closing.join("\n"));
    not_run.iter().for_each(|line| println!("{line}"));
    let counts = Counts::of(&closing);
    println!("tests: {} passed, {} failed, {} ignored", counts.passed, counts.failed, counts.ignored);
    if !status.success() {
        bail!("{status}: the tests");
    }
    if counts.passed == 0 {
        bail!("no test was run");
    }
    Ok(Outcome::Passed)
}

/// What the closing lines add up to.
#[derive(Debug, Default, PartialEq)]
struct Counts {
    passed: u64,
    failed: u64,
    ignored: u64,
}

impl Counts {
    fn of(closing: &[String]) -> Self {
        let mut counts = Counts::default();
        for line in closing {
            let words: Vec<&str> = line.split([' ', ';', '.']).filter(|word| !word.is_empty()).collect();
            for pair in words.windows(2) {
                let number = pair[0].parse().unwrap_or(0);
                match pair[1] {
                    "passed" => counts.passed += number,
                    "failed" => counts.failed += number,
                    "ignored" => counts.ignored += number,
                    _ => {}
                }
            }
        }
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closing_lines_add_up() {
        let lines = [
            "test result: ok. 12 passed; 0 failed; 1 ignored; 0 measured; 3 filtered out; finished in 0.02s",
            "test result: FAILED. 30 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1.50s",
        ];
        let counts = Counts::of(&lines.map(str::to_owned));
        assert_eq!(counts, Counts { passed: 42, failed: 2, ignored: 1 });
    }

    #[test]
    fn a_failing_test_program_fails_the_step_whatever_it_prints() {
        let script = "echo 'test result: ok. 1 passed; 0 failed; 0 ignored'; exit 1";
        assert!(run_tests(Command::new("sh").args(["-c", script])).is_err());
    }

    #[test]
    fn a_run_without_a_test_is_no_success() {
        assert!(run_tests(&mut Command::new("true")).is_err());
    }

    #[test]
    fn steps_go_on_after_a_failure_and_the_whole_fails() {
        let project = Project::find().unwrap();
        let passing = Step { name: "good", what: "", run: |_| Ok(Outcome::Passed) };
        let absent = Step { name: "absent", what: "", run: |_| Ok(Outcome::NotRun("no board".into())) };
        let failing = Step { name: "bad", what: "", run: |_| bail!("broken") };
        assert!(run_steps(&project, [&passing, &absent].into_iter()).is_ok());
        let error = run_steps(&project, [&failing, &passing, &failing].into_iter()).unwrap_err();
        assert_eq!(error.to_string(), "failed: bad, bad");
    }

    #[test]
    fn the_summary_says_name_time_and_result() {
        let line = summary_line("doc", Duration::from_millis(12_340), "ok");
        assert_eq!(line, "doc           12.3 s  ok");
    }
}
