//! Runs diagnoses: each in its own process, in a folder that holds its logs and its plant and nothing else.

use super::store::{Store, read_if_there, read_json, sha256, write};
use crate::failure::Failure;
use crate::output;
use gap_diagnosis::score::Answer;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant, SystemTime};

/// Nominal plant of a case, beside its logs.
pub const PLANT: &str = "nominal.toml";
/// Says that a case is done; written last.
pub const DONE: &str = "run.json";
const ANSWER: &str = "diagnosis.json";
/// Page of a case.
pub const REPORT: &str = "report.html";
/// A diagnosis that takes longer than this has failed, and how often it is asked.
const LONGEST: Duration = Duration::from_secs(30 * 60);
const POLL: Duration = Duration::from_millis(20);
/// Letters of what a failed diagnosis said that are kept.
const MOST_SAID: usize = 400;

/// How a diagnosis ran.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ran {
    /// Exit code; none if a signal ended it, or if it could not be asked.
    pub exit_code: Option<i32>,
    /// How long it took.
    pub seconds: f64,
    /// Of the answer.
    pub diagnosis_sha256: Option<String>,
    /// Of the program that was asked; none in runs of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub program_sha256: Option<String>,
    /// What it said on standard error, where there is no answer.
    pub said: Option<String>,
}

/// Logs that lie in a case's folder, by their names.
pub struct Input {
    /// To be diagnosed.
    pub logs: Vec<String>,
    /// To try the answer on.
    pub held_out: Vec<String>,
    /// Further arguments.
    pub arguments: Vec<String>,
}

/// Diagnoses what `prepare` puts into `folder`, unless that is done already. Afterwards the folder holds [`DONE`], the answer
/// and its page; the logs are gone, as they can be made again.
///
/// # Errors
/// If files can't be written, the program can't be started, was interrupted or is another one now. A diagnosis that fails is no error but an answer
/// that is missing; so is what can't be asked, for which `prepare` says why.
pub fn ask(
    program: &Asked,
    folder: &Path,
    prepare: impl FnOnce(&Path) -> Result<Result<Input, String>, Failure>,
) -> Result<(), Failure> {
    if folder.join(DONE).is_file() {
        return Ok(());
    }
    program.check()?;
    let unwritable = |e| Failure::unwritable(folder, &e);
    // What a killed run left.
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(unwritable)?;
    }
    fs::create_dir_all(folder).map_err(unwritable)?;
    let ran = match prepare(folder)? {
        Ok(input) => diagnose(&program.path, folder, &input)?,
        Err(why) => Ran { said: Some(why), ..Ran::default() },
    };
    // While it ran it may have been exchanged as well.
    program.check()?;
    let ran = Ran { program_sha256: Some(program.sha256.clone()), ..ran };
    for entry in fs::read_dir(folder).map_err(unwritable)? {
        let path = entry.map_err(unwritable)?.path();
        let is_kept = [ANSWER, REPORT].iter().any(|name| path.ends_with(name));
        if path.is_dir() {
            fs::remove_dir_all(&path).map_err(unwritable)?;
        } else if !is_kept {
            fs::remove_file(&path).map_err(unwritable)?;
        }
    }
    write(&folder.join(DONE), super::store::json(&ran)?.as_bytes())
}

