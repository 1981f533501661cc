//! `hysteron blind-check` as a user meets it, with a program of a few lines in the place of the diagnosis.
//!
//! The answers are as good as dice; what is tested is that nothing reaches the program but its logs, that nothing is lost or
//! changed by killing, splitting and merging, and that changed artefacts are found.
#![cfg(unix)]

mod support;

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use support::{Folder, run, stderr, stdout, succeeded};

/// Answers by the checksum of the plant, which holds the case's own noise. It fails if it finds anything that it should not.
const STUB: &str = r#"#!/bin/sh
here=$(dirname "$0")
[ -e "$here/slow" ] && sleep 1
for file in *; do
  case $file in nominal.toml|log*.csv|held-out-*.csv) ;; *) echo "stray file $file" >&2; exit 9;; esac
done
[ -n "$HOME$CARGO_MANIFEST_DIR" ] && { echo "stray environment" >&2; exit 9; }
[ "$1 $2 $3" = "diagnose --plant nominal.toml" ] || { echo "stray call $*" >&2; exit 9; }
out= without= more=
while [ $# -gt 0 ]; do
  case $1 in --out) out=$2;; --without) without=$2;; log-more.csv) more=yes;; esac
  shift
done
sum=$(cksum < nominal.toml | cut -d' ' -f1)
kind=$((sum % 6))
[ -n "$without" ] && kind=1
[ $kind = 4 ] && { echo "thread 'main' panicked" >&2; exit 101; }
effects='"creep"' verdict=explained set='"creep"' p='{"effect":"creep","probability":1.0}' next=null
[ $kind = 0 ] && effects= verdict=no_gap set='"no_gap"' p='{"effect":"no_gap","probability":1.0}'
[ $kind = 1 ] && effects= verdict=unknown set='"unknown"' p='{"effect":"unknown","probability":1.0}'
[ $kind = 2 ] && [ -z "$more" ] && set='"creep","backlash"' &&
  p='{"effect":"creep","probability":0.6},{"effect":"backlash","probability":0.4}' &&
  next='{"spec":"hold:20V@0.05s+hold:40V@0.05s","rate_hz":10000,"splits":["creep","backlash"],"reason":"one creeps"}'
mkdir "$out"
echo "<html>$sum</html>" > "$out/report.html"
echo "{\"schema\":\"hysteron-diagnosis-1\",\"verdict\":\"$verdict\",\"effects\":[$effects],\"stage\":null,\"ranking\":[$p],
 \"set90\":[$set],\"classes\":[],\"gap\":{\"refit_rms_um\":0.5,\"augmented_rms_um\":0.5},\"next_experiment\":$next}" > "$out/diagnosis.json"
"#;

/// `sha256sum` of the labels of the measured logs below.
const LABELS_SHA256: &str = "6ae83f7e0cf89d7d47ad7240e0a1c4fc862ee5b331228f4306db57657fd4f2b1";

/// A folder with the stub in it.
fn folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    let stub = folder.write("stub", STUB);
    fs::set_permissions(&stub, fs::Permissions::from_mode(0o755)).expect("a mode");
    folder
}

fn check(folder: &Folder, line: &str) -> Output {
    run(folder, &format!("blind-check --program @/stub {line}"))
}

fn score(folder: &Folder, name: &str) -> serde_json::Value {
    serde_json::from_str(&folder.read(&format!("{name}/score.json"))).expect("JSON")
}

fn done(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder.join("cases")) else { return Vec::new() };
    let mut done: Vec<PathBuf> =
        entries.map(|e| e.expect("an entry").path().join("run.json")).filter(|path| path.is_file()).collect();
    done.sort();
    done
}

