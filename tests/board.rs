//! `hysteron board run`: the flash image in closed loop from the command line. The image is built by `cargo xtask firmware`.

mod support;

use control_core::{FaultCode, ModeName};
use std::sync::atomic::Ordering;
use support::{
    Folder, PI1, PLANT, column, fake_board, identity, image, impostor, json, root, run, served, spawned, stderr,
    stdout, succeeded,
};

#[test]
fn a_step_on_the_image_writes_a_log_and_a_report_and_repeats() {
    let Some(image) = image() else { return };
    let folder = Folder::new("board");
    let call = |out: &str| {
        format!(
            "board run {image} --plant {PLANT} --controller {PI1} --reference step:80um --seconds 0.05 --out @/{out}"
        )
    };
    let output = run(&folder, &call("a.csv"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let log = folder.read("a.csv");
    assert!(log.contains("\ntime_s,command_V,displacement_um,reference_um,drive_V,limited_by\n"), "{log:.600}");
    for key in ["# rate_hz: 20000\n", "# latency_us: 10\n", "# controller: pi1.toml\n", "# adc_lsb_um: 0.063"] {
        assert!(log.contains(key), "{key}");
    }
    let report: serde_json::Value = serde_json::from_str(&folder.read("a.board.json")).unwrap();
    assert_eq!(report["samples"], 1000);
    assert_eq!(report["period_cycles"], serde_json::json!([8500, 8500]));
    assert_eq!(report["latch_cycles"], serde_json::json!([1700, 1700]));
    assert_eq!((&report["overruns"], &report["fault"]), (&0.into(), &"none".into()));
    assert_eq!(report["instructions_from_flash"], 0);
    // The step is reached, and the bender's limit is not.
    let peak_um = report["peak_um"].as_f64().unwrap();
    assert!((80.0..110.0).contains(&peak_um), "{peak_um}");
    // The same call, the same bytes.
    assert!(run(&folder, &call("b.csv")).status.success());
    assert_eq!(log, folder.read("b.csv"));
    // A log of the board is a log: replay takes it.
    let replay = format!("replay --plant {PLANT} @/a.csv --out @/p.csv --initial relaxed --no-page --json");
    let replayed = run(&folder, &replay);
    let replayed: serde_json::Value = serde_json::from_slice(&replayed.stdout).unwrap();
    // Left is the ADC's quantisation, 63.5 nm / sqrt(12) = 18.3 nm, seen through no more than rounding.
    let rms_um = replayed["rms_um"].as_f64().unwrap();
    assert!((0.012..0.025).contains(&rms_um), "{rms_um}");
}

#[test]
fn the_image_for_external_converters_runs_the_same_way() {
    let Some(image) = image() else { return };
    let image = image.replace("nucleo-g474re", "external-16bit");
    let folder = Folder::new("board-external");
    let line = format!(
        "board run {image} --plant {PLANT} --controller {PI1} --reference sine:80um@100Hz --seconds 0.05 --out @/a.csv"
    );
    let output = run(&folder, &line);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let log = folder.read("a.csv");
    // 260 um over 2^16.
    assert!(log.contains("# adc_lsb_um: 0.00396") && log.contains("# board: external-16bit (virtual)"), "{log:.400}");
    let report: serde_json::Value = serde_json::from_str(&folder.read("a.board.json")).unwrap();
    assert_eq!((&report["latch_cycles"], &report["fault"]), (&serde_json::json!([1700, 1700]), &"none".into()));
}

#[test]
fn wrong_calls_say_what_is_wrong() {
    let folder = Folder::new("board-wrong");
    let cases = [
        (
            "board run @/none.elf --plant models/thesis-phs.toml --command step:2V --seconds 1 --out @/x.csv",
            3,
            "cargo xtask firmware",
        ),
        (
            "board run Cargo.toml --plant models/thesis-phs.toml --command step:2V --seconds 1 --out @/x.csv",
            3,
            "no 32-bit ELF",
        ),
        ("board run Cargo.toml --out @/x.csv --command step:2V", 2, "--plant"),
    ];
    for (line, code, words) in cases {
        let output = run(&folder, line);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{line}: {said}");
        assert!(said.contains(words) && said.lines().count() == 1, "{line}: {said}");
    }
    let Some(image) = image() else { return };
    let cases = [
        ("--controller controllers/pi1-unlimited.toml --reference step:80um", "finite on a board"),
        ("--controller controllers/pi1.toml --reference step:80um --rate 21000", "does not divide"),
        ("--command step:2um", "is a voltage"),
        ("--command step:2V,shaped", "shaped"),
    ];
    for (arguments, words) in cases {
        let line = format!("board run {image} --plant {PLANT} --seconds 0.01 --out @/x.csv {arguments}");
        let output = run(&folder, &line);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(said.contains(words) && said.lines().count() == 1, "{line}: {said}");
    }
}

#[test]
fn a_host_on_tcp_greets_the_served_image_and_reads_its_parameters() {
    use std::io::{Read, Write};
    let Some(image) = image() else { return };
    let (mut server, address) = served(&image, &["--pace", "lockstep", "--seconds", "0.1"]);
    assert!(address.starts_with("127.0.0.1:"), "{address}");
    let mut line = std::net::TcpStream::connect(&address).unwrap();
    let (mut sender, mut receiver) = (wire::Sender::default(), wire::Receiver::new());
    let mut ask = |request: &wire::ToBoard<'_>| -> Option<wire::Parameters> {
        let mut frame = [0; wire::MAX_ENCODED_BYTES];
        let n = sender.encode(request, &mut frame).unwrap();
        line.write_all(&frame[..n]).ok()?;
        loop {
            let mut byte = [0];
            line.read_exact(&mut byte).ok()?;
            match receiver.push(byte[0]).map(|frame| frame.unwrap().message::<wire::ToHost<'_>>().unwrap()) {
                Some(wire::ToHost::Parameters(parameters)) => return Some(parameters),
                Some(wire::ToHost::Identity(identity)) => {
                    assert_eq!((identity.board, identity.version), ("nucleo-g474re", wire::VERSION));
                    return Some(wire::Parameters::NUCLEO_PI1);
                }
                Some(other) => panic!("{other:?}"),
                None => {}
            }
        }
    };
    assert!(ask(&wire::ToBoard::Hello).is_some());
    assert_eq!(ask(&wire::ToBoard::GetParameters), Some(wire::Parameters::NUCLEO_PI1));
    // Each answer takes some of the 0.1 s that it is to run for: then it goes, with exit code 0.
    while ask(&wire::ToBoard::GetParameters).is_some() {}
    assert_eq!(server.0.wait().unwrap().code(), Some(0));
}

#[test]
fn a_calibration_is_checked_put_in_force_and_kept() {
    let Some(image) = image() else { return };
    let folder = Folder::new("board-parameters");
    let (_server, place) = served(&image, &["--pace", "lockstep"]);
    let at = format!("--board tcp:{place} --patience-ms 60000");
    let parameters = |more: &str| run(&folder, &format!("board parameters {at} {more}"));
    let shown = |more: &str| stdout(&parameters(more)).split_whitespace().collect::<Vec<_>>().join(" ");
    let said = shown("");
    assert!(
        said.contains("amplifier_v_per_v 62.068962 monitor_zero_v") && said.ends_with("nothing was changed"),
        "{said}"
    );

    // With half the metres a volt the guard at 120 um would never act.
    let half = "--set sensor_m_per_v=3.939394e-5";
    let refused = [
        (half.to_owned(), "trip_m lies beyond the sensor's range"),
        ("--set amplifier_v_per_v=30".into(), "drive_min_v and drive_max_v must lie within -43.48"),
        ("--set amplifier_v_per_v=nan".into(), "amplifier_v_per_v"),
        ("--set monitor_samples=-1".into(), "a whole number from 0 to 65535 is needed"),
        ("--set gain=2".into(), "no such parameter; there are rate_hz, kp_v_per_m"),
        ("--set gain".into(), "NAME=VALUE"),
    ];
    for (more, words) in refused {
        let output = parameters(&(more.clone() + " --save"));
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{more}: {said}");
        assert!(said.contains(words) && said.lines().count() == 1, "{more}: {said}");
    }
    let untouched = json(&parameters("--json"));
    assert_eq!(untouched["parameters"]["sensor_m_per_v"], 7.878788e-5);

    // The set is judged as a whole, and what a log says of the same stage is half of it then.
    let record = |out: &str| run(&folder, &format!("record {at} --spec hold:10V@0.05s --out @/{out}"));
    assert!(record("a").status.success());
    let set = json(&parameters(&format!(
        "{half} --set trip_m=5e-5 --set reference_max_m=4e-5 --set link_timeout_s=inf --save --json"
    )));
    assert_eq!((&set["changed"], &set["saved"]), (&true.into(), &true.into()));
    assert_eq!(set["parameters"]["link_timeout_s"], serde_json::Value::Null);
    assert!(record("b").status.success());
    let last = |out: &str| *column(&folder.read(&format!("{out}/log.csv")), "displacement_um").last().unwrap();
    assert!((last("b") / last("a") - 0.5).abs() < 0.005, "{} {}", last("a"), last("b"));
    // The example of docs/wiring.md is one that a board of these defaults takes, once its sensor is the one it was.
    let wiring = std::fs::read_to_string(root().join("docs/wiring.md")).expect("ours");
    let example =
        wiring.lines().find_map(|line| line.strip_prefix("hysteron board parameters --board serial:/dev/ttyACM0"));
    let set = json(&parameters(&format!("{} --json", example.expect("an example"))));
    assert_eq!((&set["saved"], &set["parameters"]["amplifier_v_per_v"]), (&true.into(), &69.0.into()));
    // What was in force shows, and what becomes of it.
    let said = shown("--set link_timeout_s=0.5");
    assert!(said.contains("link_timeout_s 0.5, was inf in force") && said.ends_with("--save keeps them"), "{said}");
}

#[test]
fn a_board_that_ends_with_the_call_has_nothing_to_keep_and_nothing_to_stop() {
    let folder = Folder::new("board-parameters-none");
    for line in ["board parameters --set trip_m=5e-5", "board stop"] {
        let output = run(&folder, line);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("--board serial:PATH"), "{}", stderr(&output));
    }
}

