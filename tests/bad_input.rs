//! What can't be used is refused with one line that says what, where and what to do, the right exit code, and nothing written.
//!
//! Exit codes: 2 for the call (also for an output that can't be written), 3 for a file. Lines are compared to the letter, because they
//! are what a user has; `@/` stands for the test's folder.

use crate::support::{
    Folder, PI1, PLANT, column, good_csv, hysteron, image, json, root, run, stderr, stdout, succeeded,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::ffi::OsStr;
use std::fs::{self, OpenOptions};
use std::os::unix::ffi::OsStrExt;
use std::process::{Command, Stdio};

/// A folder with a good log, a plant and a controller to spoil, and outputs of an earlier run.
struct Bench {
    folder: Folder,
    plant: String,
    pi1: String,
}

/// Outputs that every call in this file names.
const OUTPUTS: [&str; 2] = ["out.csv", "out.html"];
const EARLIER: &str = "of an earlier run\n";

impl Bench {
    fn new(name: &str) -> Self {
        let folder = Folder::new(name);
        folder.write("good.csv", good_csv(40));
        for name in OUTPUTS {
            folder.write(name, EARLIER);
        }
        let read = |path: &str| fs::read_to_string(root().join(path)).expect("a file of the project");
        Self { folder, plant: read(PLANT), pi1: read(PI1) }
    }

    /// Asserts that `call` ends with `code` and prints exactly `line`, and that every file is as it was.
    fn refused(&self, call: &str, code: i32, line: &str) {
        let before = self.files();
        let output = run(&self.folder, call);
        let said = stderr(&output);
        assert_eq!(said, self.folder.fill_in(&format!("hysteron: {line}\n")), "{call}");
        assert_eq!(output.status.code(), Some(code), "{call}");
        assert_eq!(stdout(&output), "", "{call}");
        assert!(self.files() == before, "{call}: the folder changed, it holds {:?}", self.folder.names());
    }

    fn files(&self) -> Vec<(String, Vec<u8>)> {
        let read = |name: String| {
            let path = self.folder.path(&name);
            let bytes = if path.is_file() { fs::read(path).expect("a file") } else { Vec::new() };
            (name, bytes)
        };
        self.folder.names().into_iter().map(read).collect()
    }

    /// A log that replay refuses as a bad file.
    fn bad_log(&self, content: impl AsRef<[u8]>, line: &str) {
        self.folder.write("bad.csv", content);
        self.refused(&format!("replay --plant {PLANT} @/bad.csv --out @/out.csv"), 3, line);
    }

    /// A plant that replay refuses as a bad file; `spoil` is a text in the thesis' plant and what stands in its place.
    fn bad_plant(&self, spoil: (&str, &str), line: &str) {
        assert!(self.plant.contains(spoil.0), "{spoil:?}");
        self.folder.write("bad.toml", self.plant.replacen(spoil.0, spoil.1, 1));
        self.refused("replay --plant @/bad.toml @/good.csv --out @/out.csv", 3, line);
    }

    /// A controller that simulate refuses as a bad file; `spoil` as for a plant.
    fn bad_controller(&self, spoil: (&str, &str), line: &str) {
        assert!(self.pi1.contains(spoil.0), "{spoil:?}");
        self.folder.write("bad.toml", self.pi1.replacen(spoil.0, spoil.1, 1));
        self.refused(&closed_loop("@/bad.toml", "step:80um", "20000", "0.01"), 3, line);
    }
}

fn closed_loop(controller: &str, reference: &str, rate: &str, seconds: &str) -> String {
    format!(
        "simulate --plant {PLANT} --controller {controller} --reference {reference} --rate {rate} --seconds {seconds} --out @/out.csv"
    )
}

fn open_loop(command: &str, rate: &str, seconds: &str) -> String {
    format!("simulate --plant {PLANT} --command {command} --rate {rate} --seconds {seconds} --out @/out.csv")
}

#[test]
fn logs_that_are_none() {
    let bench = Bench::new("logs");
    let good = good_csv(40);
    bench.bad_log(
        good.replace("displacement_um", "y_um"),
        "@/bad.csv: no column `displacement_um` (displacement); it has time_s, command_V, y_um; map one with --columns displacement=NAME",
    );
    bench.bad_log(
        good.replacen("\n0.010,", "\n0.010,abc", 1),
        "@/bad.csv, line 13, column command_V: `abc30.000000` is not a number; correct the cell or cut the log there",
    );
    bench.bad_log(
        good.replacen("\n0.010,30.000000,", "\n0.010,NaN,", 1),
        "@/bad.csv, line 13, column command_V: NaN is not finite; cut the log there or repair the sample",
    );
    bench.bad_log(
        good.replacen("\n0.010,", "\n0.0103,", 1),
        "@/bad.csv, line 13: time 0.0103 s is 30.0 % of a sample off the uniform grid (1 % is allowed, plus the rounding of the printed time); resample the log, or use --rate HZ if only the time stamps jitter",
    );
    let kept = good.lines().filter(|line| !line.starts_with("0.020") && !line.starts_with("0.021"));
    bench.bad_log(
        kept.map(|line| format!("{line}\n")).collect::<String>(),
        "@/bad.csv, line 23: 2 rows lost before it (row 20 should be here, the time jumps from 0.019 s to 0.022 s); record again or cut the log there",
    );
    bench.bad_log(
        good.lines().skip(1).take(3).map(|line| format!("{line}\n")).collect::<String>(),
        "@/bad.csv: only 2 samples; at least 16 are needed",
    );
    bench.bad_log("", "@/bad.csv: is empty; a log has a header line and at least 16 samples");
    let garbage: Vec<u8> = (0..500u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    bench.bad_log(garbage, "@/bad.csv: is not a text file (a control byte at byte 0); logs are CSV, NPY or MAT v5");
    bench.refused(
        &format!("replay --plant {PLANT} @/nowhere.csv --out @/out.csv"),
        3,
        "@/nowhere.csv: no such file; check the path",
    );
}

#[test]
fn a_fault_far_down_a_log_leaves_no_half_of_a_prediction() {
    // Beyond what is read ahead to learn the interval: the prediction has begun when the fault is met.
    let bench = Bench::new("far");
    let good = good_csv(3000);
    bench.bad_log(
        good.replacen("\n2.500,", "\n2.500,x", 1),
        "@/bad.csv, line 2503, column command_V: `x-0.000000` is not a number; correct the cell or cut the log there",
    );
}

#[test]
fn plants_that_are_none() {
    let bench = Bench::new("plants");
    bench.bad_plant(
        ("[structure]\n", "[structure]\ncolour = 3\n"),
        "@/bad.toml, line 24: unknown field `colour`, expected one of `mass_kg`, `damping_N_s_per_m`, `stiffness_N_per_m`",
    );
    bench.bad_plant(
        ("[structure]\n", "[strukture]\n"),
        "@/bad.toml, line 23: unknown field `strukture`, expected one of `schema`, `name`, `kind`, `drive`, `actuator`, `structure`, `hysteresis`, `state_space`, `transfer_function`, `sensor`, `effect`, `rig`, `initial_state`, `fit`",
    );
    bench.bad_plant(("[structure]\n", "[structure\n"), "@/bad.toml, line 23: unclosed table, expected `]`");
    bench.bad_plant(
        ("value = 24579.0", "value = \"24579.0\""),
        "@/bad.toml, line 26: invalid type: string \"24579.0\", expected f64",
    );
    bench.bad_plant(
        ("{ value = 24579.0, sigma = 0.02, source = \"thesis, Table 2.1; sigma assumed\" }", "24579.0"),
        "@/bad.toml, line 26: invalid type: floating point `24579.0`, expected a record, as in `{ value = 1.0, source = \"data sheet\" }`",
    );
    bench.bad_plant(
        ("value = 1.0148e-3", "value = -1.0148e-3"),
        "@/bad.toml: structure.mass_kg is -0.0010148: it must be positive",
    );
    bench.bad_plant(
        ("value = 24579.0", "value = nan"),
        "@/bad.toml: structure.stiffness_N_per_m is NaN: it must be a finite number",
    );
    bench.bad_plant(
        ("value = 3.7356", "value = inf"),
        "@/bad.toml: structure.damping_N_s_per_m is inf: it must be a finite number",
    );
    bench.bad_plant(
        ("sigma = 0.005", "sigma = -0.005"),
        "@/bad.toml: structure.mass_kg has sigma -0.005: it must not be negative",
    );
    bench.bad_plant(
        ("sigma = 0.005", "sigma = nan"),
        "@/bad.toml: structure.mass_kg has sigma NaN: it must not be negative",
    );
    // Beyond a mistaken unit: nothing could be computed with them in any time.
    bench.bad_plant(
        ("value = 1.0148e-3", "value = 1.0148e-300"),
        "@/bad.toml: structure.mass_kg is 1.0148e-300: it can't be: check its unit",
    );
    bench.bad_plant(
        ("value = 24579.0", "value = 1e300"),
        "@/bad.toml: structure.stiffness_N_per_m is 1e300: it can't be: check its unit",
    );
    bench.bad_plant(
        ("value = 24579.0", "value = 1e18"),
        "@/bad.toml: mass, stiffness, transduction and capacitances make a resonance of 5.0e9 Hz: check their units",
    );
    bench.bad_plant(
        ("[structure]\n", "[[effect]]\nid = \"crep\"\nform = \"kelvin-voigt\"\n[structure]\n"),
        "@/bad.toml: effect[1].id is \"crep\", which is no known effect: did you mean \"creep\"? `hysteron effects` lists all",
    );
    bench.bad_plant(
        ("[structure]\n", "[[effect]]\nid = \"transport_delay\"\nform = \"pure\"\n[effect.parameters]\ndelay_s = { value = -250e-6 }\n[structure]\n"),
        "@/bad.toml: effect[1].parameters.delay_s is -0.00025: it must lie between 0 and 1000 s (SI); correct it",
    );
    bench.bad_plant(("value = -90.0", "value = 95.0"), "@/bad.toml: rig.drive_min_V must lie below rig.drive_max_V");
    bench.bad_plant(
        (
            "[structure]",
            "[initial_state]\ndisplacement_um = 0.0\nvelocity_um_per_s = 0.0\nhysteron_V = [0.0]\ndrive_V = 0.0\n[structure]",
        ),
        "@/bad.toml: initial_state.hysteron_V has length 1 and there are 2 hysterons: give one number for each",
    );
    bench.bad_plant(
        ("[structure]", "[drive]\nmin_V = { value = 3.0 }\nmax_V = { value = -3.0 }\n[structure]"),
        "@/bad.toml: drive.min_V must lie below drive.max_V",
    );
    bench.bad_plant(
        ("hysteron-model-1", "hysteron-model-9"),
        "@/bad.toml: schema is \"hysteron-model-9\" and \"hysteron-model-1\" is wanted here; name another file",
    );
    bench.bad_plant(
        ("schema = \"hysteron-model-1\"", ""),
        "@/bad.toml: no schema is stated and \"hysteron-model-1\" is wanted here; name another file",
    );
    bench.refused(
        &format!("replay --plant {PI1} @/good.csv --out @/out.csv"),
        3,
        &format!(
            "{PI1}: schema is \"hysteron-controller-1\" and \"hysteron-model-1\" is wanted here; name another file"
        ),
    );
    bench.refused(
        "replay --plant @/nowhere.toml @/good.csv --out @/out.csv",
        3,
        "@/nowhere.toml: cannot be read: No such file or directory (os error 2); check the path",
    );
    bench.folder.write("bytes.toml", [0x61, 0xff, 0xfe, 0x00]);
    bench.refused(
        "replay --plant @/bytes.toml @/good.csv --out @/out.csv",
        3,
        "@/bytes.toml: is not a text file (byte 1); a parameter file is TOML",
    );
}

#[test]
fn controllers_that_are_none() {
    let bench = Bench::new("controllers");
    let without = bench.pi1.split("[limits]").next().expect("the part before").to_owned();
    bench.folder.write("without.toml", without);
    bench.refused(
        &closed_loop("@/without.toml", "step:80um", "20000", "0.01"),
        3,
        "@/without.toml: [limits] is missing; without limits it needs `unlimited = true`",
    );
    bench.bad_controller(
        ("[limits]", "[limit]"),
        "@/bad.toml, line 9: unknown field `limit`, expected one of `schema`, `name`, `kp_V_per_m`, `ki_V_per_m_s`, `feedforward_V_per_m`, `unlimited`, `limits`, `reference`, `guard`, `inverse`, `design`",
    );
    bench.bad_controller(
        ("schema = ", "unlimited = true\nschema = "),
        "@/bad.toml: unlimited = true contradicts [limits], [reference] or [guard]: drop one of them",
    );
    bench.bad_controller(
        ("max_V = { value = 90.0", "max_V = { value = -1.0"),
        "@/bad.toml: limits.max_V leaves 0 V, the safe level, outside the drive range",
    );
    bench.bad_controller(
        ("max_V = { value = 90.0", "max_V = { value = inf"),
        "@/bad.toml: limits.max_V is inf: it must be a finite number; a controller without limits says `unlimited = true`",
    );
    bench.bad_controller(
        ("trip_um = { value = 120.0", "trip_um = { value = 1e60"),
        "@/bad.toml: guard.trip_um is 1e60: it must be a finite number; a controller without limits says `unlimited = true`",
    );
    bench.bad_controller(
        ("slew_V_per_s = { value = 4.0e5", "slew_V_per_s = { value = 0.0"),
        "@/bad.toml: limits.slew_V_per_s must be greater than zero",
    );
    bench.bad_controller(
        ("max_um = { value = 100.0", "max_um = { value = 130.0"),
        "@/bad.toml: reference.max_um must be below guard.trip_um, else an allowed reference trips",
    );
    bench.bad_controller(("value = 8.5811e5", "value = -8.5811e5"), "@/bad.toml: kp_V_per_m must not be negative");
    bench.bad_controller(
        ("value = 9.6755e8", "value = nan"),
        "@/bad.toml: ki_V_per_m_s is NaN: it must be a finite number; a controller without limits says `unlimited = true`",
    );
    bench.bad_controller(
        ("value = 2.0e8", "value = 1.0e-3"),
        "@/bad.toml: reference.acceleration_um_per_s2 / rate_hz must be at least reference.rate_um_per_s / 65536",
    );
}

#[test]
fn wrong_specs() {
    let bench = Bench::new("specs");
    let at_the_argument = |spec: &str, part: &str, reason: &str| {
        let line = format!(
            "invalid value '{spec}' for '--command <SPEC>': SPEC part \"{part}\": {reason}; see `hysteron simulate --help`"
        );
        bench.refused(&open_loop(spec, "20000", "0.01"), 2, &line);
    };
    let known = "known: zero, step, square, sine, decaying-sine, triangle, sweep, ladder, hold, multisine, minor-loops, file:PATH";
    for (spec, reason) in [
        ("stp:80V", &*format!("unknown kind \"stp\"; {known}")),
        ("step:80", "amplitude \"80\" needs its unit, um or V"),
        ("step", "a step needs an amplitude, as in `step:20um`"),
        ("step:nanV", "\"nan\" is not a number"),
        ("step:60mV", "\"60m\" is not a number: the units are V, um, Hz, s and ms"),
        ("sine:5V@10kHz", "\"10k\" is not a number: the units are V, um, Hz, s and ms"),
        ("step:80V@10Hz", "a step has no frequency"),
        ("sine:20V", "a sine needs a frequency, as in `sine:20um@10Hz`"),
        ("sine:20V@0Hz", "\"0\" must be greater than zero"),
        ("square:20V@1s", "a square needs a frequency, as in `square:20um@10Hz`"),
        ("sweep:20V@2000-1Hz/4s", "band 2000-1Hz must go upwards"),
        ("sweep:20V@1-2000Hz", "a sweep needs its duration, as in `sweep:20V@1-2000Hz/4s`"),
        ("ladder:60V,hold=2s", "a ladder needs its number of levels, as in `ladder:60V/8,hold=2s`"),
        ("ladder:60V/8", "a ladder needs the time on each level, as in `hold=2s`"),
        ("multisine:20V", "needs a band of frequencies, as in `multisine:20V@1-2000Hz`"),
        ("multisine:20V@1-9Hz,periods=0", "periods and realisations must be between 1 and 100000 together"),
        ("hold:20V,for=5", "time \"5\" needs its unit, s or ms"),
        ("sine:60V@10", "\"10\" needs its unit: Hz of a frequency, s or ms of a time"),
        ("step:80V,odd", "unknown option \"odd\", or given twice"),
        ("file:", "needs a path, as in `file:reference.csv`"),
    ] {
        at_the_argument(spec, spec, reason);
    }
    at_the_argument("step:80V+zero", "step:80V", "needs a length because another part follows: add `,for=2s`");
    at_the_argument("step:80V@1s+hold:2um", "hold:2um", "mixes um and V in one sequence");

    // What shows only at a rate, or in a file.
    for (spec, line) in [
        ("step:1e60V", "SPEC part \"step\": amplitudes and table values must be finite"),
        (
            "multisine:20V@3-2000Hz",
            "SPEC part \"multisine\": the lowest line 3 Hz must divide the rate 20000 Hz; the nearest that does is 2.999850007499625 Hz",
        ),
        (
            "multisine:20V@1-10000Hz",
            "SPEC part \"multisine\": the highest line 10000 Hz must lie below half the rate, 10000 Hz",
        ),
        // There it is zero at every sample.
        ("sine:20V@10000Hz", "SPEC part \"sine\": its 10000 Hz must lie below half the rate, 10000 Hz"),
        ("triangle:20V@10000Hz", "SPEC part \"triangle\": its 10000 Hz must lie below half the rate, 10000 Hz"),
        ("square:20V@10001Hz", "SPEC part \"square\": its 10001 Hz must not be above half the rate, 10000 Hz"),
        ("sweep:20V@1-10001Hz/1s", "SPEC part \"sweep\": its 10001 Hz must not be above half the rate, 10000 Hz"),
        (
            "multisine:20V@1-2000Hz,realisations=5000",
            "SPEC part \"multisine\": 100000000 samples of up to 2000 lines are too many to make: lower the rate, the realisations or the highest line",
        ),
    ] {
        bench.refused(&open_loop(spec, "20000", "0.01"), 2, line);
    }
    bench.refused(
        &open_loop("file:@/nowhere,unit=V", "20000", "0.01"),
        3,
        "SPEC part \"file\": @/nowhere cannot be read: No such file or directory (os error 2); check the name",
    );
    bench.folder.write("wave.txt", "volts\n# a comment\n1.0\n2.0\n3,0\n");
    bench.refused(
        &open_loop("file:@/wave.txt,unit=V", "20000", "0.01"),
        3,
        "SPEC part \"file\": @/wave.txt, line 5: \"3,0\" is not a number; a reference file has one number per line",
    );
    // A number that is mistyped is no header.
    for first in ["1O", "nan", "10 V", "1e400"] {
        bench.folder.write("wave.txt", format!("\u{feff}{first}\n20\n30\n"));
        bench.refused(
            &open_loop("file:@/wave.txt,unit=V", "20000", "0.01"),
            3,
            &format!("SPEC part \"file\": @/wave.txt, line 1: {first:?} is not a number; a reference file has one number per line"),
        );
    }
    bench.refused(&open_loop("step:80um", "20000", "0.01"), 2, "--command is a voltage: give its amplitudes in V");
    bench.refused(
        &closed_loop(PI1, "step:80V", "20000", "0.01"),
        2,
        "--reference is a displacement: give its amplitudes in um",
    );
}

#[test]
fn wrong_numbers() {
    let bench = Bench::new("numbers");
    let hint = "see `hysteron simulate --help`";
    for (rate, reason) in [
        ("0", "must be greater than zero"),
        ("-5", "must be greater than zero"),
        ("NaN", "not a finite number"),
        ("inf", "not a finite number"),
        ("20k", "not a finite number"),
    ] {
        let line = format!("invalid value '{rate}' for '--rate <HZ>': {reason}; {hint}");
        bench.refused(&open_loop("step:8V", rate, "0.01"), 2, &line);
    }
    let too_many = |samples: &str| {
        format!("{samples} samples are more than the 20000000 that one call makes: lower --rate or --seconds")
    };
    bench.refused(&open_loop("step:8V", "1e6", "1000"), 2, &too_many("1000000000"));
    bench.refused(&closed_loop(PI1, "step:8um", "1e298", "0.2"), 2, &too_many("2e297"));
    bench.refused(&open_loop("step:8V", "1e-3", "0.01"), 2, "--seconds is shorter than one sample at 0.001 Hz");
    bench.refused(
        &format!("{} --delay-us -1", open_loop("step:8V", "1000", "1")),
        2,
        &format!("invalid value '-1' for '--delay-us <D>': must not be negative; {hint}"),
    );
    bench.refused(
        &format!("{} --delay-us 1e300", closed_loop(PI1, "step:8um", "20000", "1")),
        2,
        "--delay-us 1e300 is longer than the run of 1 s, so that nothing would move: lower it",
    );
    bench.refused(
        &format!("{} --delay-us 1e6", closed_loop(PI1, "step:8um", "20000", "2")),
        2,
        "a delay of 20000 samples is too long to assess; at most 200; lower --delay-us or --rate",
    );
    bench.refused(
        &format!("simulate --plant {PLANT} --command step:8V --rate 1000 --out @/out.csv"),
        2,
        "the SPEC has no length of its own: give --seconds",
    );
    bench.refused(
        &format!("replay --plant {PLANT} @/good.csv --scale displacement=0 --out @/out.csv"),
        2,
        "--scale displacement: 0 cannot be used; give a finite number other than zero",
    );
    bench.refused(
        &format!("replay --plant {PLANT} @/good.csv --columns force=1,colour=x --out @/out.csv"),
        2,
        "--columns: `colour` is no column of a log; use one of time, command, displacement, reference, drive, force, current, temperature, limited_by, seq",
    );
    bench.refused(
        &format!("replay --plant {PLANT} @/good.csv --run-in 5 --out @/out.csv"),
        2,
        "good.csv: 0 rows are left after a run-in of 5 s; at least 16 are needed: shorten --run-in",
    );
    // A run-in of the file's own is the file's fault.
    bench.bad_log(
        format!("# run_in_s: 5\n{}", good_csv(40)),
        "bad.csv: 0 rows are left after a run-in of 5 s that it states; at least 16 are needed: give a shorter --run-in",
    );
    // Without a start to fit either.
    bench.refused(
        &format!("replay --plant {PLANT} @/good.csv --initial relaxed --run-in 5 --out @/out.csv"),
        2,
        "good.csv: 0 rows are left after a run-in of 5 s; at least 16 are needed: shorten --run-in",
    );
}

#[test]
fn a_delay_in_a_file_may_be_any_number() {
    let bench = Bench::new("delays");
    // A log's latency and a drive's delay that are longer than the log: the command never arrives, nothing is allocated for it.
    bench.folder.write("late.csv", format!("# latency_us: 1e300\n{}", good_csv(40)));
    let output = run(&bench.folder, &format!("replay --plant {PLANT} @/late.csv --initial relaxed --out @/late_p.csv"));
    succeeded(&output);
    assert!(column(&bench.folder.read("late_p.csv"), "predicted_um").iter().all(|y| *y == 0.0));
    bench.folder.write("late.toml", format!("{}\n[drive]\ndelay_us = {{ value = 1e12 }}\n", bench.plant));
    let output = run(&bench.folder, "replay --plant @/late.toml @/good.csv --initial relaxed --out @/late_p.csv");
    assert!(stderr(&output).contains("drive.delay_us = 1e12 is outside"), "{}", stderr(&output));
    succeeded(&output);
}

#[test]
fn places_that_cannot_be_written() {
    let bench = Bench::new("places");
    bench.folder.write("f.toml", EARLIER);
    fs::create_dir(bench.folder.path("folder")).expect("a folder");
    let replay = |out: &str| format!("replay --plant {PLANT} @/good.csv --out {out}");
    let simulate =
        |out: &str| format!("simulate --plant {PLANT} --command step:8V --rate 1000 --seconds 0.1 --out {out}");
    let identify = |out: &str| format!("identify --model phs --hysterons 0 @/good.csv --out {out}");
    for call in [&replay as &dyn Fn(&str) -> String, &simulate, &identify] {
        bench.refused(&call("@/folder"), 2, "@/folder: is a directory; name a file in it with --out");
        bench.refused(
            &call("@/no/p.csv"),
            2,
            "@/no/p.csv: the directory @/no is not there; make it or name another with --out",
        );
        bench.refused(
            &call("@/good.csv/p.csv"),
            2,
            "@/good.csv/p.csv: @/good.csv is not a directory; name another place with --out",
        );
        bench.refused(
            &call("@/both.html"),
            2,
            "@/both.html: would be both output and page; name the page with --page or leave it out with --no-page",
        );
        bench.refused(
            &format!("{} --page /dev/full", call("@/new.csv")),
            2,
            "/dev/full: is no file; name another page with --page",
        );
        bench.refused(
            &format!("{} --page @/no/p.html", call("@/new.csv")),
            2,
            "@/no/p.html: the directory @/no is not there; make it or name another with --page",
        );
    }
    let full = "/dev/full: cannot be written: No space left on device (os error 28);";
    bench.refused(&replay("/dev/full"), 2, &format!("{full} nothing was left there, name another place with --out"));
    bench.refused(&simulate("/dev/full"), 2, &format!("{full} nothing was left there, name another place with --out"));
    bench.refused(&identify("/dev/full"), 2, &format!("{full} name another place"));
    // A device takes what is written and has no page and no report beside it.
    succeeded(&run(&bench.folder, &simulate("/dev/null")));
    assert!(!std::path::Path::new("/dev/null.html").exists());
    if let Some(image) = image() {
        let board = format!("board run {image} --plant {PLANT} --command step:8V --seconds 0.001 --out /dev/null");
        let output = run(&bench.folder, &board);
        succeeded(&output);
        assert!(!stdout(&output).contains("report: "), "{}", stdout(&output));
        assert!(!std::path::Path::new("/dev/null.board.json").exists());
    }

    // What is read is never overwritten, by whatever name.
    bench.refused(
        &replay("@/good.csv"),
        2,
        "@/good.csv: is read by this call and would be overwritten; name another file with --out",
    );
    bench.refused(
        &replay("@/folder/../good.csv"),
        2,
        "@/folder/../good.csv: is read by this call and would be overwritten; name another file with --out",
    );
    bench.refused(
        &simulate(PLANT),
        2,
        &format!("{PLANT}: is read by this call and would be overwritten; name another file with --out"),
    );
    bench.folder.write("wave.csv", "1.0\n2.0\n");
    bench.refused(
        &format!("simulate --plant {PLANT} --command file:@/wave.csv,unit=V --rate 1000 --out @/wave.csv"),
        2,
        "@/wave.csv: is read by this call and would be overwritten; name another file with --out",
    );
    // A file that may not be written isn't replaced either.
    let locked = bench.folder.path("out.csv");
    let mut permissions = fs::metadata(&locked).expect("it is there").permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&locked, permissions).expect("it is ours");
    bench.refused(
        &replay("@/out.csv"),
        2,
        "@/out.csv: may not be written; make it writable or name another file with --out",
    );
}

#[test]
fn standard_output_and_error_that_are_full() {
    let folder = Folder::new("full");
    let full = || OpenOptions::new().write(true).open("/dev/full").expect("a full device");
    let call = |stdout: Stdio, stderr: Stdio, arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hysteron"));
        command.current_dir(root()).args(arguments).stdout(stdout).stderr(stderr);
        command.spawn().expect("the command starts").wait_with_output().expect("it ends")
    };
    let out = folder.path("s.csv").display().to_string();
    let good = [
        "simulate",
        "--plant",
        PLANT,
        "--command",
        "step:8V",
        "--rate",
        "1000",
        "--seconds",
        "0.1",
        "--json",
        "--out",
        &out,
    ];
    // JSON that nobody gets is no success.
    let output = call(full().into(), Stdio::piped(), &good);
    assert_eq!(stderr(&output), "hysteron: standard output cannot be written: send it to another place\n");
    assert_eq!(output.status.code(), Some(2));
    // Warnings and errors that nobody gets change no exit code.
    assert_eq!(call(Stdio::null(), full().into(), &good).status.code(), Some(0));
    let bad = ["replay", "--plant", "nowhere.toml", "x.csv", "--out", &out];
    assert_eq!(call(Stdio::null(), full().into(), &bad).status.code(), Some(3));
}