fn diagnose(program: &Path, folder: &Path, input: &Input) -> Result<Ran, Failure> {
    let started = Instant::now();
    let mut command = Command::new(program);
    // Nothing from outside: neither the environment nor standard input nor a path beyond the folder.
    command.current_dir(folder).env_clear().env("RAYON_NUM_THREADS", "1").stdin(Stdio::null()).stdout(Stdio::null());
    command.args(["diagnose", "--plant", PLANT]).args(&input.logs);
    for log in &input.held_out {
        command.args(["--held-out", log]);
    }
    command.args(["--out", "answer"]).args(&input.arguments);
    let unwritable = |e| Failure::unwritable(folder, &e);
    let mut child = command
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|e| Failure::call(format!("{}: cannot be started: {e}; name another program", program.display())))?;
    // Read beside the wait: a full pipe would stop the diagnosis.
    let complaints = child.stderr.take().map(|mut pipe| {
        std::thread::spawn(move || {
            let mut said = Vec::new();
            // What could not be read is not said.
            let _ = pipe.read_to_end(&mut said);
            said
        })
    });
    let mut status = child.try_wait().map_err(unwritable)?;
    while status.is_none() && started.elapsed() < LONGEST {
        std::thread::sleep(POLL);
        status = child.try_wait().map_err(unwritable)?;
    }
    let Some(status) = status else {
        let _ = child.kill();
        let _ = child.wait();
        let said = Some(format!("stopped: no answer after {} min", LONGEST.as_secs() / 60));
        return Ok(Ran { seconds: started.elapsed().as_secs_f64(), said, ..Ran::default() });
    };
    if was_interrupted(status) {
        return Err(Failure::interrupted("interrupted: the same call goes on where this one stopped"));
    }
    let seconds = started.elapsed().as_secs_f64();
    let exit_code = status.code();
    let answer = folder.join("answer");
    if exit_code == Some(0)
        && let Ok(text) = fs::read(answer.join(ANSWER))
    {
        fs::rename(answer.join(ANSWER), folder.join(ANSWER)).map_err(unwritable)?;
        // A page is welcome, and not part of the answer.
        let _ = fs::rename(answer.join(REPORT), folder.join(REPORT));
        return Ok(Ran { exit_code, seconds, diagnosis_sha256: Some(sha256(&text)), ..Ran::default() });
    }
    let said = complaints.and_then(|reader| reader.join().ok()).unwrap_or_default();
    let said = String::from_utf8_lossy(&said);
    let said: String = said.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(MOST_SAID).collect();
    let said = format!("{}: {}", status, if said.is_empty() { "no diagnosis.json" } else { &said });
    Ok(Ran { exit_code, seconds, said: Some(said), ..Ran::default() })
}

/// Whether somebody asked the process to stop, which says nothing about the case.
#[cfg(unix)]
fn was_interrupted(status: ExitStatus) -> bool {
    use std::os::unix::process::ExitStatusExt;
    // Hang-up, interrupt from the keyboard, terminate.
    matches!(status.signal(), Some(1 | 2 | 15))
}

#[cfg(not(unix))]
fn was_interrupted(_: ExitStatus) -> bool {
    false
}

/// How the diagnosis in `folder` ran, if it did.
pub fn ran(folder: &Path) -> Option<Ran> {
    read_json(&folder.join(DONE)).ok()
}

/// The answer in `folder`, or why there is none.
///
/// # Errors
/// What the diagnosis said instead, or what is wrong with its answer.
pub fn answer(folder: &Path) -> Result<Answer, String> {
    let ran = ran(folder).ok_or("not diagnosed")?;
    if let Some(said) = ran.said {
        return Err(said);
    }
    Answer::parse(&as_written(folder, &ran)?).map_err(|e| format!("{ANSWER}: {e}"))
}

/// The text of the answer in `folder`, which ran as `ran`, if it is the one that was written.
///
/// # Errors
/// That it is gone or another one.
pub fn as_written(folder: &Path, ran: &Ran) -> Result<String, String> {
    let text = fs::read_to_string(folder.join(ANSWER)).map_err(|e| format!("{ANSWER}: {e}"))?;
    if ran.diagnosis_sha256.as_deref() != Some(&sha256(text.as_bytes())) {
        return Err(format!("{ANSWER}: changed since it was written"));
    }
    Ok(text)
}