#[test]
fn a_quick_run_scores_forty_sealed_cases() {
    let folder = folder("blind-quick");
    let output = check(&folder, "--quick --seed 1 --out @/out --leave-one-out --active");
    succeeded(&output);
    let said = stdout(&output);
    // The seal is the first that is said, and is what it is of.
    let seal = folder.read("out/seal.txt");
    assert!(said.starts_with(&format!("sealed 40 labels, sha256 {}\n", &seal[..64])), "{said}");
    let score = score(&folder, "out");
    assert_eq!(score["schema"], "hysteron-blind-score-1");
    assert_eq!(score["provenance"]["labels_sha256"], seal[..64]);
    let count = |key: &str| score["cases"][key].as_u64().expect("a count");
    assert_eq!(["singles", "nulls", "pairs", "foreign"].map(count), [20, 8, 4, 8]);
    // One in six fails by design; nothing was found where it should not be.
    assert!((1..20).contains(&count("defects")), "{score}");
    let failures = score["failures"].as_array().expect("a list");
    let reasons: Vec<&str> = failures.iter().filter_map(|f| f["said"].as_str()).collect();
    assert!(reasons.iter().all(|said| *said == "exit status: 101: thread 'main' panicked"), "{reasons:?}");
    assert_eq!(reasons.len() as u64, count("defects"));
    // Struck out, everything is unknown; and what was open is not any more.
    assert_eq!(score["left_out"]["said_unknown"]["share"], 1.0);
    assert_eq!(score["left_out"]["said_unknown"]["of"], 20);
    assert_eq!(score["active"]["mean_size"], serde_json::json!([2.0, 1.0]));
    assert_eq!(score["active"]["failed"], 0);
    // Logs are gone, answers are there, and so are the pages of failures.
    let case = folder.path("out/cases").join(failures[0]["id"].as_str().expect("an identifier"));
    assert!(case.join("diagnosis.json").is_file() && case.join("report.html").is_file());
    assert!(!case.join("nominal.toml").exists() && !case.join("answer").exists());
    assert!(folder.read("out/report.html").contains("What went wrong, and why"));
    let timing: serde_json::Value = serde_json::from_str(&folder.read("out/timing.json")).expect("JSON");
    assert_eq!(timing["cases"].as_object().map(serde_json::Map::len), Some(40));
}

#[test]
fn killed_or_in_parts_a_run_gives_the_same_score() {
    let folder = folder("blind-resume");
    let order = "--quick --first 10 --seed 3";
    succeeded(&check(&folder, &format!("{order} --out @/whole")));
    let whole = folder.read("whole/score.json");

    // Killed while it waits for the third or a later answer; nobody gets to tidy up.
    folder.write("slow", "");
    let line = folder.fill_in(&format!("blind-check --program @/stub {order} --jobs 1 --out @/killed"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .args(line.split_whitespace())
        .stdout(Stdio::null())
        .spawn()
        .expect("the command starts");
    let killed = folder.path("killed");
    let patience = Instant::now();
    while done(&killed).len() < 2 {
        assert!(patience.elapsed() < Duration::from_secs(120), "no answers");
        std::thread::sleep(Duration::from_millis(50));
    }
    child.kill().expect("it runs");
    child.wait().expect("it ends");
    assert!(!killed.join("score.json").exists());
    fs::remove_file(folder.path("slow")).expect("a file");
    let before: Vec<(PathBuf, String)> =
        done(&killed).into_iter().map(|path| (path.clone(), fs::read_to_string(&path).expect("a file"))).collect();
    assert!((2..10).contains(&before.len()));
    succeeded(&check(&folder, &format!("{order} --out @/killed")));
    assert_eq!(folder.read("killed/score.json"), whole);
    // What was answered was not asked again: its time is that of the first run.
    assert!(before.iter().all(|(path, text)| fs::read_to_string(path).is_ok_and(|now| now == *text)));

    // In parts, which say nothing of the score.
    for part in ["1/2", "2/2"] {
        let said = stdout(&check(&folder, &format!("{order} --shard {part} --out @/part{}", &part[..1])));
        assert!(said.contains(&format!("part {part} is done, 5 cases")) && !said.contains("right name"), "{said}");
    }
    let output = check(&folder, "--merge @/part1 --out @/merged");
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("5 of 10 cases are in no part"), "{}", stderr(&output));
    // What knows the labels waits until all parts are answered.
    for flag in ["--leave-one-out", "--active"] {
        let output = check(&folder, &format!("{order} --shard 1/2 --out @/early {flag}"));
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("with --merge, not with --shard"), "{}", stderr(&output));
        assert!(!folder.path("early").exists());
    }
    succeeded(&check(&folder, "--merge @/part1 @/part2 --out @/merged"));
    assert_eq!(folder.read("merged/score.json"), whole);
    succeeded(&check(&folder, "--merge @/part1 @/part2 --out @/merged --leave-one-out"));
    assert_eq!(score(&folder, "merged")["left_out"]["made"], score(&folder, "merged")["cases"]["singles"]);

    // A directory belongs to one order.
    let output = check(&folder, "--quick --first 10 --seed 4 --out @/merged");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("belongs to another run"), "{}", stderr(&output));
}

