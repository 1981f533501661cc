//! `hysteron record` from the command line: run directories that repeat and are read as they are, whatever ends the program.

mod support;

use support::{
    Folder, PI1, PLANT, column, identity, image, impostor, json, root, run, run_on_a_full_disk, served, spawned,
    stderr, succeeded,
};

const PI2: &str = "controllers/pi2.toml";

fn parsed(text: &str) -> serde_json::Value {
    serde_json::from_str(text).expect("JSON")
}

fn call(words: &str, out: &str) -> String {
    format!("record --board in-process --plant {PLANT} {words} --seed 7 --out @/{out}")
}

#[test]
fn the_thesis_protocol_with_both_controllers_is_one_directory_and_repeats_from_it() {
    let folder = Folder::new("record-thesis");
    let output = run(&folder, &call(&format!("--set thesis --controller {PI1} --controller {PI2} --json"), "a"));
    succeeded(&output);
    let said = json(&output);
    let logs = said["logs"].as_array().expect("a list");
    assert_eq!(logs.len(), 12);
    assert!(logs.iter().all(|log| log["fault"] == "none" && log["lost_samples"] == 0), "{logs:?}");
    // 80 um, and what a loop overshoots of it.
    assert!(logs.iter().all(|log| (70.0..90.0).contains(&log["peak_um"].as_f64().expect("a number"))), "{logs:?}");
    let facts = parsed(&folder.read("a/run.json"));
    assert_eq!(
        (&facts["schema"], &facts["set"], &facts["seed"]),
        (&"hysteron-run-1".into(), &"thesis".into(), &7.into())
    );
    assert_eq!(facts["before_each"], "decaying-sine:60V@8Hz/1s");
    let link = parsed(&folder.read("a/link.json"));
    assert_eq!((&link["is_complete"], &link["logs"]["01-pi1-step.csv"]["rows"]), (&true.into(), &4400.into()));
    for (copy, original) in [("a/plant.toml", PLANT), ("a/controller-pi1.toml", PI1), ("a/controller-pi2.toml", PI2)] {
        assert_eq!(folder.read(copy), std::fs::read_to_string(root().join(original)).expect("ours"));
    }

    // From what the directory holds, the same bits: the command's files and seed, and of the SPECs the first two, of both controllers.
    let specs = [0, 2].map(|index| facts["experiments"][index]["spec"].as_str().expect("text").to_owned());
    let again = |out: &str| {
        let words = specs.iter().map(|spec| format!("--spec {spec} ")).collect::<String>();
        let files = "--controller @/a/controller-pi1.toml --controller @/a/controller-pi2.toml";
        format!(
            "record --board in-process --plant @/a/plant.toml {files} {words} --seed {} --out @/{out}",
            facts["seed"]
        )
    };
    for out in ["b", "c"] {
        succeeded(&run(&folder, &again(out)));
    }
    for name in ["01-controller-pi1-1.csv", "02-controller-pi2-1.csv", "03-controller-pi1-2.csv"] {
        assert_eq!(folder.read(&format!("b/{name}")), folder.read(&format!("c/{name}")));
    }
    succeeded(&run(&folder, &call(&format!("--set thesis --controller {PI1} --controller {PI2}"), "d")));
    for log in logs {
        let name = log["log"].as_str().expect("text");
        assert_eq!(folder.read(&format!("a/{name}")), folder.read(&format!("d/{name}")), "{name}");
    }
}

/// A controller's limits are its loop's: what drives in open loop has the board's own, whichever ran before it.
#[test]
fn an_open_loop_has_the_boards_own_limits_beside_a_controller_of_narrow_ones() {
    let folder = with_narrow_controller("record-limits");
    let words = "--spec hold:60V@0.02s --spec step:20um@0.02s --controller @/narrow.toml";
    succeeded(&run(&folder, &call(words, "run")));
    let facts = parsed(&folder.read("run/run.json"));
    let most_v = |index: usize| facts["experiments"][index]["parameters"]["drive_max_v"].as_f64();
    assert_eq!((most_v(0), most_v(1)), (Some(90.0), Some(50.0)), "{}", facts["experiments"]);
    let names: Vec<String> = std::fs::read_dir(folder.path("run"))
        .expect("the run")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| name.starts_with("01-") && name.ends_with(".csv"))
        .collect();
    let drive_v = column(&folder.read(&format!("run/{}", names[0])), "command_V");
    assert!((drive_v[drive_v.len() - 1] - 60.0).abs() < 0.1, "{names:?}: {:?}", drive_v.last());
}

