//! Every kind of bad input: one line that says file, place, column and what to do; and no bytes that panic.

use std::io::Cursor;
use std::path::Path;

use plant_sim::log::{self, Log, LogError, ReadOptions, RowReader};
use proptest::prelude::*;

/// The message for a CSV text called `bench.csv`.
fn refusal_with(text: &str, options: &ReadOptions) -> String {
    let result = RowReader::from_csv(Path::new("bench.csv"), Cursor::new(text.to_owned()), options)
        .and_then(RowReader::into_log);
    one_line(&result.expect_err("refused"))
}

fn refusal(text: &str) -> String {
    refusal_with(text, &ReadOptions::default())
}

fn one_line(error: &LogError) -> String {
    let message = error.to_string();
    assert_eq!(message.lines().count(), 1, "{message}");
    message
}

const HEADER: &str = "time_s,command_V,displacement_um\n";

/// A good log of `n` rows at 1 kHz, line k+2 is row k.
fn good(n: u32) -> Vec<String> {
    (0..n).map(|k| format!("{:.6},{}.5,{}.25\n", f64::from(k) / 1e3, k % 7, k % 5)).collect()
}

/// The same with one line (as an editor counts) replaced.
fn with_line(line: usize, text: &str) -> String {
    let mut rows = good(200);
    rows[line - 2] = text.to_owned();
    HEADER.to_owned() + &rows.concat()
}

#[test]
fn a_missing_column_names_those_there_are() {
    let text = format!("time_s,u_V,y_um\n{}", good(20).concat());
    assert_eq!(
        refusal(&text),
        "bench.csv: no column `command_V` (command); it has time_s, u_V, y_um; map one with --columns command=NAME"
    );
    let text = format!("t,command_V,displacement_um\n{}", good(20).concat());
    assert_eq!(
        refusal(&text),
        "bench.csv: no column `time_s` (time); it has t, command_V, displacement_um; map one with --columns time=NAME or give --rate HZ"
    );
    let text = (HEADER.to_owned() + &good(20).concat()).replace(',', " ");
    assert_eq!(
        refusal(&text),
        "bench.csv: no column `command_V` (command); it has one column, time_s command_V displacement_um, since a comma, a semicolon or a tab parts columns and blanks do not; map one with --columns command=NAME"
    );
    let mut options = ReadOptions::default();
    options.columns.insert("force".into(), "F".into());
    assert_eq!(
        refusal_with(&(HEADER.to_owned() + &good(20).concat()), &options),
        "bench.csv: no column `F` (force); it has time_s, command_V, displacement_um; map one with --columns force=NAME"
    );
    let text = format!("time_s,command_V,command_V,displacement_um\n{}", good(20).concat());
    assert_eq!(
        refusal(&text),
        "bench.csv: 2 columns answer to `command_V` (command); rename them or give the full name with --columns command=NAME"
    );
}

#[test]
fn text_in_a_number_is_shown_with_line_and_column() {
    assert_eq!(
        refusal(&with_line(120, "0.118000,1.0,o.5\n")),
        "bench.csv, line 120, column displacement_um: `o.5` is not a number; correct the cell or cut the log there"
    );
    // Blank lines and comments count, as in an editor, also with the line ends of Windows.
    let text = with_line(120, "\n# note\n\n0.118000,,0.5\n").replace('\n', "\r\n");
    assert_eq!(
        refusal(&text),
        "bench.csv, line 123, column command_V: `` is not a number; the cell is empty: fill it or cut the log there"
    );
    let text = with_line(3, "0,001;1,5;2\n").replace(HEADER, "time_s;command_V;displacement_um\n");
    let text = text.replace("0.000000,0.5,0.25", "0.000000;0.5;0.25");
    assert_eq!(
        refusal(&text),
        "bench.csv, line 3, column time_s: `0,001` is not a number; write decimal points, not commas"
    );
    let text = with_line(200, "0.198000,\u{1}\u{7f},0.5\n");
    let at = text.find('\u{1}').expect("there");
    assert_eq!(
        refusal(&text),
        format!("bench.csv: is not a text file (a control byte at byte {at}); logs are CSV, NPY or MAT v5")
    );
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    for value in ["NaN", "nan", "-inf", "1e999"] {
        assert_eq!(
            refusal(&with_line(77, &format!("0.075000,{value},0.5\n"))),
            format!(
                "bench.csv, line 77, column command_V: {value} is not finite; cut the log there or repair the sample"
            )
        );
    }
    assert_eq!(
        refusal(&with_line(10, "nan,1,0.5\n")),
        "bench.csv, line 10, column time_s: nan is not finite; cut the log there or repair the sample"
    );
}