#[test]
fn wrong_calls_are_one_line_too() {
    let bench = Bench::new("calls");
    let refused = |call: &str, line: &str| bench.refused(call, 2, line);
    refused(
        "simulat --plant x",
        "unrecognized subcommand 'simulat'; tip: a similar subcommand exists: 'simulate'; see `hysteron --help`",
    );
    refused(
        "replay --plan x --out y z",
        "unexpected argument '--plan' found; tip: a similar argument exists: '--plant'; see `hysteron replay --help`",
    );
    refused(
        "simulate",
        "the following required arguments were not provided: --plant <P.toml> --rate <HZ> --out <LOG.csv>; see `hysteron simulate --help`",
    );
    refused(
        "simulate --plant",
        "a value is required for '--plant <P.toml>' but none was supplied; see `hysteron simulate --help`",
    );
    refused(
        &format!("simulate --plant {PLANT} --controller {PI1} --rate 20000 --out @/out.csv"),
        "the following required arguments were not provided: --reference <SPEC>; see `hysteron simulate --help`",
    );
    refused(
        &format!("{} --command step:8V", closed_loop(PI1, "step:8um", "20000", "1")),
        "the argument '--reference <SPEC>' cannot be used with '--command <SPEC>'; see `hysteron simulate --help`",
    );
    refused(
        &format!("simulate --plant {PLANT} --rate 20000 --out @/out.csv"),
        "nothing to drive with: give --controller and --reference, or --command",
    );
    refused(
        "identify --model maxwell @/good.csv --out @/f.toml",
        "invalid value 'maxwell' for '--model <KIND>' [possible values: phs, linear, bouc-wen, bouc-wen-static, bouc-wen-oscillator, dahl, duhem, maxwell-slip, prandtl-ishlinskii, preisach, krasnoselskii-pokrovskii, transfer-function]; tip: a similar value exists: 'maxwell-slip'; see `hysteron identify --help`",
    );
    // An argument with line breaks and escapes makes neither.
    let output = hysteron(["simulate\n\u{1b}[31m", "x"]);
    assert_eq!(
        stderr(&output),
        "hysteron: unrecognized subcommand 'simulate '; tip: a similar subcommand exists: 'simulate'; see `hysteron --help`\n",
    );
    // Help is an answer.
    for call in [
        "--help",
        "simulate --help",
        "replay --help",
        "identify --help",
        "diagnose --help",
        "effects --help",
        "--version",
    ] {
        let output = hysteron(call.split(' '));
        assert_eq!((succeeded(&output), stdout(&output).is_empty()), (String::new(), false), "{call}");
        assert!(call == "--version" || stdout(&output).contains("\n  hysteron "), "{call} shows no example");
    }
}