#[test]
fn a_recorded_log_is_read_as_it_is() {
    let folder = Folder::new("record-read");
    succeeded(&run(&folder, &call("--set diagnosis", "run")));
    let names = ["01-demagnetising.csv", "02-steps.csv", "03-sines.csv", "04-multisine.csv", "05-hold.csv"];
    for name in names {
        let replay = format!("replay --plant {PLANT} @/run/{name} --out @/p.csv --no-page --json");
        let output = run(&folder, &replay);
        succeeded(&output);
        // Left is the ADC's quantisation, 63.5 nm / sqrt(12) = 18.3 nm; of a plant at rest one code and anything within.
        let rms_um = json(&output)["rms_um"].as_f64().expect("a number");
        let least_um = if name == "05-hold.csv" { 0.0 } else { 0.012 };
        assert!((least_um..0.025).contains(&rms_um), "{name}: {rms_um}");
    }
    // The demagnetising sine does: no hysteron keeps what would move the plant by more than its last cycle, 60 V / 16 of 1.9 um/V, times the
    // share that is hysteresis; a third of that is ample. 21.9 um is what a bench may keep at 0 V.
    let rest_um = column(&folder.read("run/01-demagnetising.csv"), "displacement_um");
    assert!(rest_um.last().expect("rows").abs() < 2.5, "{:?}", rest_um.last());
    let fitted = format!(
        "identify --model phs --plant {PLANT} @/run/03-sines.csv --starts 1 --out @/fitted.toml --no-page --json"
    );
    succeeded(&run(&folder, &fitted));
}

#[test]
fn the_virtual_board_is_recorded_through_its_pins_and_repeats() {
    let Some(image) = image() else { return };
    let folder = Folder::new("record-virtual");
    let call = |out: &str| {
        let spec = "--spec decaying-sine:40V@50Hz/0.1s --spec step:40um@0.05s";
        format!(
            "record --board virtual --image {image} --plant {PLANT} {spec} --controller {PI1} --seed 7 --out @/{out}"
        )
    };
    for out in ["a", "b"] {
        succeeded(&run(&folder, &call(out)));
    }
    for name in ["01-drive-1.csv", "02-pi1-2.csv", "run.json"] {
        assert_eq!(folder.read(&format!("a/{name}")), folder.read(&format!("b/{name}")), "{name}");
    }
    let facts = parsed(&folder.read("a/run.json"));
    assert_eq!((&facts["mode"], &facts["board"]), (&"bench".into(), &"nucleo-g474re".into()));
    // Version and commit, and the image by its hash.
    assert_eq!(facts["firmware"].as_str().expect("text").split(' ').count(), 2);
    assert_eq!(facts["image"]["sha256"].as_str().expect("text").len(), 64);
    let log = folder.read("a/01-drive-1.csv");
    assert!(log.contains("\ntime_s,command_V,displacement_um,drive_V,limited_by\n"), "{log:.600}");
    // The first one starts relaxed.
    let replay = format!("replay --plant {PLANT} @/a/01-drive-1.csv --out @/p.csv --initial relaxed --no-page --json");
    let rms_um = json(&run(&folder, &replay))["rms_um"].as_f64().expect("a number");
    assert!((0.012..0.025).contains(&rms_um), "{rms_um}");
}

