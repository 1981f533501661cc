//! What every command shows in the same way: progress, tables on the terminal, pages, provenance.

use crate::arguments::{BoardCommand, Command, Show};
use crate::failure::Failure;
use gap_diagnosis::page::Page;
use indicatif::{ProgressBar, ProgressStyle};
use plant_sim::whole_file;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Whether a line meant for standard output could not be written.
static UNSAID: AtomicBool = AtomicBool::new(false);

/// Prints a line to standard output; a reader that has gone away is no error, a full disk is ([`check_said`]).
pub fn line(text: &str) {
    if let Err(error) = writeln!(std::io::stdout(), "{text}")
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        UNSAID.store(true, Ordering::Relaxed);
    }
}

/// Fails if a line did not get out.
pub fn check_said() -> Result<(), Failure> {
    if UNSAID.load(Ordering::Relaxed) {
        return Err(Failure::call("standard output cannot be written: send it to another place"));
    }
    Ok(())
}

/// Prints a line to standard error. Unlike `eprintln!` it doesn't panic where that is closed or full.
pub fn complain(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Prints warnings to standard error, one line each.
pub fn warn(warnings: &[String]) {
    for warning in warnings {
        complain(&format!("warning: {warning}"));
    }
}

/// Warnings with the file that each is about.
pub fn about(path: &Path, warnings: Vec<String>) -> Vec<String> {
    warnings.into_iter().map(|warning| format!("{}: {warning}", path.display())).collect()
}

/// Prints label and value, aligned. Pages write a true minus; what scripts and terminals get is ASCII.
pub fn facts(facts: &[(String, String)]) {
    let width = facts.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
    for (label, value) in facts {
        line(&format!("  {label:width$}  {}", ascii(value)));
    }
}

/// `text` with a true minus and powers of ten as scripts can read them: 1.5×10⁻⁹ is 1.5e-9.
pub fn ascii(text: &str) -> String {
    const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let plain = |c: char| match c {
        '\u{2212}' | '⁻' => '-',
        c => RAISED.iter().position(|raised| *raised == c).and_then(|n| char::from_digit(n as u32, 10)).unwrap_or(c),
    };
    text.replace("×10", "e").chars().map(plain).collect()
}

/// A bar for work of known length; shown only on a terminal.
pub fn bar(total: u64, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(total).with_message(what);
    if let Ok(style) = ProgressStyle::with_template("{msg} [{bar:40}] {percent}% {eta} left") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

/// A line that changes, for work of unknown length; shown only on a terminal.
pub fn spinner() -> ProgressBar {
    let spinner = ProgressBar::new_spinner();
    spinner.enable_steady_tick(Duration::from_millis(200));
    spinner
}

/// Where the page goes: as asked, beside `out`, or nowhere. Nothing goes beside a device or a pipe.
pub fn page_path(show: &Show, out: &Path) -> Option<PathBuf> {
    if show.no_page {
        return None;
    }
    let beside = || (!is_special(out)).then(|| out.with_extension("html"));
    show.page.clone().or_else(beside)
}

/// Where the report of a board's run goes: beside its log, LOG.board.json, and beside a device or a pipe nowhere.
pub fn report_path(out: &Path) -> Option<PathBuf> {
    (!is_special(out)).then(|| out.with_extension("board.json"))
}

/// The bytes of a file that a call names.
pub fn content(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path)
        .map_err(|error| Failure::file(format!("{}: cannot be read: {error}; check the name", path.display())))
}

/// A file's name and bytes.
pub fn named(path: &Path) -> Result<(String, Vec<u8>), Failure> {
    Ok((file_name(path), content(path)?))
}

/// The same, borrowed.
pub fn parts((name, content): &(String, Vec<u8>)) -> (&str, &[u8]) {
    (name, content)
}

/// The files that a call plays, each once. A run directory keeps a copy of each under the file's own name, so that two of one name are refused.
pub fn played<'a>(paths: impl Iterator<Item = &'a PathBuf>) -> Result<Vec<(String, Vec<u8>)>, Failure> {
    let mut files: Vec<(&Path, (String, Vec<u8>))> = Vec::new();
    for path in paths {
        match files.iter().find(|(_, (name, _))| *name == file_name(path)) {
            Some((other, _)) if same_file(other, path) => {}
            Some((other, (name, _))) => {
                return Err(Failure::call(format!(
                    "{} and {}: two played files are called {name}, and the run directory keeps both; rename one",
                    other.display(),
                    path.display()
                )));
            }
            None => files.push((path, named(path)?)),
        }
    }
    Ok(files.into_iter().map(|(_, file)| file).collect())
}