#[test]
fn verify_finds_what_was_changed() {
    let folder = folder("blind-verify");
    succeeded(&check(&folder, "--quick --first 6 --seed 5 --out @/out --leave-one-out"));
    let verify = || check(&folder, "--verify @/out");
    let output = verify();
    succeeded(&output);
    let said = stdout(&output);
    assert!(said.ends_with("everything agrees\n") && said.matches(": yes\n").count() == 6, "{said}");

    let refused = |file: &str, change: &dyn Fn(&str) -> String, question: &str| {
        let before = folder.read(file);
        let after = change(&before);
        assert_ne!(before, after, "{file}");
        folder.write(file, after);
        let output = verify();
        assert_eq!(output.status.code(), Some(3), "{file}");
        assert!(stdout(&output).contains(&format!("{question}: NO\n")), "{file}: {}", stdout(&output));
        folder.write(file, before);
    };
    refused("out/sealed/labels.json", &|text| text.replace("null", "creep"), "the labels are what was sealed");
    refused("out/score.json", &|text| text.replacen("false", "true", 1), "the score follows from the answers");
    let ids: Vec<String> = fs::read_dir(folder.path("out/cases"))
        .expect("cases")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    let answered = ids.iter().find(|id| folder.path(&format!("out/cases/{id}/diagnosis.json")).is_file());
    let answered = answered.expect("an answer");
    let answer = format!("out/cases/{answered}/diagnosis.json");
    refused(&answer, &|text| text.replace("1.0", "0.9999"), "the answers are there as they were written");
    // One that is gone is as little what was written, whatever the score says.
    let before = folder.read(&answer);
    fs::remove_file(folder.path(&answer)).expect("there");
    assert!(stdout(&verify()).contains("the answers are there as they were written: NO\n"));
    folder.write(&answer, before);
    let truth = format!("out/sealed/truths/{answered}.json");
    refused(
        &truth,
        &|text| text.replacen("\"noise_um\": 0.0", "\"noise_um\": 1.0", 1),
        "the truths follow from the labels",
    );
    succeeded(&verify());
}