#[test]
fn lost_rows_are_counted() {
    let mut rows = good(200);
    rows.drain(100..103);
    assert_eq!(
        refusal(&(HEADER.to_owned() + &rows.concat())),
        "bench.csv, line 102: 3 rows lost before it (row 100 should be here, the time jumps from 0.099 s to 0.103 s); record again or cut the log there"
    );
    let mut rows = good(200);
    rows.remove(1);
    assert_eq!(
        refusal(&(HEADER.to_owned() + &rows.concat())),
        "bench.csv, line 3: 1 row lost before it (row 1 should be here, the time jumps from 0 s to 0.002 s); record again or cut the log there"
    );
}

#[test]
fn time_that_repeats_or_runs_backwards_is_refused() {
    assert_eq!(
        refusal(&with_line(150, "0.147000,1,1\n")),
        "bench.csv, line 150: time is repeated: 0.147 s after 0.147 s; remove the row, or use --rate HZ in place of the time column"
    );
    assert_eq!(
        refusal(&with_line(150, "0.140000,1,1\n")),
        "bench.csv, line 150: time goes backwards: 0.14 s after 0.147 s; remove the row, or use --rate HZ in place of the time column"
    );
    let text = HEADER.to_owned() + &"1,2,3\n".repeat(20);
    assert_eq!(
        refusal(&text),
        "bench.csv, line 3: time is repeated: 1 s after 1 s; remove the row, or use --rate HZ in place of the time column"
    );
}

#[test]
fn time_off_the_grid_is_refused() {
    assert_eq!(
        refusal(&with_line(150, "0.148300,1,1\n")),
        "bench.csv, line 150: time 0.1483 s is 30.0 % of a sample off the uniform grid (1 % is allowed, plus the rounding of the printed time); resample the log, or use --rate HZ if only the time stamps jitter"
    );
    // One percent and the rounding of both ends (1 us in all) are allowed: 11 us off a grid that may itself lie up
    // to 11 us beside the other rows. So 10 us passes whatever the grid, 25 us none.
    let read = |text: &str| {
        let text = with_line(150, text);
        RowReader::from_csv(Path::new("x"), Cursor::new(text), &ReadOptions::default()).and_then(RowReader::into_log)
    };
    assert!(read("0.148010,1,1\n").is_ok());
    assert!(matches!(read("0.148025,1,1\n"), Err(LogError::NotUniform { .. })));
    // The way out that the message names.
    let options = ReadOptions { rate_hz: Some(1e3), ..ReadOptions::default() };
    let text = with_line(150, "0.148300,1,1\n");
    let log = RowReader::from_csv(Path::new("x"), Cursor::new(text), &options).and_then(RowReader::into_log);
    assert_eq!(log.expect("read").len(), 200);
}

#[test]
fn short_empty_and_headless_files_are_refused() {
    assert_eq!(refusal(&(HEADER.to_owned() + &good(2).concat())), "bench.csv: only 2 samples; at least 16 are needed");
    assert_eq!(refusal(HEADER), "bench.csv: only 0 samples; at least 16 are needed");
    assert_eq!(
        refusal(&(HEADER.to_owned() + &good(15).concat())),
        "bench.csv: only 15 samples; at least 16 are needed"
    );
    for text in ["", "\n\n", "# rate_hz: 5\n"] {
        assert_eq!(refusal(text), "bench.csv: is empty; a log has a header line and at least 16 samples");
    }
    assert_eq!(
        refusal(&good(20).concat()),
        "bench.csv, line 1: numbers (0.000000,0.5,0.25) where the header should be; add a first line with the column names"
    );
    assert_eq!(
        refusal(&with_line(90, "0.088000,1\n")),
        "bench.csv, line 90: 2 fields where the header has 3; the line is cut or has a stray separator"
    );
    // Only the very last line may be cut, and only where the file ends with it.
    assert_eq!(
        refusal(with_line(90, "0.088000,1\n").trim_end()),
        "bench.csv, line 90: 2 fields where the header has 3; the line is cut or has a stray separator"
    );
    assert_eq!(
        refusal(&(HEADER.to_owned() + &good(20).concat() + "0.020000,1\n")),
        "bench.csv, line 22: 2 fields where the header has 3; the line is cut or has a stray separator"
    );
}

