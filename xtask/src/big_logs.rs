//! Long tasks: big logs in bounded memory. 2 GB go through `hysteron replay` and no row is lost on the way; ten minutes at 20 kHz are
//! diagnosed.

use crate::project::{Outcome, Project, watch};
use anyhow::{Context, Result, bail};
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::Instant;

const LOG_BYTES: u64 = 2_000_000_000;

/// Address space given to the replay: above its code, threads and buffers, far below the log. Chosen.
const ADDRESS_LIMIT_BYTES: u64 = 600_000_000;

/// What a diagnosis of ten minutes may hold at a time.
const DIAGNOSIS_LIMIT_KB: u64 = 1_000_000;

/// 20 kHz, the boards' default rate; in whole microseconds the time column is exact.
const SAMPLE_US: u64 = 50;

/// 200 samples at 20 kHz: a 100 Hz sine, the middle of the thesis' range.
const PERIOD_SAMPLES: usize = 200;
const AMPLITUDE_V: f64 = 60.0;

/// A sine, minor loops and a sweep, which a plant's every part shows in.
const TEN_MINUTES: &str = "sine:60V@10Hz,for=200s+minor-loops:60V@1Hz,for=200s+sweep:20V@1-400Hz/200s";

/// What the bench of the ten minutes has and the nominal plant has not.
const CREEP: &str = r#"
[sensor]
noise_um = { value = 0.02, source = "typical" }

[[effect]]
id = "creep"
form = "kelvin-voigt"
[effect.parameters]
"#;

/// The creep's numbers, and how many sigma off the found ones may be.
const CREEP_NUMBERS: [(&str, f64); 2] = [("stiffness_ratio", 0.02), ("time_constant_s", 1.0)];
const MOST_SIGMAS: f64 = 4.0;

/// Static gain alpha/k of the thesis' plant (table 2.1): rough numbers are enough, this task judges memory and not the fit.
const GAIN_UM_PER_V: f64 = 1.884;

/// Writes the log, replays it and checks exit code, memory and number of rows.
pub fn replay(project: &Project) -> Result<Outcome> {
    let program = project.release_binary()?;
    let folder = Folder::new(&project.root.join("target/long"))?;
    let log = folder.0.join("big.csv");
    let prediction = folder.0.join("prediction.csv");
    let started = Instant::now();
    let n_rows = write_log(&log, LOG_BYTES)?;
    println!("wrote {n_rows} rows, {LOG_BYTES} bytes, in {:.1} s", started.elapsed().as_secs_f64());

    let mut command = project.command("prlimit");
    command.arg(format!("--as={ADDRESS_LIMIT_BYTES}")).arg(program);
    command.args(["replay", "--plant", "models/thesis-phs.toml"]).arg(&log);
    command.arg("--out").arg(&prediction).arg("--json");
    let (status, _) = watched("replay", &mut command)?;
    if !status.success() {
        bail!("{status}: replay of {n_rows} rows under {ADDRESS_LIMIT_BYTES} bytes of address space");
    }
    let n_predicted = count_rows(&prediction)?;
    if n_predicted != n_rows {
        bail!("{n_rows} rows in the log, {n_predicted} in the prediction");
    }
    Ok(Outcome::Passed)
}

/// Ten minutes of a bench that creeps, 12 million rows, diagnosed: in bounded memory, and its numbers lie where their sigma says.
pub fn diagnose(project: &Project) -> Result<Outcome> {
    let program = project.release_binary()?;
    let folder = Folder::new(&project.root.join("target/long-diagnosis"))?;
    let nominal = project.root.join("models/thesis-phs.toml");
    let [bench, log, out] = ["bench.toml", "log.csv", "diagnosis"].map(|name| folder.0.join(name));
    let plant = fs::read_to_string(&nominal).with_context(|| format!("reading {}", nominal.display()))?;
    let number = |(name, value)| format!("{name} = {{ value = {value:?}, source = \"typical\" }}\n");
    let numbers: String = CREEP_NUMBERS.map(number).concat();
    fs::write(&bench, format!("{plant}{CREEP}{numbers}")).with_context(|| format!("writing {}", bench.display()))?;
    let mut simulate = Command::new(&program);
    simulate.args(["simulate", "--rate", "20000", "--no-page", "--command", TEN_MINUTES, "--plant"]).arg(&bench);
    let (status, _) = watched("simulate", simulate.arg("--out").arg(&log))?;
    if !status.success() {
        bail!("{status}: simulate of ten minutes");
    }
    let mut diagnose = Command::new(&program);
    diagnose.arg("diagnose").arg("--plant").arg(&nominal).arg(&log).arg("--out").arg(&out);
    let (status, peak_kb) = watched("diagnose", &mut diagnose)?;
    if !status.success() {
        bail!("{status}: diagnose of ten minutes");
    }
    if peak_kb > DIAGNOSIS_LIMIT_KB {
        bail!("the diagnosis held {peak_kb} kB, more than {DIAGNOSIS_LIMIT_KB} kB");
    }
    check_creep(&out.join("diagnosis.json"))?;
    Ok(Outcome::Passed)
}