#[test]
fn an_argument_need_not_be_text() {
    let folder = Folder::new("bytes");
    let out = folder.0.join(OsStr::from_bytes(b"log\xff.csv"));
    let mut arguments: Vec<&OsStr> =
        ["simulate", "--plant", PLANT, "--command", "step:8V", "--rate", "1000", "--seconds", "0.1"]
            .iter()
            .map(OsStr::new)
            .collect();
    arguments.extend([OsStr::new("--out"), out.as_os_str()]);
    assert_eq!(succeeded(&hysteron(&arguments)), "");
    assert_eq!(folder.names().len(), 2);
}

#[test]
fn an_unstable_loop_is_refused_and_a_thin_margin_said() {
    let bench = Bench::new("margins");
    bench.refused(
        &format!("{} --delay-us 100", closed_loop(PI1, "step:80um", "20000", "0.01")),
        2,
        "controllers/pi1.toml: unstable: spectral radius 1.0251 (hysteron 1 active); 20 kHz with 12 us at most from sampling to drive would do: gain margin 6.0 dB in the worst region",
    );
    let output = run(&bench.folder, &closed_loop(PI1, "step:80um", "10000", "0.01"));
    assert_eq!(
        succeeded(&output),
        "warning: controllers/pi1.toml: stable, but the gain margin is 2.4 dB, below 6 dB (hysteron 1 active); 20 kHz with 10 us as asked would do: gain margin 6.5 dB in the worst region\n"
    );
    // With room enough nothing is said.
    assert_eq!(succeeded(&run(&bench.folder, &closed_loop(PI1, "step:80um", "40000", "0.01"))), "");
}