#[test]
fn killed_in_the_middle_it_leaves_logs_that_are_read() {
    let folder = Folder::new("record-killed");
    let mut child = spawned(&folder, &call("--spec sine:60V@10Hz/0.5s --spec sine:60V@1Hz/3000s", "run"));
    // Until the second log was accounted for: a second into it.
    let rows = |text: &str| parsed(text)["logs"]["02-drive-2.csv"]["rows"].as_u64().unwrap_or(0);
    child.until(|| folder.path("run/link.json").exists() && rows(&folder.read("run/link.json")) >= 20_000);
    // SIGKILL.
    child.0.kill().expect("killed");
    child.0.wait().expect("ended");
    let stated = rows(&folder.read("run/link.json"));
    let log = folder.read("run/02-drive-2.csv");
    // A kill in the middle of a write leaves a part of a row, which readers leave out.
    let whole = log.split_inclusive('\n').filter(|line| line.ends_with('\n') && !line.starts_with(['#', 't']));
    let kept = whole.count() as u64;
    assert!(kept + 256 >= stated, "{kept} of {stated}");
    for name in ["01-drive-1.csv", "02-drive-2.csv"] {
        let replay = format!("replay --plant {PLANT} @/run/{name} --out @/p.csv --no-page --json");
        succeeded(&run(&folder, &replay));
    }
    let link = parsed(&folder.read("run/link.json"));
    assert_eq!((&link["is_complete"], &link["logs"]["01-drive-1.csv"]["is_complete"]), (&false.into(), &true.into()));
    assert_eq!(parsed(&folder.read("run/run.json"))["seed"], 7);
}

#[test]
fn a_pulled_cable_is_one_line_and_leaves_what_was_recorded() {
    let Some(image) = image() else { return };
    let folder = Folder::new("record-cable");
    let (server, place) = served(&image, &[]);
    // What a board does whose host has gone is its own: the link's silence is a fault (virtual-board/tests/faults.rs).
    let line = format!("record --board tcp:{place} --spec sine:40V@10Hz/1000s --out @/run");
    let mut child = spawned(&folder, &line);
    let rows = |text: &str| parsed(text)["logs"]["log.csv"]["rows"].as_u64().unwrap_or(0);
    let log = folder.path("run/log.csv");
    child.until(|| log.metadata().is_ok_and(|found| found.len() > 60_000));
    // The board is gone.
    drop(server);
    let output = {
        let mut said = String::new();
        let status = child.0.wait().expect("ended");
        std::io::Read::read_to_string(&mut child.0.stderr.take().expect("piped"), &mut said).expect("text");
        (status, said)
    };
    assert_eq!(output.0.code(), Some(4), "{}", output.1);
    // Before it moved it has said what it could not check.
    let [warning, failure] = output.1.lines().collect::<Vec<_>>()[..] else { panic!("{}", output.1) };
    assert!(warning.starts_with("warning: no --plant"), "{warning}");
    assert!(failure.contains("look after cable and board"), "{failure}");
    let kept = column(&folder.read("run/log.csv"), "command_V").len() as u64;
    let stated = rows(&folder.read("run/link.json"));
    assert_eq!(kept, stated);
    assert!(kept > 1000, "{kept}");
    succeeded(&run(&folder, &format!("replay --plant {PLANT} @/run/log.csv --out @/p.csv --no-page --json")));
}