/// A board whose host was brought up to date is no less in need of being stopped.
#[test]
fn a_board_of_another_release_is_stopped_and_then_told_as_such() {
    let folder = Folder::new("board-stop-other");
    let (place, was_stopped) = fake_board("0.0.9 abc", ModeName::Running, 0);
    let output = run(&folder, &format!("board stop --board {place} --patience-ms 100"));
    assert_eq!((output.status.code(), stdout(&output).trim()), (Some(4), "stopped, at 0 V"), "{}", stderr(&output));
    assert!(stderr(&output).contains("the board runs firmware 0.0.9 abc") && was_stopped.load(Ordering::Relaxed));
    // Of one that says nothing of how it is nothing is claimed.
    let output =
        run(&folder, &format!("board stop --board {} --patience-ms 50", impostor(Some(identity("0.0.9 abc")))));
    assert_eq!((output.status.code(), stdout(&output).as_str()), (Some(4), ""), "{}", stderr(&output));
}

/// With its image's numbers, the sensor's too, a board knows no displacement of its bench; without its crystal no time.
#[test]
fn a_board_without_its_own_numbers_or_clock_is_not_waved_through() {
    let folder = Folder::new("board-lost");
    let ours = concat!(env!("CARGO_PKG_VERSION"), " abc");
    for (fault, words) in [
        (FaultCode::ParameterStore, "`hysteron board parameters --clear-fault --set .. --save`"),
        (FaultCode::Clock, "mend it, then reset the board"),
    ] {
        let refused = |line: &str| {
            let (place, _) = fake_board(ours, ModeName::Fault, fault.number());
            let output = run(&folder, &line.replace("AT", &format!("--board {place} --clear-fault --patience-ms 200")));
            assert_eq!(output.status.code(), Some(4), "{line}: {}", stderr(&output));
            assert!(stderr(&output).contains(words), "{line}: {}", stderr(&output));
        };
        refused("board stop AT");
        refused("hil AT --probe-link");
    }
}

