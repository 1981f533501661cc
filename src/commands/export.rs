//! `hysteron export`: a log as another kind of file.

use crate::arguments::ExportCall;
use crate::failure::Failure;
use crate::output;
use plant_sim::log;

/// Rows that are held in memory: an hour at 20 kHz, some gigabytes.
const MOST_ROWS: usize = 72_000_000;

/// Runs it.
pub fn export(call: &ExportCall) -> Result<(), Failure> {
    let logs = super::logs::read(std::slice::from_ref(&call.log), &[], &call.read, MOST_ROWS)?;
    let [log] = logs.as_slice() else { return Err(Failure::call("one log at a time")) };
    log::export(&call.out, log)?;
    if call.out.extension().is_some_and(|end| end.eq_ignore_ascii_case("npy")) {
        output::warn(&["NPY has no room for metadata: rate, hold and latency are lost".to_owned()]);
    }
    if !log.others.is_empty() {
        output::warn(&[format!(
            "{}: left out, as they are none of a log's columns: {}; --columns says which column is which",
            call.log.display(),
            log::excerpt_list(&log.others)
        )]);
    }
    output::line(&format!("log: {} ({} rows)", call.out.display(), log.len()));
    Ok(())
}