#[test]
fn bad_metadata_is_refused_with_its_line() {
    for (line, rest) in [
        ("rate_hz: fast", "rate_hz: `fast` is not a rate above zero"),
        ("rate_hz: 0", "rate_hz: `0` is not a rate above zero"),
        ("hold: first", "hold: `first` is not zoh, foh or bandlimited"),
        ("latency_us: -3", "latency_us: `-3` is not a time of at least zero"),
        ("period_samples: 2.5", "period_samples: `2.5` is not a whole number above zero"),
    ] {
        let text = format!("# a remark\n# {line}\n{HEADER}{}", good(20).concat());
        assert_eq!(refusal(&text), format!("bench.csv, line 2: metadata {rest}; correct or remove it"));
    }
}

#[test]
fn wrong_calls_are_told_apart_from_wrong_files() {
    let mut options = ReadOptions::default();
    options.columns.insert("volts".into(), "u".into());
    assert_eq!(
        refusal_with("", &options),
        "--columns: `volts` is no column of a log; use one of time, command, displacement, reference, drive, force, current, temperature, limited_by, seq"
    );
    let mut options = ReadOptions::default();
    options.scale.insert("force".into(), 0.0);
    assert_eq!(refusal_with("", &options), "--scale force: 0 cannot be used; give a finite number other than zero");
    let options = ReadOptions { rate_hz: Some(-5.0), ..ReadOptions::default() };
    let error = log::open(Path::new("none.csv"), &options).expect_err("refused");
    assert_eq!(one_line(&error), "--rate: -5 cannot be used; give a finite number above zero");
    assert!(error.is_wrong_call());
    assert!(!log::open(Path::new("none.csv"), &ReadOptions::default()).expect_err("refused").is_wrong_call());
}

#[test]
fn files_that_cannot_be_opened_say_why() {
    let read = |path: &Path| one_line(&log::read(path, &ReadOptions::default()).expect_err("refused"));
    assert_eq!(read(Path::new("none/none.csv")), "none/none.csv: no such file; check the path");
    assert_eq!(
        read(Path::new(env!("CARGO_MANIFEST_DIR"))),
        format!("{}: is a directory; name a log file in it", env!("CARGO_MANIFEST_DIR"))
    );
    let denied = LogError::NoPermission { path: "a.csv".into() };
    assert_eq!(one_line(&denied), "a.csv: no permission to read it; check owner and mode");
}

#[test]
#[cfg(unix)]
fn a_file_that_may_not_be_read_says_so() {
    use std::os::unix::fs::PermissionsExt as _;
    let path = std::env::temp_dir().join(format!("log_bad_input-{}.csv", std::process::id()));
    std::fs::write(&path, "x").expect("written");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o000)).expect("set");
    let result = log::read(&path, &ReadOptions::default());
    let may_read_all = std::fs::File::open(&path).is_ok();
    std::fs::remove_file(&path).expect("removed");
    let message = one_line(&result.expect_err("refused"));
    if may_read_all {
        println!("not run: permission check, absent for the superuser");
        assert!(message.contains("no column"), "{message}");
    } else {
        assert_eq!(message, format!("{}: no permission to read it; check owner and mode", path.display()));
    }
}