#[test]
fn a_board_that_was_left_running_is_stopped_and_leaves_its_fault() {
    let Some(image) = image() else { return };
    let folder = Folder::new("board-stop");
    // In real time: it goes on while nobody asks.
    let (_server, place) = served(&image, &[]);
    let at = format!("--board tcp:{place}");
    let ask = |line: &str| run(&folder, &line.replace("AT", &at));
    succeeded(&ask("board parameters AT --set link_timeout_s=inf"));
    // A host that is killed while its board drives.
    let left_running = |out: &str| {
        let mut host = spawned(&folder, &format!("record {at} --spec hold:10V@1000s --out @/{out}"));
        let log = folder.path(out).join("log.csv");
        host.until(|| log.metadata().is_ok_and(|found| found.len() > 30_000));
    };
    left_running("gone");
    // Nothing is changed under it, and who would use it is told what to do.
    for line in ["board parameters AT --set kp_v_per_m=8e5 --save", "record AT --spec hold:1V@0.1s --out @/b"] {
        let output = ask(line);
        assert_eq!(output.status.code(), Some(4), "{}", stderr(&output));
        assert!(stderr(&output).contains("running, driving its own pins: stop it first (`hysteron board stop`)"));
    }
    assert_eq!(json(&ask("board parameters AT --json"))["parameters"]["kp_v_per_m"], 858110.0);
    assert!(stdout(&ask("board stop AT")).contains("idle, at 0 V"));
    succeeded(&ask("board parameters AT --set link_timeout_s=0.25"));

    // With its host it falls silent now, which is a fault.
    left_running("silent");
    let said = loop {
        // Whoever asks is heard, too.
        std::thread::sleep(std::time::Duration::from_secs(2));
        let output = ask("board parameters AT --set kp_v_per_m=8e5");
        if stderr(&output).contains("fault") {
            break stderr(&output);
        }
        assert!(stderr(&output).contains("driving its own pins"), "{}", stderr(&output));
    };
    assert!(said.contains("link loss") && said.contains("--clear-fault"), "{said}");
    assert!(stderr(&ask("board stop AT")).contains("link loss"));
    succeeded(&ask("board parameters AT --set kp_v_per_m=8e5 --clear-fault"));
    succeeded(&ask("record AT --spec hold:1V@0.1s --out @/after"));
}
