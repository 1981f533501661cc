//! `hysteron hil` from the command line: a run directory that repeats, survives a killed program, and calls that can't be meant.

mod support;

use std::io::{Read, Write};
use std::net::TcpListener;
use support::{
    Folder, PI1, PLANT, hysteron, identity, image, impostor, root, run, run_on_a_full_disk, served, spawned, stderr,
    stdout,
};

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).expect("JSON")
}

/// The run that most tests repeat.
fn call(board: &str, out: &str) -> String {
    format!(
        "hil --board {board} --plant {PLANT} --controller {PI1} --reference step:80um --seconds 0.05 --seed 7 --out @/{out}"
    )
}

/// The row part of a log: what the metadata say of the board may differ between links.
fn rows(log: &str) -> &str {
    &log[log.find("time_s").expect("a header")..]
}

#[test]
fn a_run_directory_holds_what_a_repetition_needs_and_repeats_from_it() {
    let folder = Folder::new("hil");
    let output = run(&folder, &call("in-process", "a"));
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stdout(&output).contains("board"), "{}", stdout(&output));
    let log = folder.read("a/log.csv");
    assert!(log.contains("\ntime_s,command_V,displacement_um,reference_um,limited_by\n"), "{log:.600}");
    for key in ["# rate_hz: 20000\n", "# latency_us: 10\n", "# controller: pi1.toml\n", "# seed: 7\n", "# firmware: "] {
        assert!(log.contains(key), "{key}");
    }
    for (copy, original) in [("a/plant.toml", PLANT), ("a/controller.toml", PI1)] {
        assert_eq!(folder.read(copy), std::fs::read_to_string(root().join(original)).expect("ours"));
    }
    let (facts, link) = (json(&folder.read("a/run.json")), json(&folder.read("a/link.json")));
    assert_eq!((&facts["schema"], &facts["seed"]), (&"hysteron-run-1".into(), &7.into()));
    assert_eq!((&facts["reference"], &facts["samples"]), (&"step:80um".into(), &1000.into()));
    let set_to = &facts["parameters"];
    assert_eq!((&set_to["kp_v_per_m"], &set_to["adc_zero_v"]), (&858_110.0.into(), &1.65.into()));
    assert_eq!((&link["rows"], &link["lost"], &link["is_complete"]), (&1000.into(), &0.into(), &true.into()));
    assert_eq!((&link["fault"], &link["round_trips"].as_u64().map(|n| n >= 1000)), (&"none".into(), &Some(true)));

    // From what the directory holds, the same bits.
    let again = format!(
        "hil --board in-process --plant @/a/plant.toml --controller @/a/controller.toml --reference {} --seconds 0.05 --seed {} --out @/b",
        facts["reference"].as_str().expect("text"),
        facts["seed"]
    );
    assert!(run(&folder, &again).status.success());
    assert_eq!(rows(&folder.read("b/log.csv")), rows(&log));

    // And it is a log: replay takes it. Left is the ADC's quantisation, 63.5 nm / sqrt(12) = 18.3 nm.
    let replay = format!("replay --plant {PLANT} @/a/log.csv --out @/p.csv --initial relaxed --no-page --json");
    let rms_um = json(&stdout(&run(&folder, &replay)))["rms_um"].as_f64().expect("a number");
    assert!((0.012..0.025).contains(&rms_um), "{rms_um}");
}

#[test]
fn a_reference_from_a_file_is_kept_with_the_run() {
    let folder = Folder::new("hil-file");
    let samples: String = (0..400).map(|k| format!("{}\n", f64::from(k % 200) * 0.1)).collect();
    let text = format!("reference_um\n{samples}");
    folder.write("ramp.csv", &text);
    let played = |path: &str, out: &str| call("in-process", out).replace("step:80um", &format!("file:{path}"));
    let output = run(&folder, &played("@/ramp.csv", "a"));
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(folder.read("a/reference-ramp.csv"), text);
    assert_eq!(json(&folder.read("a/run.json"))["reference_files"][0]["file"], "ramp.csv");
    std::fs::remove_file(folder.path("ramp.csv")).expect("there");
    assert!(run(&folder, &played("@/a/reference-ramp.csv", "b")).status.success());
    assert_eq!(folder.read("b/log.csv"), folder.read("a/log.csv"));
}