#[test]
fn one_program_gives_all_answers() {
    let folder = folder("blind-program");
    let order = "--quick --first 6 --seed 3";
    let exchange = |text: String| {
        folder.write("stub", text);
        fs::set_permissions(folder.path("stub"), fs::Permissions::from_mode(0o755)).expect("a mode");
    };
    let refused = |line: &str, code: i32, why: &str| {
        let output = check(&folder, line);
        assert_eq!(output.status.code(), Some(code), "{line}");
        assert!(stderr(&output).contains(why) && stderr(&output).trim().lines().count() == 1, "{}", stderr(&output));
    };
    for part in ["1/2", "2/2"] {
        succeeded(&check(&folder, &format!("{order} --shard {part} --out @/part{}", &part[..1])));
    }
    // Half of a run, as a killed one leaves it.
    let half = format!("{order} --out @/half");
    succeeded(&check(&folder, &half));
    for path in &done(&folder.path("half"))[3..] {
        fs::remove_file(path).expect("there");
    }
    fs::remove_file(folder.path("half/score.json")).expect("there");

    exchange(format!("{STUB}# another\n"));
    refused(&half, 2, "its answers are of another program");
    assert_eq!(done(&folder.path("half")).len(), 3);
    succeeded(&check(&folder, &format!("{order} --shard 2/2 --out @/other2")));
    refused("--merge @/part1 @/other2 --out @/mixed", 3, "was answered by another program");
    assert!(!folder.path("mixed/cases").exists());
    // So are second answers.
    refused("--merge @/part1 @/part2 --out @/merged --leave-one-out", 2, "its answers are of another program");
    // What is answered by nobody yet may be begun again.
    fs::create_dir_all(folder.path("fresh")).expect("a folder");
    fs::copy(folder.path("half/program.txt"), folder.path("fresh/program.txt")).expect("a file");
    succeeded(&check(&folder, &format!("{order} --out @/fresh")));

    // A run that hides its program, as one of before: it is read, goes on, and --verify says what is not known, or that it was not one.
    let verified = |name: &str| stdout(&check(&folder, &format!("--verify @/{name}")));
    assert!(verified("fresh").contains("one program gave all answers: yes\n"));
    fs::remove_file(folder.path("half/program.txt")).expect("there");
    let output = check(&folder, &half);
    succeeded(&output);
    assert!(
        stderr(&output).contains("which program gave the answers that are there is not known"),
        "{}",
        stderr(&output)
    );
    assert!(!folder.path("half/program.txt").exists());
    assert!(verified("half").contains("one program gave all answers: NO\n"));
    for path in done(&folder.path("half")) {
        let mut ran: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(&path).expect("a file")).expect("JSON");
        ran.as_object_mut().expect("an object").remove("program_sha256");
        fs::write(&path, ran.to_string()).expect("written");
    }
    let said = verified("half");
    assert!(said.contains("one program gave all answers: which") && said.ends_with("everything agrees\n"), "{said}");
    fs::remove_file(folder.path("part2/program.txt")).expect("there");
    let output = check(&folder, "--merge @/part1 @/part2 --out @/read");
    succeeded(&output);
    assert!(stderr(&output).contains("is not known") && !folder.path("read/program.txt").exists());
}

#[test]
fn a_program_exchanged_under_the_run_ends_it() {
    let folder = folder("blind-exchange");
    // It puts another one in its own place.
    let text = STUB.replacen("mkdir \"$out\"", "echo '# another' >> \"$0\"\nmkdir \"$out\"", 1);
    folder.write("stub", text);
    fs::set_permissions(folder.path("stub"), fs::Permissions::from_mode(0o755)).expect("a mode");
    let output = check(&folder, "--quick --first 6 --seed 3 --jobs 1 --out @/out");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("was exchanged under the run"), "{}", stderr(&output));
    assert!(!folder.path("out/score.json").exists());
}

#[test]
fn second_diagnoses_count_when_they_are_done() {
    let folder = folder("blind-second");
    let call = "--quick --first 10 --seed 1 --out @/out";
    succeeded(&check(&folder, &format!("{call} --leave-one-out --active")));
    let before = score(&folder, "out");
    let (made, experiments) = (before["left_out"]["made"].as_u64(), before["active"]["made"].as_u64());
    assert_eq!(made, before["cases"]["singles"].as_u64());
    assert!(made.is_some_and(|made| made > 1) && experiments.is_some_and(|made| made > 0), "{before}");
    // One of each as a killed run leaves it: a folder with logs and no answer.
    for kind in ["left-out", "active"] {
        let entries = fs::read_dir(folder.path(&format!("out/{kind}"))).expect("a folder");
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
        paths.sort();
        fs::remove_file(paths[0].join("run.json")).expect("there");
    }
    let output = check(&folder, call);
    succeeded(&output);
    let after = score(&folder, "out");
    let less = |count: Option<u64>| count.map(|count| count - 1);
    assert_eq!((after["left_out"]["made"].as_u64(), after["left_out"]["of"].as_u64()), (less(made), made));
    assert_eq!(after["left_out"]["defects"], 0);
    assert_eq!((after["active"]["made"].as_u64(), &after["active"]["failed"]), (less(experiments), &0.into()));
    assert_eq!(after["active"]["open"], 1);
    let said = stderr(&output);
    assert!(said.contains("were diagnosed without it") && said.contains("1 proposed experiments are still"), "{said}");
}

