//! Logs in other programs' formats, read back by other code than wrote them and compared.
//!
//! CSV, NPY and MAT are in `log_round_trip.rs`, MAT by another library too. Parquet and MDF 4 run where they are built in:
//! `cargo test -p plant-sim --features parquet,mf4`.

use plant_sim::log::{Log, LogError, Meta, export};
use std::path::PathBuf;

fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("hysteron-export-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&path).expect("a temporary folder");
    path
}

/// More rows than one group holds.
fn log() -> Log {
    let n = 70_000;
    let wave = |scale: f64| (0..n).map(|k| scale * (f64::from(k) * 0.01).sin()).collect::<Vec<f64>>();
    let mut meta =
        Meta { rate_hz: Some(20e3), latency_s: 10e-6, controller: Some("pi1.toml".into()), ..Meta::default() };
    meta.other.insert("board".into(), "nucleo-g474re".into());
    Log {
        dt_s: 50e-6,
        command_v: wave(60.0),
        displacement_m: wave(90e-6),
        drive_v: Some(wave(59.0)),
        limited_by: Some(vec![0.0; n as usize]),
        meta,
        ..Log::default()
    }
}

#[test]
fn what_is_not_built_in_or_not_known_is_said_and_leaves_nothing() {
    let folder = folder("refused");
    let known = [("x.parquet", cfg!(feature = "parquet")), ("x.mf4", cfg!(feature = "mf4"))];
    for (name, _) in known.into_iter().filter(|(_, is_built)| !is_built) {
        let error = export(&folder.join(name), &log()).expect_err(name);
        assert!(matches!(error, LogError::NotBuilt { .. }) && error.is_wrong_call(), "{error}");
        assert!(error.to_string().contains("build it with --features"), "{error}");
    }
    assert!(matches!(export(&folder.join("x.tdms"), &log()), Err(LogError::UnknownKind { .. })));
    let broken = Log { drive_v: Some(vec![0.0; 3]), ..log() };
    assert!(export(&folder.join("x.csv"), &broken).is_err());
    assert_eq!(std::fs::read_dir(&folder).expect("there").count(), 0);
    std::fs::remove_dir_all(folder).expect("ours");
}

/// Names and values that a file must hold.
#[cfg(any(feature = "parquet", feature = "mf4"))]
fn expected(log: &Log) -> Vec<(&'static str, Vec<f64>)> {
    let um = |values: &[f64]| values.iter().map(|metres| metres * 1e6).collect();
    let limited = log.limited_by.clone().expect("set");
    let drive = log.drive_v.clone().expect("set");
    vec![
        ("time_s", (0..log.len()).map(|k| log.time_s(k)).collect()),
        ("command_V", log.command_v.clone()),
        ("displacement_um", um(&log.displacement_m)),
        ("drive_V", drive),
        ("limited_by", limited),
    ]
}

#[cfg(feature = "parquet")]
#[test]
fn parquet_holds_every_number_and_the_metadata() {
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;
    let (folder, log) = (folder("parquet"), log());
    let path = folder.join("log.parquet");
    export(&path, &log).expect("written");
    let reader = SerializedFileReader::new(std::fs::File::open(&path).expect("there")).expect("Parquet");
    let meta = reader.metadata().file_metadata();
    assert_eq!((meta.num_rows(), reader.num_row_groups()), (70_000, 2));
    let pairs = meta.key_value_metadata().expect("metadata");
    let value = |key: &str| pairs.iter().find(|pair| pair.key == key).and_then(|pair| pair.value.clone());
    assert_eq!(value("latency_us").as_deref(), Some("10"));
    assert_eq!(value("board").as_deref(), Some("nucleo-g474re"));
    let expected = expected(&log);
    let names: Vec<&str> = meta.schema().get_fields().iter().map(|field| field.name()).collect();
    assert_eq!(names, expected.iter().map(|(name, _)| *name).collect::<Vec<_>>());
    for (k, row) in reader.get_row_iter(None).expect("rows").enumerate() {
        let row = row.expect("a row");
        for (column, (_, values)) in expected.iter().enumerate() {
            assert_eq!(row.get_double(column).expect("a number"), values[k]);
        }
    }
    std::fs::remove_dir_all(folder).expect("ours");
}

#[cfg(feature = "mf4")]
#[test]
fn mf4_holds_every_number_and_the_metadata() {
    use mdf4_rs::{DecodedValue, MDF};
    let (folder, log) = (folder("mf4"), log());
    let path = folder.join("log.mf4");
    export(&path, &log).expect("written");
    let file = MDF::from_file(path.to_str().expect("text")).expect("MDF 4");
    let groups = file.channel_groups();
    assert_eq!(groups.len(), 1);
    let comment = groups[0].comment().expect("readable").expect("a comment");
    assert!(comment.contains("latency_us: 10\n") && comment.contains("board: nucleo-g474re"), "{comment}");
    let expected = expected(&log);
    assert_eq!(groups[0].channels().len(), expected.len());
    for (channel, (name, values)) in groups[0].channels().iter().zip(expected) {
        assert_eq!(channel.name().expect("readable").as_deref(), Some(name));
        let unit = name.rsplit_once('_').map(|(_, unit)| unit).filter(|unit| *unit != "by");
        assert_eq!(channel.unit().expect("readable").as_deref(), unit);
        let found: Vec<f64> = channel
            .values()
            .expect("readable")
            .into_iter()
            .map(|value| match value {
                Some(DecodedValue::Float(value)) => value,
                other => panic!("{name}: {other:?}"),
            })
            .collect();
        assert_eq!(found, values, "{name}");
    }
    std::fs::remove_dir_all(folder).expect("ours");
}