#[test]
fn killed_in_the_middle_it_leaves_a_log_that_is_read() {
    let folder = Folder::new("hil-killed");
    let line = call("in-process", "run").replace("0.05", "5000");
    let mut child = spawned(&folder, &line);
    // Until link.json was written for the first time: a second into the run.
    child.until(|| folder.path("run/link.json").exists());
    let stated = json(&folder.read("run/link.json"))["rows"].as_u64().expect("a number");
    // SIGKILL.
    child.0.kill().expect("killed");
    child.0.wait().expect("ended");
    let log = folder.read("run/log.csv");
    // A kill in the middle of a write leaves a part of a row, which readers leave out.
    let (whole, part) = log.rsplit_once('\n').expect("rows");
    let last = whole.lines().last().expect("a row");
    assert!(last.split(',').count() == 5 && part.split(',').count() <= 5, "{last} {part}");
    // At most a hand-over behind: 256 rows.
    let kept = rows(whole).lines().count() as u64 - 1;
    assert!(kept + 256 >= stated && kept >= 1000, "{kept} of {stated}");
    let replay = format!("replay --plant {PLANT} @/run/log.csv --out @/p.csv --initial relaxed --no-page --json");
    let replayed = run(&folder, &replay);
    assert!(replayed.status.success(), "{}", stderr(&replayed));
    assert_eq!(json(&folder.read("run/run.json"))["seed"], 7);
    assert_eq!(json(&folder.read("run/link.json"))["is_complete"], false);
}

/// Asked to end, it leaves the board idle and its own, whatever the controller's limits were.
#[cfg(unix)]
#[test]
fn interrupted_it_leaves_the_board_in_order_and_says_so_in_one_line() {
    let folder = Folder::new("hil-interrupted");
    let pi1 = std::fs::read_to_string(root().join(PI1)).expect("ours");
    folder.write("narrow.toml", pi1.replace("value = -90.0", "value = -50.0").replace("value = 90.0", "value = 50.0"));
    let board = slow_board(std::time::Duration::ZERO);
    let own = set_to(&folder, &board);
    let line = call(&board, "run").replace(PI1, "@/narrow.toml").replace("0.05", "5000");
    let mut child = spawned(&folder, &line);
    // A second into the run.
    child.until(|| folder.path("run/link.json").exists());
    let id = child.0.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().expect("kill").success());
    let status = child.0.wait().expect("ended");
    let mut said = String::new();
    child.0.stderr.take().expect("piped").read_to_string(&mut said).expect("text");
    assert_eq!(status.code(), Some(4), "{said}");
    assert!(said.starts_with("hysteron: interrupted: ") && said.contains("the board is stopped, at 0 V"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert_eq!(set_to(&folder, &board), own);
    let link = json(&folder.read("run/link.json"));
    let kept = rows(&folder.read("run/log.csv")).lines().count() as u64 - 1;
    assert_eq!((&link["is_complete"], link["rows"].as_u64()), (&false.into(), Some(kept)));
}

#[test]
fn a_bad_link_is_in_the_statistics_and_the_run_says_so() {
    let folder = Folder::new("hil-faults");
    let faulty = |out: &str| call("in-process", out) + " --link-faults drop=0.005,flip=0.005 --json";
    let output = run(&folder, &faulty("a"));
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains("were lost on the link"), "{}", stderr(&output));
    let (said, link) = (json(&stdout(&output)), json(&folder.read("a/link.json")));
    let lost = link["lost_samples"].as_array().expect("a list").len();
    assert!(lost > 5, "{lost}");
    assert_eq!((&said["lost_samples"], &link["lost_samples_total"]), (&lost.into(), &lost.into()));
    assert_eq!(json(&folder.read("a/run.json"))["link_faults"]["seed"], 7);
    assert!(run(&folder, &faulty("b")).status.success());
    assert_eq!(folder.read("a/log.csv"), folder.read("b/log.csv"));
}

