//! A log streams through replay: the memory it takes doesn't grow with the log's length.
//!
//! `cargo xtask long` does the same with 2 GB.

use crate::support::{Folder, PLANT, root};
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Rows of the shorter log: more than replay keeps for the fit of the start (200 000) or for the page (400 000).
const ROWS: usize = 500_000;

/// Most resident memory, by far the page: 400 000 rows of four f64 (13 MB), the page's text, and the head of the log with what the fit
/// of the start holds. Measured: 36 MB for both lengths; the bound leaves two thirds as much again.
const MOST_KB: u64 = 60_000;

/// Rows at 20 kHz of a 100 Hz sine; 30 bytes each.
fn write_log(path: &Path, rows: usize) -> u64 {
    let mut file = BufWriter::new(File::create(path).expect("a file in a temporary folder"));
    let tails: Vec<String> = (0..200)
        .map(|k| {
            let drive_v = 60.0 * (std::f64::consts::TAU * f64::from(k) / 200.0).sin();
            format!(",{drive_v:.6},{:.6}\n", 1.884 * drive_v)
        })
        .collect();
    let mut text = "# rate_hz: 20000\ntime_s,command_V,displacement_um\n".to_owned();
    for row in 0..rows {
        let us = 50 * row;
        write!(text, "{}.{:06}{}", us / 1_000_000, us % 1_000_000, tails[row % 200]).expect("memory takes it");
        if text.len() > 1 << 16 {
            file.write_all(text.as_bytes()).expect("room on the disk");
            text.clear();
        }
    }
    file.write_all(text.as_bytes()).expect("room on the disk");
    file.flush().expect("room on the disk");
    fs::metadata(path).expect("it is there").len()
}

/// Peak resident memory of a replay in kB, and the rows of its prediction.
fn replay(folder: &Folder) -> (u64, usize) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .current_dir(root())
        .args(["replay", "--plant", PLANT, "--json", "--out"])
        .args([folder.path("p.csv"), folder.path("log.csv")])
        .stdout(Stdio::null())
        .spawn()
        .expect("the command starts");
    // The kernel keeps the peak; the last look before the end has it, but for what is allocated within the last 5 ms.
    let status = format!("/proc/{}/status", child.id());
    let mut peak_kb = 0;
    let ended = loop {
        if let Ok(text) = fs::read_to_string(&status)
            && let Some(line) = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))
        {
            peak_kb = peak_kb.max(line.trim().trim_end_matches(" kB").parse().expect("a number of kB"));
        }
        if let Some(ended) = child.try_wait().expect("it can be waited for") {
            break ended;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    assert!(ended.success());
    let prediction = fs::read(folder.path("p.csv")).expect("a prediction");
    // Without the metadata (rate and hold) and the header.
    (peak_kb, prediction.iter().filter(|byte| **byte == b'\n').count() - 3)
}

#[test]
fn a_log_of_60_mb_takes_no_more_memory_than_a_quarter_of_it() {
    let folder = Folder::new("memory");
    let mut peaks_kb = Vec::new();
    for rows in [ROWS, 4 * ROWS] {
        let bytes = write_log(&folder.path("log.csv"), rows);
        assert!(rows == ROWS || bytes > 55_000_000, "{bytes}");
        let (peak_kb, predicted) = replay(&folder);
        assert_eq!(predicted, rows, "no row is lost on the way");
        assert!(peak_kb < MOST_KB, "{peak_kb} kB for {bytes} bytes");
        peaks_kb.push(peak_kb);
    }
    // Nothing in the 45 MB more is kept; 10 % is what the page's size may differ by, as it keeps between 200 000 and 400 000 rows.
    assert!(peaks_kb[1] < peaks_kb[0] + peaks_kb[0] / 10, "{peaks_kb:?}");
    // Less than the program itself could not have been watched.
    assert!(peaks_kb[0] > 1000, "{peaks_kb:?}");
}
