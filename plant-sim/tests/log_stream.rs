//! A large log is read in bounded memory.
//!
//! Alone in its own program, so that the process's peak memory is this test's. Where the operating system does not
//! tell the peak (`/proc/self/status` is Linux's), the second measure still holds on its own: the reader never asks
//! the input for more than a fixed number of bytes beyond the rows it has given.

use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use plant_sim::log::{ReadOptions, RowReader};

/// More than the reader may need, and far less than the log.
const MAX_GROWTH_BYTES: u64 = 8 << 20;

/// Two buffers of 64 KiB, the `csv` crate's own of 64 KiB, and 64 rows.
const MAX_AHEAD_BYTES: u64 = 4 << 16;

/// A CSV of this many bytes that exists nowhere: a block of 20 000 rows over and over, each time at later times.
const TOTAL_BYTES: u64 = 200 << 20;

/// Bytes of one row: `00000.00000,+1.500000,+12.345678\n`.
const ROW_BYTES: u64 = 33;

struct Fabricated {
    row: u64,
    pending: Vec<u8>,
    at: usize,
    given: Arc<AtomicU64>,
}

impl Read for Fabricated {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.at == self.pending.len() && self.row * ROW_BYTES < TOTAL_BYTES {
            self.pending.clear();
            self.at = 0;
            for _ in 0..1000 {
                // 20 kHz: the time in units of 10 us is 5 k.
                let units = 5 * self.row;
                let mut row = *b"00000.00000,+1.500000,+12.345678\n";
                let mut digits = units;
                for place in [10, 9, 8, 7, 6, 4, 3, 2, 1, 0] {
                    row[place] = b'0' + (digits % 10) as u8;
                    digits /= 10;
                }
                row[19] = b'0' + (self.row % 10) as u8;
                self.pending.extend_from_slice(&row);
                self.row += 1;
            }
        }
        let n = out.len().min(self.pending.len() - self.at);
        out[..n].copy_from_slice(&self.pending[self.at..self.at + n]);
        self.at += n;
        self.given.fetch_add(n as u64, Ordering::Relaxed);
        Ok(n)
    }
}

/// The largest memory this process has had, bytes.
fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

#[test]
fn two_hundred_megabytes_pass_through_a_few() {
    const HEADER: &str = "time_s,command_V,displacement_um\n";
    let given = Arc::new(AtomicU64::new(0));
    let rows = Fabricated { row: 0, pending: Vec::new(), at: 0, given: Arc::clone(&given) };
    let before_bytes = peak_bytes();
    let reader = RowReader::from_csv(Path::new("endless.csv"), HEADER.as_bytes().chain(rows), &ReadOptions::default());
    let mut reader = reader.expect("opened");
    let (mut n_rows, mut sum_m, mut most_ahead_bytes) = (0u64, 0.0, 0);
    for row in reader.by_ref() {
        let row = row.unwrap_or_else(|error| panic!("{error}"));
        sum_m += row.displacement_m;
        n_rows += 1;
        most_ahead_bytes = most_ahead_bytes.max(given.load(Ordering::Relaxed) - n_rows * ROW_BYTES);
    }
    assert!(n_rows * ROW_BYTES >= TOTAL_BYTES);
    // The sum of 6 million equal values, each addition rounded: well within 1e-9 of it.
    assert!((sum_m / (n_rows as f64 * 12.345678e-6) - 1.0).abs() < 1e-9);
    assert!((reader.dt_s() - 5e-5).abs() < 1e-15);
    assert!(most_ahead_bytes <= MAX_AHEAD_BYTES, "{most_ahead_bytes} bytes ahead");
    match (before_bytes, peak_bytes()) {
        (Some(before), Some(after)) => {
            assert!(after - before < MAX_GROWTH_BYTES, "grew by {} bytes", after - before);
        }
        _ => println!("not run: peak memory, /proc/self/status absent"),
    }
}