#[test]
fn holes_are_no_success_and_are_named() {
    let Some(image) = image() else { return };
    let folder = Folder::new("record-holes");
    let line = format!(
        "record --board virtual --image {image} --plant {PLANT} --spec sine:40V@50Hz/0.4s --link-faults drop=0.02 --seed 4 --out @/run"
    );
    let output = run(&folder, &line);
    assert_eq!(output.status.code(), Some(4), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("were lost on the link, which identify and diagnose will not take"),
        "{}",
        stderr(&output)
    );
    let link = parsed(&folder.read("run/link.json"));
    let lost = link["logs"]["log.csv"]["lost_samples_total"].as_u64().expect("a number");
    let rows = link["logs"]["log.csv"]["rows"].as_u64().expect("a number");
    assert_eq!(rows + lost, 8000);
    assert!(
        lost >= 1 && link["logs"]["log.csv"]["lost_samples"].as_array().expect("a list").len() as u64 == lost.min(1000)
    );
    let replay = run(&folder, &format!("replay --plant {PLANT} @/run/log.csv --out @/p.csv --no-page"));
    assert_eq!(replay.status.code(), Some(3));
    assert!(stderr(&replay).contains("log.csv"), "{}", stderr(&replay));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_it_in_one_line() {
    let folder = Folder::new("record-full");
    run_on_a_full_disk(&folder, &call("--spec sine:60V@10Hz/1s", "run"));
    succeeded(&run(&folder, &format!("replay --plant {PLANT} @/run/log.csv --out @/p.csv --no-page --json")));
    assert_eq!(parsed(&folder.read("run/link.json"))["is_complete"], false);
}

/// A folder with a controller of narrower limits than the board's own, `narrow.toml`.
fn with_narrow_controller(name: &str) -> Folder {
    let folder = Folder::new(name);
    let pi1 = std::fs::read_to_string(root().join(PI1)).expect("ours");
    folder.write("narrow.toml", pi1.replace("value = -90.0", "value = -50.0").replace("value = 90.0", "value = 50.0"));
    folder
}

#[test]
fn a_board_has_its_own_limits_again_after_a_refusal() {
    let Some(image) = image() else { return };
    let folder = with_narrow_controller("record-refused");
    let (_server, place) = served(&image, &["--pace", "lockstep"]);
    let at = format!("--board tcp:{place} --patience-ms 60000");
    let set_to = || json(&run(&folder, &format!("board parameters {at} --json")))["parameters"].clone();
    let own = set_to();
    let line = format!("record {at} --controller @/narrow.toml --spec step:20um@0.02s --rate 40000 --out @/run");
    let output = run(&folder, &line);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("the link carries every 2th sample only"), "{}", stderr(&output));
    assert_eq!(set_to(), own);
    assert_eq!(own["drive_max_v"], 90.0);
}

/// A board that drives a bench of its own is left at 0 V and with its own limits by who is asked to end.
#[cfg(unix)]
#[test]
fn interrupted_it_stops_the_board_and_gives_it_its_own_limits_back() {
    let Some(image) = image() else { return };
    let folder = with_narrow_controller("record-interrupted");
    // Time passes for the board while it answers, so that a busy machine is no silence.
    let (_server, place) = served(&image, &["--pace", "lockstep"]);
    let at = format!("--board tcp:{place} --patience-ms 60000");
    let set_to = || json(&run(&folder, &format!("board parameters {at} --json")))["parameters"].clone();
    let own = set_to();
    let line = format!("record {at} --plant {PLANT} --controller @/narrow.toml --spec step:20um@1000s --out @/run");
    let mut child = spawned(&folder, &line);
    let log = folder.path("run/log.csv");
    child.until(|| log.metadata().is_ok_and(|found| found.len() > 2000));
    let id = child.0.id().to_string();
    assert!(std::process::Command::new("kill").args(["-TERM", &id]).status().expect("kill").success());
    let status = child.0.wait().expect("ended");
    let mut said = String::new();
    std::io::Read::read_to_string(&mut child.0.stderr.take().expect("piped"), &mut said).expect("text");
    assert_eq!(status.code(), Some(4), "{said}");
    assert!(said.contains("hysteron: interrupted: ") && said.contains("the board is stopped, at 0 V"), "{said}");
    assert_eq!(set_to(), own);
    assert_eq!(parsed(&folder.read("run/link.json"))["is_complete"], false);
    // Nothing is left running that would be in the next one's way.
    succeeded(&run(&folder, &format!("record {at} --spec hold:1V@0.01s --out @/next")));
}

/// Who has narrowed a board's own limits may think that they hold in closed loop as well.
#[test]
fn a_controller_of_wider_limits_than_the_boards_own_is_told() {
    let Some(image) = image() else { return };
    let folder = Folder::new("record-wider");
    let (_server, place) = served(&image, &["--pace", "lockstep"]);
    let at = format!("--board tcp:{place} --patience-ms 60000");
    let record = |out: &str| {
        let line = format!("record {at} --plant {PLANT} --controller {PI1} --spec step:5um@0.01s --out @/{out}");
        succeeded(&run(&folder, &line))
    };
    assert!(!record("a").contains("its limits"));
    succeeded(&run(&folder, &format!("board parameters {at} --set drive_min_v=-40 --set drive_max_v=40")));
    let said = record("b");
    let words = "pi1.toml: its limits, -90 to 90 V, 400000 V/s, clamp 100.00 um and trip 120.00 um, hold in closed loop in place of the board's narrower ones, -40 to 40 V, ";
    assert!(said.contains(words), "{said}");
}