#[test]
fn over_tcp_and_a_pseudo_terminal_the_virtual_board_gives_the_bits_of_the_law_in_process() {
    let Some(image) = image() else { return };
    let folder = Folder::new("hil-boards");
    let short = |board: &str, out: &str| call(board, out).replace("0.05", "0.01");
    assert!(run(&folder, &short("in-process", "law")).status.success());
    let output = run(&folder, &(short("virtual", "virtual") + &format!(" --image {image}")));
    assert!(output.status.success(), "{}", stderr(&output));
    let law = folder.read("law/log.csv");
    let of_image = |out: &str| json(&folder.read(&format!("{out}/run.json")))["image"]["file"].clone();
    assert_eq!((of_image("virtual"), of_image("law")), ("nucleo-g474re".into(), serde_json::Value::Null));
    assert_eq!(rows(&folder.read("virtual/log.csv")), rows(&law));
    let mut kinds: Vec<(&str, &[&str])> = vec![("tcp", &["--pace", "lockstep"])];
    if cfg!(unix) {
        kinds.push(("serial", &["--pace", "lockstep", "--pty"]));
    }
    for (kind, more) in kinds {
        let (_server, place) = served(&image, more);
        let output = run(&folder, &(short(&format!("{kind}:{place}"), kind) + " --patience-ms 60000"));
        assert!(output.status.success(), "{}", stderr(&output));
        assert_eq!(rows(&folder.read(&format!("{kind}/log.csv"))), rows(&law), "{kind}");
    }
}

#[test]
fn a_board_that_goes_away_leaves_what_was_recorded() {
    let folder = Folder::new("hil-gone");
    let output = run(&folder, &(call("in-process", "run") + " --link-faults drop=1"));
    assert_eq!(output.status.code(), Some(4));
    assert!(stderr(&output).contains("the board is gone: 20 requests in a row"), "{}", stderr(&output));
    // The first sample was answered; 19 more were lost one by one before the board counted as gone.
    assert_eq!(rows(&folder.read("run/log.csv")).lines().count(), 1 + 1 + 19);
    let link = json(&folder.read("run/link.json"));
    assert_eq!((&link["is_complete"], &link["lost"]), (&false.into(), &20.into()));
}

