//! Logs that are written come back; files of other programs are read as those programs meant them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use plant_sim::log::{self, Column, Hold, Log, LogError, Meta, ReadOptions, RowReader, Writer};
use proptest::prelude::*;

/// A directory of this test, removed at its end.
struct Scratch(PathBuf);

impl Scratch {
    fn new(test: &str) -> Self {
        let path = std::env::temp_dir().join(format!("log_round_trip-{}-{test}", std::process::id()));
        fs::create_dir_all(&path).expect("a scratch directory");
        Self(path)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// What a file has beside a log is named, whatever kind of file it is.
#[test]
fn columns_that_are_not_read_are_named() {
    let scratch = Scratch::new("others");
    let log = full_log(40, 1000.0);
    for name in ["a.csv", "a.npy", "a.mat"] {
        let path = scratch.0.join(name);
        log::write(&path, &log).unwrap();
        assert_eq!(log::read(&path, &ReadOptions::default()).unwrap().others, Vec::<String>::new(), "{name}");
        let by_rate = ReadOptions { rate_hz: Some(1000.0), ..ReadOptions::default() };
        assert_eq!(log::read(&path, &by_rate).unwrap().others, ["time_s"], "{name}");
    }
}

/// A log with every column, every metadata key, and numbers that do not end in decimal.
fn full_log(n: u32, rate_hz: f64) -> Log {
    let wave =
        |scale: f64, phase: f64| -> Vec<f64> { (0..n).map(|k| scale * (0.37 * f64::from(k) + phase).sin()).collect() };
    Log {
        name: String::new(),
        time_start_s: 0.125,
        dt_s: rate_hz.recip(),
        command_v: wave(90.0, 0.1),
        displacement_m: wave(21.9e-6, 0.2),
        reference_m: Some(wave(1e-9, 0.3)),
        drive_v: Some(wave(1e4, 0.4)),
        force_n: Some(wave(3.0, 0.5)),
        current_a: Some(wave(1e-3, 0.6)),
        temperature_c: Some(wave(25.0, 0.7)),
        limited_by: Some((0..n).map(|k| f64::from(k % 3)).collect()),
        seq: Some((0..n).map(f64::from).collect()),
        meta: Meta {
            rate_hz: Some(rate_hz),
            hold: Hold::Bandlimited,
            latency_s: 12.3e-6,
            adc_lsb_m: Some(1.1e-9),
            dac_lsb_v: Some(0.0061),
            period_samples: Some(200),
            run_in_s: Some(0.7),
            controller: Some("controllers/pi1.toml".into()),
            firmware: Some("0.10".into()),
            seed: Some("18446744073709551615".into()),
            other: BTreeMap::from([("rig".into(), "left: bench".into()), ("run".into(), "007".into())]),
        },
        others: Vec::new(),
    }
}

#[test]
fn csv_gives_back_the_same_bits() {
    let scratch = Scratch::new("csv");
    for rate_hz in [1e4, 3e4, 750.0, 1e6, 44_100.0] {
        let mut log = full_log(1000, rate_hz);
        let path = scratch.file("log.csv");
        log::write(&path, &log).expect("written");
        log.name = path.display().to_string();
        assert_eq!(log::read(&path, &ReadOptions::default()).expect("read"), log);
    }
}

#[test]
fn npy_and_mat_give_back_all_but_the_last_bit() {
    let scratch = Scratch::new("binary");
    for extension in ["npy", "mat"] {
        let mut log = full_log(500, 1e4);
        let path = scratch.file(&format!("log.{extension}"));
        log::write(&path, &log).expect("written");
        let mut back = log::read(&path, &ReadOptions::default()).expect("read");
        // Times are stored in full, and the interval is 1/rate where the rate is known; NPY has no metadata.
        if extension == "npy" {
            assert_eq!(back.meta, Meta::default());
            assert!((back.dt_s / log.dt_s - 1.0).abs() < 1e-13);
            back.dt_s = log.dt_s;
            back.meta = log.meta.clone();
        }
        // To micrometres and back rounds twice, each by at most 2^-53 of the value.
        for (ours, theirs) in [
            (&mut log.displacement_m, &back.displacement_m),
            (log.reference_m.as_mut().expect("there"), back.reference_m.as_ref().expect("there")),
        ] {
            for (ours, theirs) in ours.iter_mut().zip(theirs) {
                assert!((*ours - theirs).abs() <= 2.3e-16 * ours.abs(), "{ours} {theirs}");
                *ours = *theirs;
            }
        }
        log.name = path.display().to_string();
        assert_eq!(back, log);
    }
}

#[test]
fn rows_written_one_by_one_appear_only_when_finished() {
    let scratch = Scratch::new("staged");
    let path = scratch.file("out.csv");
    let columns = [Column::Time, Column::Displacement, Column::Predicted];
    let meta = Meta { rate_hz: Some(2e4), ..Meta::default() };
    let mut writer = Writer::create(&path, &meta, &columns).expect("created");
    writer.row(&[0.0, 1.5e-6, -2e-9]).expect("a row");
    writer.row(&[5e-5, 0.0, 1e-3]).expect("a row");
    assert!(!path.exists());
    writer.finish().expect("finished");
    assert_eq!(
        fs::read_to_string(&path).expect("there"),
        "# rate_hz: 20000\n# hold: zoh\ntime_s,displacement_um,predicted_um\n0.00000,1.5,-0.002\n0.00005,0,1000\n"
    );

    // Given up half-way, by the program or by a bad value, the old file stays and nothing else does.
    let mut writer = Writer::create(&path, &meta, &columns).expect("created");
    let message = writer.row(&[0.0, f64::NAN, 0.0]).expect_err("refused").to_string();
    assert!(message.contains("sample 0, column displacement_um: NaN is not finite"), "{message}");
    assert!(writer.row(&[0.0, 0.0, 0.0]).is_err());
    assert!(writer.finish().is_err());
    drop(Writer::create(&path, &meta, &columns).expect("created"));
    let left: Vec<_> = fs::read_dir(&scratch.0).expect("there").collect();
    assert_eq!(left.len(), 1);
    assert!(fs::read_to_string(&path).expect("there").contains("1.5,-0.002"));
}

#[test]
fn a_live_log_is_read_while_it_is_written_and_replaces_nothing() {
    let folder = Scratch::new("live");
    let path = folder.file("live.csv");
    let meta = Meta { rate_hz: Some(1e4), ..Meta::default() };
    let columns = [Column::Time, Column::Command, Column::Displacement];
    let mut writer = Writer::create_live(&path, &meta, &columns).expect("created");
    for k in 0..200 {
        writer.row(&[f64::from(k) * 1e-4, 1.0, 1e-6 * f64::from(k)]).expect("a row");
        if k == 149 {
            writer.flush().expect("flushed");
        }
    }
    // As a program that is killed here leaves it.
    let rows = log::read(&path, &ReadOptions::default()).expect("readable");
    assert_eq!((rows.len(), rows.displacement_m[149]), (150, 149e-6));
    drop(writer);
    assert!(Writer::create_live(&path, &meta, &columns).is_err());
    assert!(log::read(&path, &ReadOptions::default()).expect("still there").len() >= 150);
}

#[test]
fn an_output_that_cannot_be_written_is_said_in_one_line() {
    let scratch = Scratch::new("unwritable");
    let path = scratch.file("none/out.csv");
    let message = log::write(&path, &full_log(20, 1e3)).expect_err("refused").to_string();
    assert_eq!(
        message,
        format!(
            "{}: cannot be written: No such file or directory (os error 2); nothing was left there, name another place with --out",
            path.display()
        )
    );
    let directory = log::write(&scratch.0.join("a.csv"), &full_log(20, 1e3));
    assert!(directory.is_ok());
    fs::create_dir(scratch.file("d.csv")).expect("made");
    let message = log::write(&scratch.file("d.csv"), &full_log(20, 1e3)).expect_err("refused");
    assert!(message.to_string().ends_with("is a directory; name a log file in it"));
    let message = log::write(&scratch.file("a.xls"), &full_log(20, 1e3)).expect_err("refused");
    assert!(message.is_wrong_call());
}

#[test]
fn csv_of_other_programs_is_tolerated() {
    let rows = |separator: &str, end: &str| -> String {
        (0..20)
            .map(|k| format!(" {}{separator}\"{k}\"{separator} 1.5e0 {separator}note{end}", f64::from(k) * 0.005))
            .collect()
    };
    let options = ReadOptions {
        columns: BTreeMap::from([
            ("time".into(), "t".into()),
            ("command".into(), "u, volts".into()),
            ("displacement".into(), "y_nm".into()),
        ]),
        ..ReadOptions::default()
    };
    let quoted = |separator: &str| {
        format!("\u{feff}# firmware: 7\n#\n# remark\n\n t{separator}\"u, volts\"{separator}y_nm{separator}x")
    };
    for (separator, end) in [(",", "\r\n"), (",", "\r"), (",", ",\n")] {
        let text = quoted(separator) + end + &rows(separator, end) + ",,,\r\n\r\n";
        let log = RowReader::from_csv(Path::new("x"), std::io::Cursor::new(text), &options)
            .and_then(RowReader::into_log)
            .unwrap_or_else(|error| panic!("{end:?}: {error}"));
        assert_eq!((log.len(), log.displacement_m[3], log.command_v[3]), (20, 1.5e-9, 3.0));
        assert_eq!(log.meta.firmware.as_deref(), Some("7"));
        assert!((log.dt_s - 0.005).abs() < 1e-16);
    }
    for separator in [";", "\t"] {
        let mut options = options.clone();
        options.columns.insert("command".into(), "u".into());
        // The last line without its end.
        let text = format!("t{separator}u{separator}y_nm{separator}x\n{}", rows(separator, "\n"));
        let log = RowReader::from_csv(Path::new("x"), std::io::Cursor::new(text.trim_end().to_owned()), &options)
            .and_then(RowReader::into_log)
            .expect("read");
        assert_eq!(log.len(), 20);
    }
}

/// What writes a log may be killed in the middle of a write, and the system then keeps a part of it.
#[test]
fn a_last_row_that_a_kill_cut_off_is_left_out() {
    let rows = (0..40).fold(String::new(), |text, k| text + &format!("{:.3},{k},0.5,7\n", 1e-3 * f64::from(k)));
    let text = format!("time_s,command_V,displacement_um,limited_by\n{rows}");
    let last = text.trim_end().rfind('\n').expect("rows") + 1;
    for end in last..text.len() {
        let log =
            RowReader::from_csv(Path::new("x"), std::io::Cursor::new(text[..end].to_owned()), &ReadOptions::default())
                .and_then(RowReader::into_log)
                .unwrap_or_else(|error| panic!("{:?}: {error}", &text[last..end]));
        // Whole once its last cell has begun.
        let is_whole = text[last..end].matches(',').count() == 3 && !text[..end].ends_with(',');
        assert_eq!(log.len(), if is_whole { 40 } else { 39 }, "{:?}", &text[last..end]);
    }
}

#[test]
fn units_come_from_the_name_and_the_option_goes_before_it() {
    let read = |name: &str, scale: Option<f64>| {
        let text = (0..20).fold(format!("command_V,{name}\n"), |text, k| text + &format!("{k},2\n"));
        let mut options = ReadOptions { rate_hz: Some(1e3), ..ReadOptions::default() };
        options.columns.insert("displacement".into(), name.into());
        if let Some(scale) = scale {
            options.scale.insert("displacement".into(), scale);
        }
        let log = RowReader::from_csv(Path::new("x"), std::io::Cursor::new(text), &options)?.into_log()?;
        assert_eq!(log.dt_s, 1e-3);
        Ok::<f64, LogError>(log.displacement_m[0])
    };
    // A unit that is none of metres is not taken for micrometres.
    let refused = read("pos_cm", None).expect_err("centimetres").to_string();
    assert!(
        refused.contains("cm is no unit of this that is known by its name")
            && refused.contains("--scale displacement=")
    );
    assert!(read("sensor [V]", None).is_err() && read("y_counts", None).is_err());
    assert_eq!(read("pos_cm", Some(1e-2)).expect("read"), 2e-2);
    let read = |name: &str, scale: Option<f64>| read(name, scale).expect("read");
    assert_eq!(read("y", None), 2e-6);
    assert_eq!([read("y [ nm ]", None), read("y (m)", None), read("y [filtered]", None)], [2e-9, 2.0, 2e-6]);
    assert_eq!(read("y_um", None), 2e-6);
    assert_eq!(read("y_m", None), 2.0);
    assert_eq!(read("y_mm", None), 2e-3);
    assert_eq!(read("y_nm", None), 2e-9);
    assert_eq!(read("y_alarm", None), 2e-6);
    assert_eq!(read("y_nm", Some(1e-6)), 2e-6);
    assert_eq!(read("y_nm", Some(-2.5e-6)), -5e-6);
}

/// A log whose column for `key` is called `name`: 20 rows of k, k, 2, 3 and 4.
fn with_name(key: &str, name: &str) -> Result<Log, LogError> {
    let usual = [("time", "t"), ("command", "u"), ("displacement", "y"), ("force", "f"), ("current", "i")];
    let named = usual.map(|(of, usual)| (of, if of == key { name } else { usual }));
    let mut options = ReadOptions::default();
    for (of, name) in named {
        options.columns.insert(of.into(), name.into());
    }
    let header = named.map(|(_, name)| name).join(",");
    let text = (0..20).fold(format!("{header}\n"), |text, k| text + &format!("{k},{k},2,3,4\n"));
    RowReader::from_csv(Path::new("x"), std::io::Cursor::new(text), &options)?.into_log()
}

#[test]
fn a_unit_of_another_quantity_or_of_no_sure_size_is_refused() {
    let refused: [(&str, &[&str]); 5] = [
        ("command", &["target_um", "x_mm", "coil_A", "u [mA]", "load_N", "U_MV", "TARGET_UM", "u_COUNTS"]),
        ("displacement", &["coil_A", "Y_NM", "POS_MM", "Y_M", "Y_MV", "POS_CM"]),
        ("force", &["load_V", "load_mV", "F_KN", "f_um"]),
        ("current", &["i_V", "I_MA"]),
        ("time", &["n_samples", "t_ticks", "T_MS", "T_MIN", "x_um"]),
    ];
    for (key, names) in refused {
        for name in names {
            let error = with_name(key, name).expect_err(name);
            let said = error.to_string();
            assert!(error.is_wrong_call() && said.contains("is no unit of this that is known by its name"), "{said}");
            assert!(said.contains(&format!("--columns {key}={name}: ")), "{said}");
        }
    }
    // No unit, or the contract's own.
    for name in ["u_v", "u_a", "u_ma", "u_pressure", "U_V"] {
        assert_eq!(with_name("command", name).expect(name).command_v[3], 3.0, "{name}");
    }
    for name in ["Y_UM", "y_alarm", "y_v", "y \u{3bc}m", "y_\u{b5}m", "y_\u{3bc}m"] {
        assert_eq!(with_name("displacement", name).expect(name).displacement_m[3], 2e-6, "{name}");
    }
    assert_eq!(with_name("force", "F_n").expect("newtons").force_n.expect("there")[3], 3.0);
    assert_eq!(with_name("current", "i_mA").expect("milliamperes").current_a.expect("there")[3], 4e-3);
    for (name, dt_s) in [("t_sec", 1.0), ("t_msec", 1e-3), ("t [usec]", 1e-6), ("t_nsec", 1e-9), ("t_ms", 1e-3)] {
        let log = with_name("time", name).expect(name);
        assert!((log.dt_s / dt_s - 1.0).abs() < 1e-12, "{name}: {}", log.dt_s);
    }
}

/// An amplifier's monitor that is taken for the command is not its own measurement as well.
#[test]
fn a_column_that_stands_for_another_is_not_also_itself() {
    let scratch = Scratch::new("taken");
    let log = full_log(40, 1000.0);
    for name in ["a.csv", "a.npy", "a.mat"] {
        let path = scratch.file(name);
        log::write(&path, &log).expect("written");
        let mut options = ReadOptions::default();
        options.columns.insert("command".into(), "drive_V".into());
        let back = log::read(&path, &options).expect("read");
        assert_eq!((Some(&back.command_v), &back.drive_v), (log.drive_v.as_ref(), &None), "{name}");
        assert_eq!(back.others, ["command_V"], "{name}");
        options.columns.insert("drive".into(), "drive_V".into());
        assert_eq!(log::read(&path, &options).expect("read").drive_v, log.drive_v, "{name}");
    }
}

#[test]
fn a_stated_rate_is_taken_where_the_times_agree_with_it() {
    let read = |rate_hz: f64, step_s: f64| {
        let text = (0..200).fold(format!("# rate_hz: {rate_hz}\ntime_s,command_V,displacement_um\n"), |text, k| {
            text + &format!("{:.6},{k},{k}\n", f64::from(k) * step_s)
        });
        RowReader::from_csv(Path::new("x"), std::io::Cursor::new(text), &ReadOptions::default())
            .and_then(RowReader::into_log)
            .expect("read")
    };
    // 33.3 us in steps of 1 us: the rate is better than what the times say.
    assert_eq!(read(3e4, 1.0 / 3e4).dt_s, 1.0 / 3e4);
    let off = read(3e4, 1.0 / 2e4);
    assert!((off.dt_s - 5e-5).abs() < 1e-18);
    assert!(log::warnings(&off)[0].starts_with("x: rate_hz says 30000 Hz, the times say 20000"));
    // A rate that is given goes before both.
    let text =
        (0..20).fold("# rate_hz: 1000\ncommand_V,displacement_um\n".to_owned(), |text, k| text + &format!("{k},{k}\n"));
    let options = ReadOptions { rate_hz: Some(2e4), ..ReadOptions::default() };
    let log = RowReader::from_csv(Path::new("x"), std::io::Cursor::new(text), &options).and_then(RowReader::into_log);
    let log = log.expect("read");
    assert_eq!((log.dt_s, log.meta.rate_hz, log::warnings(&log)), (5e-5, Some(2e4), Vec::new()));
}

#[test]
fn a_controldesk_capture_is_read() {
    // Written by another program's code: `benches/tests/mat_oracle.rs`.
    for name in ["capture", "capture-compressed", "capture-without-axis-compressed"] {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data")).join(format!("{name}.mat"));
        let mut options = ReadOptions::default();
        options.columns.insert("command".into(), "u_V".into());
        options.columns.insert("displacement".into(), "Model Root/Sensor/y_um".into());
        let log = log::read(&path, &options).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((log.len(), log.command_v[3], log.displacement_m[4]), (40, 6.0, 2e-6));
        assert!((log.dt_s - 1e-3).abs() < 1e-17);
        assert_eq!(log.others, ["Model Root/Other/y_um", "Model Root/temperature"]);

        options.columns.insert("displacement".into(), "y_um".into());
        let message = log::read(&path, &options).expect_err("two").to_string();
        assert!(message.contains("2 columns answer to `y_um` (displacement)"), "{message}");
        options.columns.insert("displacement".into(), "temperature".into());
        let message = log::read(&path, &options).expect_err("rasters").to_string();
        assert!(message.contains("temperature and u_V were captured in different rasters"), "{message}");
        options.columns.insert("displacement".into(), "z".into());
        let message = log::read(&path, &options).expect_err("missing").to_string();
        assert!(
            message.contains("no column `z` (displacement); it has Model Root/Drive/u_V, Model Root/Sensor/y_um"),
            "{message}"
        );
    }
}

/// An element of MAT v5: its type, its length, its data padded to eight bytes.
fn mat_element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    bytes.extend_from_slice(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// An array of MAT v5: its class, dimensions and name, and the elements of what it holds.
fn mat_array(class: u8, dims: [i32; 2], name: &str, content: Vec<u8>) -> Vec<u8> {
    let flags = mat_element(6, &[class, 0, 0, 0, 0, 0, 0, 0]);
    let dims = mat_element(5, &dims.map(i32::to_le_bytes).concat());
    let name = mat_element(1, name.as_bytes());
    mat_element(14, &[flags, dims, name, content].concat())
}

fn mat_real(numbers: &[f64]) -> Vec<u8> {
    let data: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    mat_array(6, [numbers.len() as i32, 1], "", mat_element(9, &data))
}

fn mat_text(text: &str) -> Vec<u8> {
    mat_array(4, [1, text.len() as i32], "", mat_element(16, text.as_bytes()))
}

/// Structures in a row: of each one the arrays in its fields.
fn mat_structure(name: &str, fields: &[&str], elements: Vec<Vec<Vec<u8>>>) -> Vec<u8> {
    let mut names = Vec::new();
    for field in fields {
        let end = names.len() + 32;
        names.extend_from_slice(field.as_bytes());
        names.resize(end, 0);
    }
    let n = elements.len() as i32;
    let values = elements.concat().concat();
    let content = [mat_element(5, &32i32.to_le_bytes()), mat_element(1, &names), values].concat();
    mat_array(2, [1, n], name, content)
}

/// A capture without a time axis, 40 samples of 50 us each, of signals by name, path and unit; each counts its samples.
fn capture(signals: &[[&str; 3]], downsampling: Option<f64>) -> Vec<u8> {
    let ramp: Vec<f64> = (0..40).map(f64::from).collect();
    let signal =
        |of: &[&str; 3]| vec![mat_text(of[0]), mat_text(of[1]), mat_text(of[2]), mat_real(&ramp), mat_real(&[1.0])];
    let y = mat_structure("", &["Name", "Path", "Unit", "Data", "XIndex"], signals.iter().map(signal).collect());
    let x = mat_structure("", &["Data", "Raster"], vec![vec![mat_real(&[]), mat_text("HostService")]]);
    let mut facts = vec![mat_real(&[5e-5])];
    facts.extend(downsampling.map(|n| mat_real(&[n])));
    let names = ["SamplingPeriod", "Downsampling"];
    let facts = mat_structure("", &names[..facts.len()], vec![facts]);
    let mut bytes = vec![b' '; 124];
    bytes[..19].copy_from_slice(b"MATLAB 5.0 MAT-file");
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend(mat_structure("cap", &["X", "Y", "Capture"], vec![vec![x, y, facts]]));
    bytes
}

fn read_capture(bytes: &[u8], columns: [(&str, &str); 2], scale: Option<f64>) -> Result<Log, LogError> {
    let mut options = ReadOptions::default();
    for (key, name) in columns {
        options.columns.insert(key.into(), name.into());
    }
    options.scale.extend(scale.map(|scale| ("displacement".to_owned(), scale)));
    RowReader::from_mat(Path::new("a.mat"), bytes, &options)?.into_log()
}

#[test]
fn a_capture_that_keeps_every_so_many_samples_is_that_much_slower() {
    let columns = [("command", "u"), ("displacement", "y")];
    let read = |downsampling: Option<f64>| {
        read_capture(&capture(&[["u", "Root", ""], ["y", "Root", ""]], downsampling), columns, None)
    };
    for (downsampling, dt_s) in [(None, 5e-5), (Some(1.0), 5e-5), (Some(4.0), 2e-4)] {
        let log = read(downsampling).expect("read");
        assert!((log.dt_s / dt_s - 1.0).abs() < 1e-12 && log.len() == 40, "{downsampling:?}: {}", log.dt_s);
    }
    let said = read(Some(0.0)).expect_err("no interval").to_string();
    assert!(said.contains("(time)") && said.contains("give --rate HZ"), "{said}");
}

#[test]
fn the_unit_that_a_capture_states_counts_where_the_name_has_none() {
    let columns = [("command", "u"), ("displacement", "Root/Sensor/y")];
    let read = |units: [&str; 2], scale: Option<f64>| {
        let bytes = capture(&[["u", "Root/Drive", units[0]], ["y", "Root/Sensor", units[1]]], None);
        read_capture(&bytes, columns, scale).map(|log| (log.command_v[3], log.displacement_m[3]))
    };
    assert_eq!(read(["mV", "nm"], None).expect("read"), (3e-3, 3e-9));
    assert_eq!(read(["", "-"], None).expect("read"), (3.0, 3e-6));
    assert_eq!(read(["mV", "nm"], Some(1e-3)).expect("read"), (3e-3, 3e-3));
    let said = read(["V", "V"], None).expect_err("a sensor's volts").to_string();
    assert!(said.contains("displacement=Root/Sensor/y: V is no unit of this"), "{said}");
    // The name goes before it.
    let bytes = capture(&[["u_V", "Root", "mV"], ["y_um", "Root", "nm"]], None);
    let log = read_capture(&bytes, [("command", "u_V"), ("displacement", "y_um")], None).expect("read");
    assert_eq!((log.command_v[3], log.displacement_m[3]), (3.0, 3e-6));
}

#[test]
fn a_signal_that_stands_for_another_is_not_also_itself() {
    let bytes = capture(&[["drive_V", "Root/Amplifier", ""], ["y_um", "Root/Sensor", ""]], None);
    let columns = [("command", "Root/Amplifier/drive_V"), ("displacement", "y_um")];
    let log = read_capture(&bytes, columns, None).expect("read");
    assert_eq!((log.command_v[3], log.drive_v), (3.0, None));
}

#[test]
fn tables_of_numpy_are_read_by_index_in_both_orders() {
    use npyz::WriterBuilder as _;
    let write = |order: npyz::Order, values: &[f32]| {
        let mut bytes = Vec::new();
        let mut writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(&[20, 2])
            .order(order)
            .writer(&mut bytes)
            .begin_nd()
            .expect("begun");
        writer.extend(values.iter()).expect("written");
        writer.finish().expect("finished");
        bytes
    };
    let by_row: Vec<f32> = (0..20).flat_map(|k| [k as f32, 0.5 * k as f32]).collect();
    let by_column: Vec<f32> = (0..20).map(|k| k as f32).chain((0..20).map(|k| 0.5 * k as f32)).collect();
    let mut options = ReadOptions { rate_hz: Some(6400.0), ..ReadOptions::default() };
    options.columns.insert("command".into(), "0".into());
    options.columns.insert("displacement".into(), "1".into());
    for (order, values) in [(npyz::Order::C, by_row), (npyz::Order::Fortran, by_column)] {
        let log = RowReader::from_npy(Path::new("x"), std::io::Cursor::new(write(order, &values)), &options)
            .and_then(RowReader::into_log)
            .expect("read");
        assert_eq!((log.len(), log.command_v[7], log.displacement_m[7]), (20, 7.0, 3.5e-6));
        assert_eq!(log.dt_s, 1.0 / 6400.0);
    }
}

/// The measured data, kept beside the workspace and not in it.
fn data(name: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")).join(name);
    if path.exists() {
        return Some(path);
    }
    println!("not run: {} absent", path.display());
    None
}

#[test]
fn a_measured_csv_is_read() {
    let Some(path) = data("piezo-micromanipulator-dbo/clean_Model.csv") else {
        return;
    };
    let mut options = ReadOptions::default();
    for (key, name) in [("time", "t_s"), ("command", "u_V"), ("displacement", "y_um")] {
        options.columns.insert(key.into(), name.into());
    }
    let log = log::read(&path, &options).expect("read");
    assert_eq!((log.len(), log.time_start_s), (8027, 0.0));
    assert!((log.dt_s - 0.005).abs() < 1e-15);
    assert_eq!((log.command_v[1], log.displacement_m[1]), (1.856539, -120.154262e-6));
    assert_eq!(log::warnings(&log), Vec::<String>::new());
}

#[test]
fn a_benchmarks_mat_file_is_read() {
    let Some(path) = data("boucwen-benchmark/uval_multisine.mat") else {
        return;
    };
    // One variable per file there: it stands for both columns here.
    let mut options = ReadOptions { rate_hz: Some(750.0), ..ReadOptions::default() };
    for column in ["command", "displacement"] {
        options.columns.insert(column.into(), "uval_multisine".into());
    }
    let log = log::read(&path, &options).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(log.len(), 8192);
}

#[test]
fn a_four_dimensional_array_is_refused_with_the_way_out() {
    let Some(path) = data("fsm-cubespec/u_100mV_train.npy") else {
        return;
    };
    let options = ReadOptions { rate_hz: Some(6400.0), ..ReadOptions::default() };
    assert_eq!(
        log::read(&path, &options).expect_err("refused").to_string(),
        format!(
            "{}: the array has shape (8192, 3, 6, 2); save one realization as (samples, columns), or as a structured array with one field per column",
            path.display()
        )
    );
}

proptest! {
    /// Any finite numbers at all: a CSV loses nothing.
    #[test]
    fn csv_is_exact_for_any_number(values in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO, 16..40)) {
        let scratch = Scratch::new("any");
        // Below 1e-320 m a micrometre more than doubles the digits that an f64 has; above 1e300 m there is no um.
        let path = scratch.file("log.csv");
        let log = Log {
            dt_s: 1e-3,
            command_v: values.clone(),
            displacement_m: values,
            name: path.display().to_string(),
            meta: Meta { rate_hz: Some(1e3), ..Meta::default() },
            ..Log::default()
        };
        log::write(&path, &log).expect("written");
        let back = log::read(&path, &ReadOptions::default()).expect("read");
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(&back.displacement_m), bits(&log.displacement_m));
        prop_assert_eq!(bits(&back.command_v), bits(&log.command_v));
    }
}