/// Does `work` on every item, `jobs` at a time, with a bar. The first failure stops what has not begun.
///
/// # Errors
/// The first failure.
pub fn each<T: Sync>(
    items: &[T],
    jobs: usize,
    what: &'static str,
    work: impl Fn(&T) -> Result<(), Failure> + Sync,
) -> Result<(), Failure> {
    let bar = output::bar(items.len() as u64, what);
    let (started, done) = (Instant::now(), AtomicUsize::new(0));
    let (next, failed) = (AtomicUsize::new(0), Mutex::new(None));
    let is_stopped = || failed.lock().map_or(true, |failed| failed.is_some());
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, items.len().max(1)) {
            scope.spawn(|| {
                while let Some(item) = items.get(next.fetch_add(1, Ordering::Relaxed))
                    && !is_stopped()
                {
                    if let Err(failure) = work(item)
                        && let Ok(mut failed) = failed.lock()
                    {
                        failed.get_or_insert(failure);
                    }
                    bar.inc(1);
                    let done = 1 + done.fetch_add(1, Ordering::Relaxed);
                    // Without a terminal there is no bar: a line for every tenth.
                    if bar.is_hidden() && (10 * done) / items.len() > (10 * (done - 1)) / items.len() {
                        let minutes = started.elapsed().as_secs_f64() / 60.0;
                        output::complain(&format!("{what}: {done} of {}, {minutes:.1} min", items.len()));
                    }
                }
            });
        }
    });
    bar.finish_and_clear();
    match failed.into_inner() {
        Ok(Some(failure)) => Err(failure),
        _ => Ok(()),
    }
}

/// The file in a run's folder that says which program gives all its answers.
const PROGRAM: &str = "program.txt";

/// The program that diagnoses, and what it is known by.
pub struct Asked {
    path: PathBuf,
    sha256: String,
    /// Its length and when it was written: a run takes hours, in which a build may put another one in its place.
    stamp: (u64, Option<SystemTime>),
}

/// The program that diagnoses: as asked, or this one.
///
/// # Errors
/// If it can't be found or read.
pub fn program(asked: Option<&Path>) -> Result<Asked, Failure> {
    let not_there = |e| Failure::call(format!("the program that diagnoses is not there: {e}"));
    // Absolute, because each diagnosis runs in its own folder.
    let path = asked.map_or_else(std::env::current_exe, fs::canonicalize).map_err(not_there)?;
    let stamp = stamp(&path).map_err(not_there)?;
    let sha256 = sha256(&fs::read(&path).map_err(not_there)?);
    Ok(Asked { path, sha256, stamp })
}

fn stamp(path: &Path) -> std::io::Result<(u64, Option<SystemTime>)> {
    let found = fs::metadata(path)?;
    Ok((found.len(), found.modified().ok()))
}

impl Asked {
    fn check(&self) -> Result<(), Failure> {
        if stamp(&self.path).is_ok_and(|stamp| stamp == self.stamp) {
            return Ok(());
        }
        let path = self.path.display();
        Err(Failure::call(format!("{path}: was exchanged under the run; go on with the program that began it")))
    }

    /// Holds a run to the program that began it, before that is asked anything. One of which answers are there, but not whose, is not
    /// this one's: then nothing is written, and the reader is told.
    ///
    /// # Errors
    /// If another program gave the answers that are there.
    pub fn settle(&self, store: &Store, ids: &[&str]) -> Result<(), Failure> {
        let has_begun = ids.iter().any(|id| store.case(id).join(DONE).is_file());
        match program_of(store)?.filter(|_| has_begun) {
            None if has_begun => output::warn(&[NOT_KNOWN.to_owned()]),
            known => settle_program(store, known.as_deref(), &self.sha256)?,
        }
        Ok(())
    }
}

/// Said of answers that older versions wrote down.
pub const NOT_KNOWN: &str = "which program gave the answers that are there is not known";

/// Sha256 of the program that gives the answers in `store`, if it says so.
///
/// # Errors
/// If that can't be read.
pub fn program_of(store: &Store) -> Result<Option<String>, Failure> {
    let text = read_if_there(&store.path(PROGRAM))?;
    Ok(text.and_then(|text| text.split_whitespace().next().map(str::to_owned)))
}

/// Writes down that the program of `sha256` gives the answers in `store`, of which `known` is written.
///
/// # Errors
/// If that is another one.
pub fn settle_program(store: &Store, known: Option<&str>, sha256: &str) -> Result<(), Failure> {
    match known {
        Some(known) if known == sha256 => Ok(()),
        Some(known) => Err(Failure::call(format!(
            "{}: its answers are of another program, sha256 {}.., this one has {}..; go on with that one (--program FILE) or name another \
             directory with --out",
            store.0.display(),
            &known[..known.len().min(16)],
            &sha256[..16]
        ))),
        None => write(&store.path(PROGRAM), format!("{sha256}  the program that gives all answers\n").as_bytes()),
    }
}
