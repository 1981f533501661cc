//! `hysteron export` from the command line: another kind of file, the same log.

use crate::support::{Folder, PLANT, good_csv, json, run, stderr, stdout, succeeded};

#[test]
fn a_log_is_not_written_under_the_name_of_another_kind() {
    let folder = Folder::new("kinds");
    folder.write("good.csv", good_csv(40));
    for (out, name) in [("out.mat", "@/out.csv"), ("out.npy", "@/out.csv"), ("good.mat", "a file that ends in .csv")] {
        let output = run(&folder, &format!("replay --plant {PLANT} @/good.csv --out @/{out}"));
        let line = format!(
            "hysteron: @/{out}: what is written is CSV: name {name} with --out, and make another kind of it with `hysteron export`\n"
        );
        assert_eq!((output.status.code(), stderr(&output)), (Some(2), folder.fill_in(&line)));
    }
    assert_eq!(folder.names(), ["good.csv"]);
}

#[test]
fn every_kind_is_the_same_log_to_what_reads_it() {
    let folder = Folder::new("export");
    let simulate =
        format!("simulate --plant {PLANT} --command sine:60V@10Hz --rate 10000 --seconds 0.3 --out @/a.csv --no-page");
    succeeded(&run(&folder, &simulate));
    let rms = |log: &str| {
        let output =
            run(&folder, &format!("replay --plant {PLANT} @/{log} --out @/p.csv --initial relaxed --no-page --json"));
        succeeded(&output);
        json(&output)["rms_um"].as_f64().expect("a number")
    };
    // Binary formats round micrometres once: 2e-16 of 100 um, far below the print's.
    let whole_um = rms("a.csv");
    for name in ["b.mat", "b.npy", "b.csv"] {
        let output = run(&folder, &format!("export @/a.csv --out @/{name}"));
        let warned = succeeded(&output);
        assert_eq!(warned.contains("no room for metadata"), name == "b.npy", "{warned}");
        assert!(stdout(&output).contains("(3000 rows)"), "{}", stdout(&output));
    }
    // NPY lost the latency of 10 us, at 100 um and 10 Hz up to 60 nm.
    for name in ["b.mat", "b.csv"] {
        assert!((rms(name) - whole_um).abs() < 1e-9, "{name}");
    }
    assert!((1e-3..0.1).contains(&rms("b.npy")));
    assert_eq!(folder.read("b.csv").lines().last(), folder.read("a.csv").lines().last());
}

#[test]
fn columns_that_no_log_has_are_named_as_they_are_left_out() {
    let folder = Folder::new("export-others");
    let text = good_csv(100);
    let more = |line: &str| match line.as_bytes() {
        [b'#', ..] => line.to_owned(),
        [b't', ..] => format!("{line},strain,note"),
        _ => format!("{line},1e-6,x"),
    };
    folder.write("a.csv", text.lines().map(more).collect::<Vec<String>>().join("\n") + "\n");
    let warned = succeeded(&run(&folder, "export @/a.csv --out @/b.npy"));
    assert!(warned.contains("a.csv: left out, as they are none of a log's columns: strain, note;"), "{warned}");
    folder.write("plain.csv", text);
    assert!(!succeeded(&run(&folder, "export @/plain.csv --out @/c.csv")).contains("left out"));
}

#[test]
fn what_cannot_be_is_one_line_with_its_code_and_writes_nothing() {
    let folder = Folder::new("export-bad");
    folder.write("a.csv", good_csv(100));
    folder.write("bad.csv", "time_s,command_V\n0,1\n");
    let mut cases = vec![
        ("export @/a.csv --out @/b.xls", 2, "unknown kind of log; end its name in .csv, .npy or .mat"),
        ("export @/a.csv --out @/a.csv", 2, "would be overwritten"),
        ("export @/none.csv --out @/b.mat", 3, "none.csv"),
        ("export @/bad.csv --out @/b.mat", 3, "bad.csv"),
        ("export @/a.csv --out @/no/b.mat", 2, "is not there; make it or name another"),
    ];
    if !cfg!(feature = "parquet") {
        cases.push(("export @/a.csv --out @/b.parquet", 2, "built without parquet: build it with --features parquet"));
    }
    if !cfg!(feature = "mf4") {
        cases.push(("export @/a.csv --out @/b.mf4", 2, "built without mf4: build it with --features mf4"));
    }
    for (call, code, words) in cases {
        let output = run(&folder, call);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{call}: {said}");
        assert!(said.contains(words) && said.lines().count() == 1, "{call}: {said}");
    }
    assert_eq!(folder.names(), ["a.csv", "bad.csv"]);
}
