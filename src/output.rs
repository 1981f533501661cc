//! What every command shows in the same way: progress, tables on the terminal, pages, provenance.

use crate::arguments::Show;
use crate::failure::Failure;
use gap_diagnosis::page::Page;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Prints a line to standard output; a reader that has gone away is no error.
pub fn line(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}

/// Prints warnings to standard error, one line each.
pub fn warn(warnings: &[String]) {
    for warning in warnings {
        eprintln!("warning: {warning}");
    }
}

/// Prints label and value, aligned.
pub fn facts(facts: &[(String, String)]) {
    let width = facts.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
    for (label, value) in facts {
        line(&format!("  {label:width$}  {value}"));
    }
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

/// Where the page goes: as asked, beside `out`, or nowhere.
pub fn page_path(show: &Show, out: &Path) -> Option<PathBuf> {
    if show.no_page { None } else { Some(show.page.clone().unwrap_or_else(|| out.with_extension("html"))) }
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
    let call: Vec<String> = std::env::args().skip(1).map(quoted).collect();
    let mut lines = vec![format!("hysteron {}", call.join(" ")), format!("hysteron {}", env!("CARGO_PKG_VERSION"))];
    lines.extend(seed.map(|seed| format!("seed {seed}")));
    lines
}

/// Name of a file without its folders.
pub fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}