#[test]
fn every_opening_of_the_report_split_is_written_down_once() {
    let folder = folder("blind-openings");
    let call = "--quick --first 2 --split report --seed 1 --commit v0-12-gabc --openings @/openings.csv --out @/out";
    succeeded(&check(&folder, call));
    succeeded(&check(&folder, call));
    let book = folder.read("openings.csv");
    let lines: Vec<&str> = book.lines().collect();
    assert_eq!(lines.len(), 2, "{book}");
    assert!(lines[0].starts_with("commit,version,seed,split,") && lines[1].starts_with("v0-12-gabc,"), "{book}");
    assert_eq!(lines[0].split(',').count(), lines[1].split(',').count());
    // Another draw with the same version would be a second try.
    let again = check(&folder, &call.replace("--seed 1", "--seed 2").replace("@/out", "@/again"));
    assert_eq!(again.status.code(), Some(2));
    assert!(stderr(&again).contains("was opened with seed 1"), "{}", stderr(&again));
    assert!(!folder.path("again").exists());
    // The other splits are for looking at.
    succeeded(&check(&folder, &call.replace("report", "develop").replace("@/out", "@/other")));
    assert_eq!(folder.read("openings.csv"), book);
}

#[test]
fn measured_logs_are_scored_when_their_labels_come() {
    let folder = folder("blind-measured");
    let plant = fs::read_to_string(support::root().join(support::PLANT)).expect("a file of the project");
    folder.write("plant.toml", plant);
    folder.write("in.csv", support::good_csv(40));
    folder.write("out.csv", support::good_csv(50));
    let labels = "filter-in = [\"sensor_bandwidth\"]\nfilter-out = []\n";
    let manifest = |hash: &str| {
        format!(
            "title = \"Filter\"\nplant = \"plant.toml\"\n[labels]\nfile = \"labels.toml\"\nsha256 = \"{hash}\"\n\
             [[group]]\nid = \"filter-in\"\nlogs = [\"in.csv\"]\n[[group]]\nid = \"filter-out\"\nlogs = [\"out.csv\"]\n"
        )
    };
    // Two of one name would have one answer.
    folder.write("twins.toml", manifest(LABELS_SHA256).replace("filter-out", "filter-in"));
    let output = check(&folder, "--manifest @/twins.toml --out @/twins");
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("two groups are called \"filter-in\""), "{}", stderr(&output));

    folder.write("manifest.toml", manifest(LABELS_SHA256));
    let call = "--manifest @/manifest.toml --out @/out";
    let output = check(&folder, call);
    succeeded(&output);
    assert!(stdout(&output).contains("put the labels to"), "{}", stdout(&output));
    assert!(!folder.path("out/score.json").exists());
    assert!(folder.names().iter().all(|name| !name.contains("filter")));

    folder.write("labels.toml", format!("{labels}# later\n"));
    let output = check(&folder, call);
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("is not what was sealed"), "{}", stderr(&output));

    folder.write("labels.toml", labels);
    succeeded(&check(&folder, call));
    let score = score(&folder, "out");
    assert_eq!((&score["cases"]["singles"], &score["cases"]["nulls"]), (&1.into(), &1.into()));
    let verified = check(&folder, "--verify @/out");
    assert_eq!(verified.status.code(), Some(3));
    assert!(stderr(&verified).contains("what was measured has no seed"), "{}", stderr(&verified));
}