/// Whether `path` is there and is neither a file nor a directory: a device or a pipe, which nothing goes beside.
pub fn is_special(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Refuses outputs that can't be written or that would overwrite an input or one another, before any work is done.
pub fn check_places(command: Option<&Command>) -> Result<(), Failure> {
    let Some((command, (show, out))) = command.and_then(|command| Some((command, command.outputs()?))) else {
        return Ok(());
    };
    let page = show.and_then(|show| page_path(show, out));
    check_place(out, "--out", command.inputs())?;
    check_kind(command, out)?;
    if let Command::Board(BoardCommand::Run(_)) = command
        && let Some(report) = report_path(out)
    {
        check_place(&report, "--out, beside which the report goes,", command.inputs())?;
    }
    if let Some(page) = &page {
        if is_special(page) {
            return Err(Failure::call(format!("{}: is no file; name another page with --page", page.display())));
        }
        if same_file(page, out) {
            return Err(Failure::call(format!(
                "{}: would be both output and page; name the page with --page or leave it out with --no-page",
                page.display()
            )));
        }
        check_place(page, "--page", command.inputs())?;
    }
    Ok(())
}

/// Refuses a log's place that would say that it is of another kind than it is.
fn check_kind(command: &Command, out: &Path) -> Result<(), Failure> {
    let end = out.extension().map(|end| end.to_string_lossy().to_lowercase()).unwrap_or_default();
    let is_other = ["mat", "npy", "parquet", "mf4", "toml", "json"].contains(&end.as_str());
    if !command.writes_csv() || !is_other || is_special(out) {
        return Ok(());
    }
    let csv = out.with_extension("csv");
    let is_read = command.inputs().into_iter().any(|input| same_file(input, &csv));
    let name = if is_read { "a file that ends in .csv".to_owned() } else { csv.display().to_string() };
    Err(Failure::call(format!(
        "{}: what is written is CSV: name {name} with --out, and make another kind of it with `hysteron export`",
        out.display()
    )))
}

fn check_place(path: &Path, argument: &str, inputs: Vec<&Path>) -> Result<(), Failure> {
    let refuse = |what: &str| Err(Failure::call(format!("{}: {what} with {argument}", path.display())));
    if path.is_dir() || path.file_name().is_none() {
        return refuse("is a directory; name a file in it");
    }
    if inputs.into_iter().any(|input| same_file(input, path)) {
        return refuse("is read by this call and would be overwritten; name another file");
    }
    if path.metadata().is_ok_and(|found| found.permissions().readonly()) {
        return refuse("may not be written; make it writable or name another file");
    }
    match folder(path).metadata() {
        Ok(found) if found.is_dir() => {
            // Only to write says whether one may; nothing of it stays. A device or a pipe is opened when it is written to.
            let writable = if is_special(path) { Ok(()) } else { whole_file::try_beside(path) };
            writable.map_err(|error| Failure::unwritable(path, &error))
        }
        Ok(_) => refuse(&format!("{} is not a directory; name another place", folder(path).display())),
        Err(_) => refuse(&format!("the directory {} is not there; make it or name another", folder(path).display())),
    }
}

/// The directory that holds `path`.
fn folder(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether both paths lead to one place, whether or not it is there yet.
pub fn same_file(a: &Path, b: &Path) -> bool {
    let place = |path: &Path| {
        path.canonicalize().ok().or_else(|| Some(folder(path).canonicalize().ok()?.join(path.file_name()?)))
    };
    place(a).is_some_and(|a| Some(a) == place(b))
}

/// Writes a file that is whole or as it was.
pub fn save(path: &Path, content: &[u8]) -> Result<(), Failure> {
    whole_file::write(path, content).map_err(|e| Failure::unwritable(path, &e))
}

/// Writes the page and says where.
pub fn save_page(page: &Page, path: &Path, json: bool) -> Result<(), Failure> {
    page.save(path).map_err(|e| Failure::unwritable(path, &e))?;
    if !json {
        line(&format!("page: {}", path.display()));
    }
    Ok(())
}

/// The call, the version and the seed: what is needed to repeat the run.
pub fn provenance(seed: Option<u64>) -> Vec<String> {
    let quoted = |word: String| if word.contains([' ', '*', '\'', '"']) { format!("{word:?}") } else { word };
    let call: Vec<String> =
        std::env::args_os().skip(1).map(|word| quoted(word.to_string_lossy().into_owned())).collect();
    let mut lines = vec![format!("hysteron {}", call.join(" ")), format!("hysteron {}", env!("CARGO_PKG_VERSION"))];
    lines.extend(seed.map(|seed| format!("seed {seed}")));
    lines
}

/// Name of a file without its folders.
pub fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    #[test]
    fn terminals_get_ascii() {
        assert_eq!(super::ascii("\u{2212}1.500×10⁻¹² um"), "-1.500e-12 um");
        assert_eq!(super::ascii("stable: 6.5 dB"), "stable: 6.5 dB");
    }
}