#[test]
fn binary_garbage_is_not_text() {
    let read = |bytes: Vec<u8>| {
        let result = RowReader::from_csv(Path::new("bench.csv"), Cursor::new(bytes), &ReadOptions::default());
        one_line(&result.expect_err("refused"))
    };
    assert_eq!(
        read(vec![0x7f, b'E', b'L', b'F', 2, 1, 1, 0]),
        "bench.csv: is not a text file (a control byte at byte 4); logs are CSV, NPY or MAT v5"
    );
    assert_eq!(
        read(b"x".repeat(1 << 20)),
        "bench.csv: is not a text file (a line without end at byte 65536); logs are CSV, NPY or MAT v5"
    );
    assert_eq!(
        read(b"\xff\xfet\0i\0m\0e\0".to_vec()),
        "bench.csv: is not a text file (UTF-16, save it as UTF-8 at byte 0); logs are CSV, NPY or MAT v5"
    );
}

/// An NPY file with this header text.
fn npy(header: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend_from_slice(&(header.len() as u16).to_le_bytes());
    bytes.extend_from_slice(header.as_bytes());
    bytes.extend_from_slice(data);
    bytes
}

fn npy_refusal(bytes: Vec<u8>) -> String {
    let mut options = ReadOptions { rate_hz: Some(1e3), ..ReadOptions::default() };
    options.columns.insert("command".into(), "0".into());
    options.columns.insert("displacement".into(), "1".into());
    let result = RowReader::from_npy(Path::new("a.npy"), Cursor::new(bytes), &options).and_then(RowReader::into_log);
    one_line(&result.expect_err("refused"))
}