/// Whether creep alone is named, and its numbers lie as near the bench's as their sigma says.
fn check_creep(path: &Path) -> Result<()> {
    let text = fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    let found: Value = serde_json::from_str(&text).with_context(|| format!("reading {}", path.display()))?;
    if found["effects"] != json!(["creep"]) {
        bail!("named {}, and the bench creeps", found["effects"]);
    }
    for (name, true_value) in CREEP_NUMBERS {
        let mut all = found["parameters"].as_array().into_iter().flatten();
        let one = all.find(|one| one["name"] == name).with_context(|| format!("{name} is not in the answer"))?;
        let [value, sigma] = ["value", "sigma"].map(|key| one[key].as_f64().unwrap_or(f64::NAN));
        let sigmas = (value - true_value) / sigma;
        println!("{name}: {value:.6} +- {sigma:.6}, {sigmas:+.1} sigma off");
        if sigmas.is_nan() || sigmas.abs() > MOST_SIGMAS {
            bail!("{name} is {true_value} and lies {sigmas:+.1} sigma from what was found");
        }
    }
    Ok(())
}

/// Runs `command` and prints how long it took and the most memory it held, which it returns in kB.
fn watched(what: &str, command: &mut Command) -> Result<(ExitStatus, u64)> {
    let started = Instant::now();
    let mut child = command.spawn().with_context(|| format!("starting {}", command.get_program().display()))?;
    let status_file = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak_kb = 0;
    let status = watch(&mut child, |_| {
        // The kernel keeps the peak itself; the last look before the end has it but for the last 50 ms.
        if let Ok(text) = fs::read_to_string(&status_file) {
            peak_kb = peak_kb.max(peak_resident_kb(&text).unwrap_or(0));
        }
        Ok(())
    })?;
    println!("{what}: {:.1} s, peak resident {:.1} MB", started.elapsed().as_secs_f64(), peak_kb as f64 / 1e3);
    Ok((status, peak_kb))
}

/// A folder of our own that goes with us, whether or not the task passed: it holds gigabytes.
struct Folder(PathBuf);

impl Folder {
    fn new(path: &Path) -> Result<Self> {
        fs::create_dir_all(path).with_context(|| format!("making {}", path.display()))?;
        Ok(Folder(path.to_owned()))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if let Err(error) = fs::remove_dir_all(&self.0) {
            eprintln!("{} stays behind: {error}", self.0.display());
        }
    }
}

/// Writes whole rows until `n_bytes` are reached and returns their number. The texts of one period are made once,
/// so the disk sets the pace.
fn write_log(path: &Path, n_bytes: u64) -> Result<u64> {
    let tails: Vec<String> = (0..PERIOD_SAMPLES)
        .map(|idx| {
            let drive_v = AMPLITUDE_V * (TAU * idx as f64 / PERIOD_SAMPLES as f64).sin();
            format!(",{drive_v:.6},{:.6}\n", GAIN_UM_PER_V * drive_v)
        })
        .collect();
    let file = File::create(path).with_context(|| format!("writing {}", path.display()))?;
    let mut out = BufWriter::with_capacity(1 << 20, file);
    let header = "# rate_hz: 20000\ntime_s,command_V,displacement_um\n";
    out.write_all(header.as_bytes())?;
    let mut written = header.len() as u64;
    let mut n_rows = 0;
    while written < n_bytes {
        let time_us = n_rows * SAMPLE_US;
        let time = format!("{}.{:06}", time_us / 1_000_000, time_us % 1_000_000);
        let tail = &tails[(n_rows % PERIOD_SAMPLES as u64) as usize];
        out.write_all(time.as_bytes())?;
        out.write_all(tail.as_bytes())?;
        written += (time.len() + tail.len()) as u64;
        n_rows += 1;
    }
    out.flush().with_context(|| format!("writing {}", path.display()))?;
    Ok(n_rows)
}

/// Rows of data: all lines but the metadata and the header.
fn count_rows(path: &Path) -> Result<u64> {
    let file = File::open(path).with_context(|| format!("reading {}", path.display()))?;
    let mut reader = BufReader::with_capacity(1 << 20, file);
    let (mut n_rows, mut line) = (0u64, Vec::new());
    while reader.read_until(b'\n', &mut line)? > 0 {
        if !line.starts_with(b"#") {
            n_rows += 1;
        }
        line.clear();
    }
    Ok(n_rows.saturating_sub(1))
}

/// `VmHWM` of a `/proc/PID/status`: the most memory the program ever held.
fn peak_resident_kb(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_has_the_size_asked_for_and_uniform_time() {
        let folder = Folder::new(&std::env::temp_dir().join(format!("xtask-{}", std::process::id()))).unwrap();
        let path = folder.0.join("log.csv");
        let n_rows = write_log(&path, 10_000).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        // Whole rows: at most one row (under 40 bytes at this length) past the size.
        assert!((10_000..10_040).contains(&text.len()), "{}", text.len());
        assert_eq!(count_rows(&path).unwrap(), n_rows);
        let rows: Vec<&str> = text.lines().skip(2).collect();
        assert_eq!(rows[0], "0.000000,0.000000,0.000000");
        // A quarter period: 50 samples, 2.5 ms, the full 60 V.
        assert_eq!(rows[50], "0.002500,60.000000,113.040000");
        assert!(rows[200].starts_with("0.010000,0.000000,"));
    }

    #[test]
    fn the_peak_is_read_from_what_the_kernel_prints() {
        assert_eq!(peak_resident_kb("Name:\thysteron\nVmHWM:\t   12345 kB\nVmRSS:\t 1 kB\n"), Some(12345));
        assert_eq!(peak_resident_kb("Name:\tx\n"), None);
    }
}