/// Of a log that was not begun nothing can be said to be its end.
#[test]
fn a_fault_while_demagnetising_is_told_as_such() {
    let folder = Folder::new("record-demagnetising");
    let plant = std::fs::read_to_string(root().join(PLANT)).expect("ours");
    let plant = plant.replace("displacement_max_um = { value = 120.0", "displacement_max_um = { value = 500.0");
    let away =
        "[initial_state]\ndisplacement_um = 125.0\nvelocity_um_per_s = 0.0\nhysteron_V = [0.0, 0.0]\ndrive_V = 0.0\n";
    folder.write("away.toml", format!("{plant}\n{away}"));
    let output = run(&folder, &call("--set diagnosis", "run").replace(PLANT, "@/away.toml"));
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(4), "{said}");
    let log = folder.path("run/01-demagnetising.csv");
    let words = format!("while demagnetising before {}, which was not begun", log.display());
    assert!(said.contains("displacement_trip") && said.contains(&words) && said.lines().count() == 1, "{said}");
    assert!(!log.exists());
    let link = parsed(&folder.read("run/link.json"));
    assert_eq!((&link["is_complete"], &link["logs"]["01-demagnetising.csv"]["rows"]), (&false.into(), &0.into()));
}

#[test]
fn a_plant_that_does_not_say_what_its_stage_stands_is_told_so() {
    let folder = Folder::new("record-no-rig");
    let plant = std::fs::read_to_string(root().join(PLANT)).expect("a plant of the project");
    let (plant, _) = plant.split_once("[rig]").expect("its last section");
    folder.write("plant.toml", plant);
    let output = run(&folder, &call("--spec hold:1V@0.01s", "run").replace(PLANT, "@/plant.toml"));
    assert!(succeeded(&output).contains("--plant has no [rig]"), "{}", stderr(&output));
    assert!(!succeeded(&run(&folder, &call("--spec hold:1V@0.01s", "b"))).contains("[rig]"));
}