#[test]
fn logs_that_nothing_can_be_identified_from() {
    let bench = Bench::new("identify");
    let call = |options: &str| format!("identify --model phs @/good.csv --out @/f.toml {options}");
    bench.refused(
        &call("--run-in 5"),
        2,
        "good.csv: 0 rows are left after a run-in of 5 s; at least 16 are needed: shorten --run-in",
    );
    bench.refused(
        &call("--scale displacement=-1e-6"),
        3,
        "good.csv: the displacement falls when the command rises: turn its sign with --scale displacement=-1e-6",
    );
    let flat: String = (0..40).map(|k| format!("{:.3},1.0,{}\n", f64::from(k) / 1e3, k % 3)).collect();
    bench.folder.write("flat.csv", format!("time_s,command_V,displacement_um\n{flat}"));
    bench.refused(
        "identify --model phs @/flat.csv --out @/f.toml",
        3,
        "flat.csv: the command never changes, so nothing can be identified from it: drive it with steps or sines",
    );
}

#[test]
fn units_mistaken_by_a_million_are_said_and_done() {
    let bench = Bench::new("units");
    for (spoil, warning) in [
        // Milligrams instead of kilograms, newtons per micrometre instead of per metre, microfarads instead of farads.
        (
            ("value = 1.0148e-3", "value = 1014.8"),
            "structure.mass_kg = 1.0148e3 is outside 1e-7 .. 5e1: check its unit",
        ),
        (
            ("value = 24579.0", "value = 0.024579"),
            "structure.stiffness_N_per_m = 2.4579e-2 is outside 1e0 .. 1e10: check its unit",
        ),
        (
            ("value = 24579.0", "value = 0.024579"),
            "alpha/k = 1.884e6 um/V is outside 1e-4 .. 1e3: check the units of stiffness and transduction",
        ),
        (
            ("value = 5.6425e-7", "value = 0.56425"),
            "actuator.hysteron[1].capacitance_F = 5.6425e-1 is outside 1e-12 .. 1e-2: check its unit",
        ),
        (
            ("value = 14.5126", "value = 14.5126e-6"),
            "actuator.hysteron[1].dead_zone_V = 1.45126e-5 is outside 1e-3 .. 2e3: check its unit",
        ),
        (
            ("value = 3.7356", "value = 3.7356e6"),
            "structure.damping_N_s_per_m = 3.7356e6 is outside 1e-5 .. 1e5: check its unit",
        ),
    ] {
        bench.folder.write("unit.toml", bench.plant.replacen(spoil.0, spoil.1, 1));
        let output = run(&bench.folder, "replay --plant @/unit.toml @/good.csv --initial relaxed --out @/p.csv --json");
        let said = succeeded(&output);
        let told = format!("warning: {}: {warning}", bench.folder.path("unit.toml").display());
        assert!(said.lines().all(|line| line.starts_with("warning: ")), "{said}");
        assert!(said.lines().any(|line| line == told), "{said}");
        json(&output);
    }
    // A log in metres whose column says micrometres.
    let output = run(&bench.folder, &format!("replay --plant {PLANT} @/good.csv --scale displacement=1 --out @/p.csv"));
    let said = succeeded(&output);
    assert!(said.contains("give --scale displacement=1e-9 for nm"), "{said}");
}