#[test]
fn npy_files_that_are_no_tables_are_refused() {
    let shaped =
        |shape: &str| npy(&format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n"), &[0; 800]);
    let advice = "save one realization as (samples, columns), or as a structured array with one field per column";
    assert_eq!(npy_refusal(shaped("(5, 4, 3)")), format!("a.npy: the array has shape (5, 4, 3); {advice}"));
    assert_eq!(npy_refusal(shaped("(100,)")), format!("a.npy: the array has shape (100,); {advice}"));
    assert_eq!(
        npy_refusal(shaped("(100, 1)")),
        "a.npy: no column `1` (displacement); it has columns 0 to 0 without names; map one with --columns displacement=NAME"
    );
    assert_eq!(
        npy_refusal(shaped("(60, 2)")),
        "a.npy: broken NPY file: it ends after sample 50 of 60; save it again with numpy.save"
    );
    assert_eq!(npy_refusal(shaped("(10, 2)")), "a.npy: only 10 samples; at least 16 are needed");
    let complex = npy("{'descr': '<c16', 'fortran_order': False, 'shape': (20, 2), }\n", &[0; 640]);
    assert_eq!(npy_refusal(complex), "a.npy, column 0: '<c16' is not a real number type; save it as float64");
    let mut nan = shaped("(50, 2)");
    let at = nan.len() - 8;
    nan[at..].copy_from_slice(&f64::NAN.to_le_bytes());
    assert_eq!(
        npy_refusal(nan),
        "a.npy, sample 49, column 1: NaN is not finite; cut the log there or repair the sample"
    );
    // What would overflow the stack, a product or the memory of the library's header parser.
    for header in [
        "(".repeat(10_000),
        format!("{}1", "-".repeat(16_000)),
        "{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296, 4294967296), }".into(),
        "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 18446744073709551615, 18446744073709551615), }".into(),
        "{'descr': [('a', '<f8', (4294967296, 4294967296, 4294967296))], 'fortran_order': False, 'shape': (20,), }".into(),
        "{'descr': '<U9223372036854775807', 'fortran_order': True, 'shape': (20, 2), }".into(),
        "{'descr': '<f8', 'fortran_order': False, 'shape': (20, -2), }".into(),
        "{'descr': [('a', '|S9223372036854775807'), ('b', '|S9223372036854775807')], 'fortran_order': False, 'shape': (20,), }".into(),
        "{'descr': '<f8', 'fortran_order': False, 'shape': (0x10, 2), }".into(),
        "{'descr': '<f99999999999', 'fortran_order': True, 'shape': (281474976710, 2), }".into(),
        "{'descr': '<f8', 'fortran_order': True, 'shape': (28147497671065, 2), }".into(),
    ] {
        let message = npy_refusal(npy(&header, &[0; 64]));
        assert!(message.starts_with("a.npy"), "{message}");
    }
}

/// A small MAT file of a log, and what it is read with.
fn mat_bytes() -> Vec<u8> {
    let n = 40;
    let log = Log {
        dt_s: 1e-3,
        command_v: (0..n).map(|k| f64::from(k) * 0.1).collect(),
        displacement_m: (0..n).map(|k| f64::from(k) * 1e-7).collect(),
        ..Log::default()
    };
    static N_FILES: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
    let n = N_FILES.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
    let path = std::env::temp_dir().join(format!("log_bad_input-{}-{n}.mat", std::process::id()));
    log::write(&path, &log).expect("written");
    let bytes = std::fs::read(&path).expect("there");
    std::fs::remove_file(&path).expect("removed");
    bytes
}

fn read_mat(bytes: &[u8], command: &str, displacement: &str) -> Result<Log, LogError> {
    let mut options = ReadOptions::default();
    options.columns.insert("command".into(), command.into());
    options.columns.insert("displacement".into(), displacement.into());
    RowReader::from_mat(Path::new("a.mat"), bytes, &options).and_then(RowReader::into_log)
}

#[test]
fn mat_files_that_are_no_logs_are_refused() {
    let good = mat_bytes();
    let refusal =
        |bytes: &[u8], command: &str| one_line(&read_mat(bytes, command, "displacement_um").expect_err("refused"));
    assert!(read_mat(&good, "command_V", "displacement_um").is_ok());
    assert_eq!(
        refusal(&good, "u"),
        "a.mat: no column `u` (command); it has rate_hz, hold, time_s, command_V, displacement_um; map one with --columns command=NAME"
    );
    assert_eq!(refusal(&good, "hold"), "a.mat, variable hold: is text, not a real vector; save one vector per column");
    assert_eq!(refusal(&good, "rate_hz"), "a.mat: time_s has 40 samples and rate_hz has 1; a log needs equal lengths");
    assert_eq!(
        refusal(&good[..good.len() - 9], "command_V"),
        format!("a.mat: broken MAT file: an element longer than the file at byte {}; save it again", good.len() - 384)
    );
    let mut hdf = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".to_vec();
    hdf.resize(600, 0);
    assert_eq!(refusal(&hdf, "command_V"), "a.mat: is a MAT v7.3 (HDF5) file; save it in MATLAB with save(..., '-v7')");
    assert_eq!(refusal(b"junk", "command_V"), "a.mat: broken MAT file: no MAT v5 header at byte 4; save it again");
}

#[test]
fn no_flipped_byte_and_no_cut_of_a_mat_file_panics() {
    for (bytes, command, displacement) in [
        (mat_bytes(), "command_V", "displacement_um"),
        (include_bytes!("data/small-capture.mat").to_vec(), "u", "y"),
        (include_bytes!("data/small-capture-compressed.mat").to_vec(), "u", "y"),
    ] {
        assert!(read_mat(&bytes, command, displacement).is_ok());
        let mut n_refused = 0;
        for at in 0..bytes.len() {
            n_refused += u32::from(read_mat(&bytes[..at], command, displacement).is_err());
            for bit in 0..8 {
                let mut flipped = bytes.clone();
                flipped[at] ^= 1 << bit;
                if let Err(error) = read_mat(&flipped, command, displacement) {
                    one_line(&error);
                }
            }
        }
        // Every cut is seen, save one that falls into the padding of the last element or between the variables.
        assert!(n_refused as usize > bytes.len() - 16, "{n_refused} of {}", bytes.len());
    }
}

#[test]
fn a_mistake_of_units_is_warned_of() {
    let log = |displacement_m: f64, command_v: f64| Log {
        name: "a".into(),
        dt_s: 1e-3,
        command_v: (0..100).map(|k| command_v * (0.1 * f64::from(k)).sin()).collect(),
        displacement_m: (0..100).map(|k| displacement_m * (0.1 * f64::from(k)).sin()).collect(),
        ..Log::default()
    };
    let first = |log: &Log| log::warnings(log).into_iter().next().unwrap_or_default();
    assert_eq!(first(&log(20e-6, 90.0)), "");
    // Metres taken for micrometres and the reverse.
    assert!(first(&log(20e-12, 90.0)).starts_with("a: the displacement spans 39.9"));
    assert!(first(&log(20.0, 90.0)).contains("more than a piezo moves"));
    assert!(first(&log(20e-6, 90e3)).contains("is the file in mV?"));
    assert!(first(&log(20e-6, 0.0)).contains("nothing is excited"));
    assert!(first(&log(0.0, 90.0)).contains("is the sensor connected"));
    // The first rows of a longer log say nothing of all.
    let mut late = log(20e-6, 0.0);
    late.meta.latency_s = 5.0;
    assert!(first(&late).contains("nothing is excited") && log::warnings(&late).len() == 2);
    assert_eq!(log::warnings_of_head(&late), Vec::<String>::new());
    assert_eq!(log::warnings_of_head(&log(0.0, 90.0)), Vec::<String>::new());
    assert_eq!(log::warnings_of_head(&log(20.0, 90.0)).len(), 1);
    let mut clipped = log(20e-6, 90.0);
    for value in &mut clipped.displacement_m {
        *value = value.min(12e-6);
    }
    assert!(first(&clipped).contains("stands at its highest value for"), "{}", first(&clipped));
    // A quantised hold at the top is no clipping: the command stands still too.
    let mut held = log(20e-6, 90.0);
    for k in 50..100 {
        held.displacement_m[k] = 30e-6;
        held.command_v[k] = 130.0;
    }
    assert_eq!(first(&held), "");
    let mut jumps = log(20e-6, 90.0);
    jumps.seq = Some((0..100).map(|k| f64::from(k + 3 * (k / 40))).collect());
    assert!(first(&jumps).contains("jumps 2 times, first after row 39"), "{}", first(&jumps));
}

/// Bytes that get past the first checks: a good file with a stretch replaced.
fn mutated(good: Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    (0..good.len(), prop::collection::vec(any::<u8>(), 0..24), any::<bool>()).prop_map(move |(at, noise, cut)| {
        let mut bytes = good.clone();
        let end = (at + noise.len()).min(bytes.len());
        bytes.splice(at..end, noise);
        if cut {
            bytes.truncate(at + 12);
        }
        bytes
    })
}

/// Reads bytes as each of the three formats; whatever happens, it is a value or one line.
fn read_all(bytes: &[u8]) {
    let mut mapped = ReadOptions { rate_hz: Some(1e3), ..ReadOptions::default() };
    mapped.columns.insert("command".into(), "0".into());
    mapped.columns.insert("displacement".into(), "1".into());
    for options in [ReadOptions::default(), mapped] {
        let name = Path::new("x");
        let owned = || Cursor::new(bytes.to_vec());
        for result in [
            RowReader::from_csv(name, owned(), &options),
            RowReader::from_npy(name, owned(), &options),
            RowReader::from_mat(name, owned(), &options),
        ] {
            match result.and_then(RowReader::into_log) {
                Ok(log) => {
                    assert!(log.len() >= 16 && log.dt_s > 0.0);
                    log::warnings(&log);
                }
                Err(error) => {
                    one_line(&error);
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        read_all(&bytes);
    }

    #[test]
    fn no_broken_csv_panics(bytes in mutated((HEADER.to_owned() + &good(30).concat()).into_bytes())) {
        read_all(&bytes);
    }

    #[test]
    fn no_odd_times_panic(times in prop::collection::vec("-?[0-9]{1,3}(\\.[0-9]{0,9})?(e-?[0-9]{1,5})?", 16..40)) {
        let text = times.iter().fold(HEADER.to_owned(), |text, time| text + time + ",1,2\n");
        read_all(text.as_bytes());
    }

    #[test]
    fn no_broken_npy_panics(bytes in mutated(npy(
        "{'descr': [('time_s', '<f8'), ('command_V', '>i2'), ('displacement_um', '<f4', (1,))], 'fortran_order': False, 'shape': (20,), }          \n",
        &[1; 400],
    ))) {
        read_all(&bytes);
    }

    #[test]
    fn no_broken_npy_table_panics(bytes in mutated(npy(
        "{'descr': '<f4', 'fortran_order': True, 'shape': (20, 3), }          \n",
        &[1; 240],
    ))) {
        read_all(&bytes);
    }

    #[test]
    fn no_broken_mat_panics(bytes in mutated(mat_bytes())) {
        read_all(&bytes);
    }
}