#[test]
fn what_cannot_be_is_one_line_with_its_code_and_leaves_no_run() {
    let folder = Folder::new("record-bad");
    std::fs::create_dir(folder.path("full")).expect("a folder");
    folder.write("full/keep.txt", "somebody's");
    folder.write("plain.txt", "no port");
    folder.write("pi1.toml", "");
    for name in ["a", "b"] {
        std::fs::create_dir(folder.path(name)).expect("a folder");
        folder.write(&format!("{name}/wave.csv"), "1.0\n".repeat(20));
    }
    let plant = std::fs::read_to_string(root().join(PLANT)).expect("a plant of the project");
    let away =
        "[initial_state]\ndisplacement_um = 130.0\nvelocity_um_per_s = 0.0\nhysteron_V = [0.0, 0.0]\ndrive_V = 0.0\n";
    folder.write("away.toml", format!("{plant}\n{away}"));
    folder.write(
        "narrow.toml",
        plant.replace("displacement_max_um = { value = 120.0", "displacement_max_um = { value = 60.0"),
    );
    folder.write("unipolar.toml", plant.replace("drive_min_V = { value = -90.0", "drive_min_V = { value = -20.0"));
    let good = call("--spec sine:60V@10Hz/0.1s", "run");
    let closed = call("--spec step:40um@0.1s", "run");
    let at = |board: &str| format!("record --board {board} --spec sine:60V@10Hz/0.1s --out @/run");
    let cases = [
        (
            at("serial:/dev/not-there"),
            2,
            "serial:/dev/not-there: No such file or directory (os error 2); plug the board in",
        ),
        (at("serial:@/plain.txt"), 2, "plain.txt: no serial port; name another port"),
        (
            at(&impostor(Some(identity("0.0.9 abc")))),
            4,
            concat!("the board runs firmware 0.0.9 abc, this program is ", env!("CARGO_PKG_VERSION"), ": flash"),
        ),
        // What another baud rate makes of an answer: bytes that are no frame.
        (
            at(&impostor(Some(vec![0x5c, 0xff, 0xe0, 0x00, 0x7c, 0x1f, 0x00]))) + " --patience-ms 50",
            4,
            "the board does not answer Hello; look after power, cable, port and baud rate",
        ),
        (at(&impostor(None)), 4, "look after cable and board"),
        (at("in-process"), 2, "--board in-process has no pins: give --plant"),
        (at("virtual"), 2, "--board virtual needs --image"),
        (closed.clone(), 2, "step:40um@0.1s is a displacement: give --controller"),
        (format!("{closed} --controller controllers/pi1-unlimited.toml"), 2, "must be finite on a board"),
        (format!("{closed} --controller {PI1} --controller @/pi1.toml"), 2, "two are called pi1"),
        (
            format!("{good} --controller {PI1}"),
            2,
            "--controller: nothing that is played is a reference, in um: leave it out",
        ),
        (format!("{closed} --controller {PI1} --rate 10000 --plant @/none.toml"), 2, "--plant"),
        (call("--set thesis", "run"), 2, "nothing but loops: give --controller"),
        (call("--set other", "run"), 2, "thesis or diagnosis"),
        (call("--spec hold:4V", "run"), 2, "hold:4V has no length of its own: add `,for=2s`"),
        (call("--spec hold:4V@1e-9s", "run"), 2, "a log has 16 to"),
        (call("--spec hold:4V@1s,shaped", "run"), 2, "`,shaped` is not played by a board"),
        (call("--spec multisine:4V@1-100Hz", "run"), 2, "a board holds 4096"),
        (call("--spec hold:70V@0.1s", "run"), 2, "hold:70V@0.1s: it would take the stage to 136 um, and the [rig]"),
        (
            good.replace(PLANT, "@/unipolar.toml"),
            2,
            "it would drive from -60.0 to 60.0 V, and the [rig] of --plant stands -20 to 90 V: lower the volts",
        ),
        // A run begins where the plant's file says.
        (good.replace(PLANT, "@/away.toml"), 2, "it would take the stage to 126 um"),
        // What is played before each of a set's loops is a drive in open loop as well.
        (
            call("--set thesis", "run").replace(PLANT, "@/narrow.toml") + " --controller " + PI1,
            2,
            "decaying-sine:60V@8Hz/1s: it would take the stage to 87 um",
        ),
        // In closed loop it is the controller's limits that hold.
        (
            format!("{closed} --controller {PI1}").replace(PLANT, "@/narrow.toml"),
            2,
            "pi1.toml: the displacement trip of 120 um lies above [rig] displacement_max_um = 60: set it to 60 um at the most",
        ),
        (
            format!("{closed} --controller {PI1}").replace(PLANT, "@/unipolar.toml"),
            2,
            "pi1.toml: the drive limits of -90 to 90 V reach beyond [rig] drive_min_V = -20 and drive_max_V = 90: set them within",
        ),
        (call("--spec file:@/none.csv,unit=V", "run"), 3, "none.csv cannot be read"),
        (
            call("--spec file:@/a/wave.csv,unit=V --spec file:@/b/wave.csv,unit=V", "run"),
            2,
            "b/wave.csv: two played files are called wave.csv, and the run directory keeps both; rename one",
        ),
        (good.clone() + " --rate 19999", 2, "does not divide the timer's clock"),
        (good.clone() + " --link-faults soup=1", 2, "--link-faults: soup"),
        (good.clone() + " --size 0.5", 2, "cannot be used with"),
        (call("--set diagnosis --size 2", "run"), 2, "must not be greater than 1"),
        (good.replace(PLANT, "@/none.toml"), 3, "none.toml"),
        (good.replace("@/run", "@/full"), 2, "full: holds files already"),
        (good.replace("@/run", "@/plain.txt"), 2, "plain.txt: cannot be written"),
    ];
    for (call, code, words) in cases {
        let output = run(&folder, &call);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{call}: {said}");
        assert!(said.contains(words), "{call}: {said}");
        assert_eq!(said.lines().count(), 1, "{call}: {said}");
        assert!(!folder.path("run").exists(), "{call}");
    }
    assert_eq!(folder.read("full/keep.txt"), "somebody's");
}
