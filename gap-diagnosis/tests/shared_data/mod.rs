//! Other people's benchmark data, where they lie beside the project; `None` and a word where they don't.
#![allow(dead_code, reason = "each program uses a part of this module")]

pub mod bouc_wen;

use plant_sim::log::{self, ReadOptions};
use std::path::PathBuf;

fn path(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")).join(name);
    if path.exists() {
        return Some(path);
    }
    println!("not run: ../shared/data/{name} is not here");
    None
}

/// The only numeric variable of a MAT file of the Bouc-Wen benchmark.
pub fn bouc_wen_record(name: &str) -> Option<Vec<f64>> {
    let path = path(&format!("boucwen-benchmark/{name}.mat"))?;
    let variable = if name.starts_with("uest") {
        "u"
    } else if name.starts_with("yest") {
        "y"
    } else {
        name
    };
    // One variable in a file, which is no log: here it stands for both columns.
    let mut options = ReadOptions { rate_hz: Some(bouc_wen::RATE_HZ), ..ReadOptions::default() };
    for column in ["command", "displacement"] {
        options.columns.insert(column.into(), variable.into());
    }
    Some(log::read(&path, &options).expect("a MAT file of the benchmark").command_v)
}

/// A four-dimensional array of the fine steering mirror: [sample][channel][realisation][period], each channel of each realisation
/// with its periods one after the other.
pub fn mirror(name: &str) -> Option<Vec<Vec<Vec<Vec<f64>>>>> {
    let path = path(&format!("fsm-cubespec/{name}.npy"))?;
    let bytes = std::fs::read(path).expect("readable");
    let file = npyz::NpyFile::new(&bytes[..]).expect("an array of the benchmark");
    let shape: Vec<usize> = file.shape().iter().map(|n| *n as usize).collect();
    let order = file.order();
    let data: Vec<f64> = file.into_vec().expect("doubles");
    let [n, channels, realisations, periods] = shape[..] else { panic!("{shape:?}") };
    let at = |i: usize, c: usize, r: usize, p: usize| match order {
        npyz::Order::C => data[((i * channels + c) * realisations + r) * periods + p],
        npyz::Order::Fortran => data[((p * realisations + r) * channels + c) * n + i],
    };
    let of = |r: usize, c: usize| (0..periods).map(|p| (0..n).map(|i| at(i, c, r, p)).collect()).collect();
    Some((0..realisations).map(|r| (0..channels).map(|c| of(r, c)).collect()).collect())
}