#[test]
fn a_probe_says_what_the_link_does() {
    let output = hysteron(["hil", "--board", "in-process", "--probe-link", "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let said = json(&stdout(&output));
    assert_eq!((&said["link"]["round_trips"], &said["link"]["lost"]), (&10_000.into(), &0.into()));
    assert!(said["link"]["round_trip_us"]["p99_9"].as_f64() >= said["link"]["round_trip_us"]["p50"].as_f64());
}

/// A board in process behind TCP that takes its time, and is there for one call after the other.
fn slow_board(delay: std::time::Duration) -> String {
    use hil_bridge::link::Link;
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || {
        let mut board = hil_bridge::in_process::InProcess::nucleo();
        let (mut bytes, mut answer) = ([0; 512], Vec::new());
        while let Ok((mut host, _)) = listener.accept() {
            while let Ok(n @ 1..) = host.read(&mut bytes) {
                std::thread::sleep(delay);
                answer.clear();
                let told = board.send(&bytes[..n]).and_then(|()| board.receive(delay, &mut answer));
                if told.is_err() || host.write_all(&answer).is_err() {
                    break;
                }
            }
        }
    });
    format!("tcp:{address}")
}

/// What a board is set to, as `board parameters` says it.
fn set_to(folder: &Folder, board: &str) -> serde_json::Value {
    let output = run(folder, &format!("board parameters --board {board} --json"));
    json(&stdout(&output))["parameters"].take()
}

#[test]
fn a_reference_beyond_the_clamp_is_told_as_limited() {
    let folder = Folder::new("hil-limited");
    let line = call("in-process", "run").replace("step:80um", "sine:200um@10Hz").replace("0.05", "0.02") + " --json";
    let output = run(&folder, &line);
    let said = json(&stdout(&output));
    assert!(said["limited_samples"].as_u64().is_some_and(|n| (100..400).contains(&n)), "{said}");
    let words = format!("limits acted in {} of 400 samples: reference clamp", said["limited_samples"]);
    assert!(stderr(&output).contains(&words), "{}", stderr(&output));
    assert_eq!(json(&folder.read("run/link.json"))["limited_samples"], said["limited_samples"]);
}

/// Whatever ends a call, its controller's limits are none of the next one's: an open loop would have them for the board's own.
#[test]
fn a_board_has_its_own_limits_again_after_a_refusal_a_fault_and_a_run() {
    let folder = Folder::new("hil-limits");
    let pi1 = std::fs::read_to_string(root().join(PI1)).expect("ours");
    let narrow = pi1.replace("value = -90.0", "value = -50.0").replace("value = 90.0", "value = 50.0");
    folder.write("narrow.toml", &narrow);
    folder.write("wild.toml", narrow.replace("8.5811e5", "8.5811e7"));
    let plant = std::fs::read_to_string(root().join(PLANT)).expect("ours");
    let away =
        "[initial_state]\ndisplacement_um = 125.0\nvelocity_um_per_s = 0.0\nhysteron_V = [0.0, 0.0]\ndrive_V = 0.0\n";
    folder.write("away.toml", format!("{plant}\n{away}"));
    let board = slow_board(std::time::Duration::ZERO);
    let own = set_to(&folder, &board);
    assert_eq!((&own["drive_max_v"], &own["rate_hz"]), (&90.0.into(), &20e3.into()));
    let cases = [
        ("unstable", "wild.toml", PLANT, "", 2, "unstable"),
        // 40 kHz would have to be answered in 12.5 us, over TCP.
        ("fast", "narrow.toml", PLANT, "--rate 40000 --paced", 2, "is too fast in real time"),
        ("fault", "narrow.toml", "@/away.toml", "", 4, "(displacement_trip)"),
        ("run", "narrow.toml", PLANT, "--clear-fault", 0, ""),
    ];
    for (out, controller, plant, more, code, words) in cases {
        let line = call(&board, out).replace(PI1, &format!("@/{controller}")).replace(PLANT, plant);
        let output = run(&folder, &format!("{line} {more}"));
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{out}: {said}");
        assert!(said.contains(words) && said.lines().count() <= 1, "{out}: {said}");
        assert_eq!(set_to(&folder, &board), own, "{out}");
    }
    // In a fault a board takes no other rate; the limits it does.
    let line = call(&board, "slow").replace(PI1, "controllers/pi2.toml").replace(PLANT, "@/away.toml");
    let output = run(&folder, &format!("{line} --rate 10000"));
    assert_eq!((output.status.code(), stderr(&output).lines().count()), (Some(4), 1), "{}", stderr(&output));
    let mut expected = own;
    expected["rate_hz"] = 10e3.into();
    assert_eq!(set_to(&folder, &board), expected);
}

#[test]
fn paced_it_keeps_to_the_clock_and_refuses_a_link_that_is_too_slow_with_the_numbers() {
    let folder = Folder::new("hil-paced");
    let paced = |board: &str, out: &str| {
        call(board, out).replace("pi1.toml", "pi2.toml").replace("0.05", "0.2") + " --rate 5000 --paced"
    };
    // Half a sample of 200 us is for the machine to hold: one that is busy may refuse now and then. What the loop does with the clock is
    // tested on a clock of the test's own, in hil-bridge/tests/paced.rs.
    let kept = (0..20).find_map(|_| {
        let begun = std::time::Instant::now();
        let output = run(&folder, &paced("in-process", "run"));
        if stderr(&output).contains("is too fast in real time") {
            std::thread::sleep(std::time::Duration::from_millis(200));
            return None;
        }
        Some((output, begun.elapsed().as_secs_f64()))
    });
    if let Some((output, seconds)) = kept {
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(seconds > 0.19, "{seconds}");
        let facts = json(&folder.read("run/run.json"));
        assert_eq!((&facts["mode"], &facts["latency_us"]), (&"paced".into(), &100.0.into()));
        assert!(folder.read("run/log.csv").contains("# latency_us: 100\n"));
        assert!(json(&folder.read("run/link.json"))["slips"].is_u64());
        // What the loop is worth at this rate and with this delay, of each controller that lies there.
        for told in ["pi1.toml unstable", "pi2.toml stable: gain margin"] {
            assert!(stdout(&output).contains(told), "{told}: {}", stdout(&output));
        }
    } else {
        eprintln!(
            "not run: this machine holds no half sample of 100 us in 20 attempts, a run in real time was only refused"
        );
    }

    let board = slow_board(std::time::Duration::from_micros(300));
    let output = run(&folder, &paced(&board, "slow"));
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("5000 Hz is too fast in real time: 99.9 % of the round trips over this link take up to "),
        "{said}"
    );
    assert!(said.contains("pi1.toml unstable") && said.contains("pi2.toml ") && said.lines().count() == 1, "{said}");
    assert!(!folder.path("slow").exists());
    assert_eq!(set_to(&folder, &board)["kp_v_per_m"], 858_110.0, "pi1's, as it was");
    // An unstable loop is refused although the link would do.
    let output = run(&folder, &paced("in-process", "unstable").replace("pi2.toml", "pi1.toml"));
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("unstable"), "{}", stderr(&output));
}