/// Random damage to good files: refused in one line, or used; never a crash, never half an output.
#[test]
fn damaged_files_never_crash_the_command() {
    let bench = Bench::new("damage");
    let good = good_csv(60);
    let mut random = Pcg64::seed_from_u64(20_261_121);
    for case in 0..60 {
        let (name, original) = match case % 3 {
            0 => ("log.csv", &good),
            1 => ("plant.toml", &bench.plant),
            _ => ("controller.toml", &bench.pi1),
        };
        let mut bytes = original.clone().into_bytes();
        for _ in 0..random.random_range(0..4) {
            let at = random.random_range(0..bytes.len());
            // Half of the flips stay printable: they get further.
            bytes[at] = if random.random_bool(0.5) { random.random() } else { random.random_range(b' '..b'~') };
        }
        if random.random_bool(0.4) {
            bytes.truncate(random.random_range(0..bytes.len()));
        }
        bench.folder.write(name, &bytes);
        let call = match case % 3 {
            0 => format!("replay --plant {PLANT} @/log.csv --out @/p.csv --json"),
            1 => "replay --plant @/plant.toml @/good.csv --initial relaxed --out @/p.csv --json".to_owned(),
            _ => format!(
                "{} --json",
                closed_loop("@/controller.toml", "step:80um", "20000", "0.005").replace("out.csv", "p.csv")
            ),
        };
        let output = run(&bench.folder, &call);
        let said = stderr(&output);
        let context = || format!("case {case}: {said}{}", String::from_utf8_lossy(&bytes));
        let written = bench.folder.path("p.csv").exists();
        match output.status.code() {
            Some(0) => {
                json(&output);
                assert!(written && said.lines().all(|line| line.starts_with("warning: ")), "{}", context());
            }
            Some(2 | 3) => assert!(
                !written && said.lines().count() == 1 && said.starts_with("hysteron: ") && output.stdout.is_empty(),
                "{}",
                context()
            ),
            _ => panic!("{}", context()),
        }
        for name in ["p.csv", "p.html"] {
            let _ = fs::remove_file(bench.folder.path(name));
        }
        assert!(!bench.folder.names().iter().any(|name| name.contains("part")), "{}", context());
    }
}