#[test]
fn what_cannot_be_is_one_line_with_its_code_and_leaves_no_run() {
    let folder = Folder::new("hil-bad");
    folder.write("plain.txt", "no port");
    std::fs::create_dir(folder.path("full")).expect("a folder");
    folder.write("full/keep.txt", "somebody's");
    for name in ["a", "b"] {
        std::fs::create_dir(folder.path(name)).expect("a folder");
        folder.write(&format!("{name}/wave.csv"), "1.0\n".repeat(20));
    }
    let vacant = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
    let good = call("in-process", "run");
    let at = |board: &str| call(board, "run");
    let cases = [
        (
            at("serial:/dev/not-there"),
            2,
            "serial:/dev/not-there: No such file or directory (os error 2); plug the board in",
        ),
        (at("serial:@/plain.txt"), 2, "plain.txt: no serial port; name another port"),
        (at(&format!("tcp:{vacant}")), 2, "Connection refused (os error 111); start `hysteron board serve` there"),
        (at("tcp:nowhere.invalid:1"), 2, "tcp:nowhere.invalid:1: "),
        (at("usb:1"), 2, "in-process, virtual, tcp:HOST:PORT or serial:PATH"),
        (at("virtual"), 2, "--board virtual needs --image"),
        (at("virtual") + " --image @/plain.txt", 3, "plain.txt"),
        (good.clone() + " --image @/plain.txt", 2, "leave it out"),
        (
            at(&impostor(Some(identity("0.0.9 abc")))),
            4,
            concat!("the board runs firmware 0.0.9 abc, this program is ", env!("CARGO_PKG_VERSION"), ": flash"),
        ),
        (at(&impostor(Some(vec![7, 7, 0]))) + " --patience-ms 50", 4, "the board does not answer Hello"),
        (at(&impostor(None)), 4, "look after cable and board"),
        (good.replace("pi1.toml", "pi1-unlimited.toml"), 2, "must be finite on a board"),
        (good.replace(PLANT, "@/none.toml"), 3, "none.toml"),
        (good.replace("step:80um", "step:80V"), 2, "give its amplitudes in um"),
        (
            good.replace("step:80um", "file:@/a/wave.csv,for=0.001s+file:@/b/wave.csv"),
            2,
            "b/wave.csv: two played files are called wave.csv, and the run directory keeps both; rename one",
        ),
        (good.replace("step:80um", "step:80um,shaped"), 2, "`,shaped` is not played by a board"),
        (good.replace("--seconds 0.05", ""), 2, "give --seconds"),
        (good.replace("0.05", "1e-9"), 2, "change --seconds or --rate"),
        (good.clone() + " --rate 19999", 2, "does not divide the timer's clock"),
        (good.clone() + " --link-faults soup=1", 2, "--link-faults: soup"),
        (good.replace("@/run", "@/full"), 2, "full: holds files already"),
        (good.replace("@/run", "@/plain.txt"), 2, "plain.txt: cannot be written"),
        (good.replace("--out @/run", ""), 2, "--out"),
    ];
    for (call, code, words) in cases {
        let output = run(&folder, &call);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{call}: {said}");
        assert!(said.contains(words), "{call}: {said}");
        assert_eq!(said.lines().filter(|line| line.starts_with("hysteron: ")).count(), 1, "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(!folder.path("run").exists(), "{call}");
    }
    assert_eq!(folder.read("full/keep.txt"), "somebody's");
}

#[cfg(unix)]
#[test]
fn a_port_without_permission_says_who_may() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new("hil-permission");
    let path = folder.write("port", "");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o000)).expect("ours");
    if std::fs::File::open(&path).is_ok() {
        println!("not run: this user may open everything");
        return;
    }
    let output = run(&folder, &call("serial:@/port", "run"));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("dialout"), "{}", stderr(&output));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_run_in_one_line_and_stops_the_board() {
    let folder = Folder::new("hil-full");
    run_on_a_full_disk(&folder, &call("in-process", "run").replace("0.05", "1"));
    let replay = format!("replay --plant {PLANT} @/run/log.csv --out @/p.csv --initial relaxed --no-page --json");
    assert!(run(&folder, &replay).status.success());
    assert_eq!(json(&folder.read("run/link.json"))["is_complete"], false);
}
