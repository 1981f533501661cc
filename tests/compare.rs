//! `hysteron identify` of every kind, and `--compare`, as a user meets them.

use crate::support::{Folder, PLANT, good_csv, json, run, stderr, stdout, succeeded};
use plant_sim::model::{Kind, Model};

/// A log made by `simulate`.
fn made(folder: &Folder, plant: &str, spec: &str, name: &str) {
    let call =
        format!("simulate --plant {plant} --command {spec} --rate 10000 --seconds 0.12 --out @/{name} --no-page");
    assert_eq!(run(folder, &call).status.code(), Some(0));
}

#[test]
fn a_comparison_ranks_every_kind_and_writes_the_best() {
    let folder = Folder::new("compare");
    made(&folder, PLANT, "square:60V@25Hz", "steps.csv");
    made(&folder, PLANT, "sine:50V@40Hz", "sine.csv");
    let call = "identify --compare @/steps.csv --held-out @/sine.csv --initial relaxed --starts 1 --mass-kg 1.0148e-3 --out @/best.toml --json";
    let output = run(&folder, call);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let said = json(&output);
    let ranking = said["ranking"].as_array().expect("a ranking");
    assert!(ranking.len() >= 16, "{ranking:?}");
    let rms: Vec<f64> = ranking.iter().map(|c| c["held_out_rms_um"].as_f64().expect("a number")).collect();
    assert!(rms.windows(2).all(|pair| pair[0] <= pair[1]), "{rms:?}");
    assert_eq!(ranking[0]["kind"], "phs", "{ranking:?}");
    assert_eq!(Model::read(&folder.path("best.toml")).expect("a model").kind, Kind::Phs);
    let page = folder.read("best.html");
    assert!(page.contains("Bouc-Wen actuator") && page.contains("evidence against"));
}

#[test]
fn what_a_kind_of_model_has_no_use_for_is_refused() {
    let folder = Folder::new("unused");
    folder.write("good.csv", good_csv(40));
    for (model, option) in [
        ("transfer-function", "--mass-kg 0.05"),
        ("transfer-function", "--hysterons 3"),
        ("bouc-wen", "--hysterons 3"),
        ("bouc-wen-static", "--mass-kg 0.05"),
        ("phs", "--order 4,3"),
    ] {
        let output = run(&folder, &format!("identify --model {model} @/good.csv {option} --out @/out.toml"));
        let name = option.split(' ').next().unwrap_or_default();
        let line = format!("hysteron: {name} means nothing to --model {model}: leave it out\n");
        assert_eq!((output.status.code(), stderr(&output)), (Some(2), line));
    }
    assert_eq!(folder.names(), ["good.csv"]);
}

/// What was fitted can't score the fit, and a log that is there twice would count as two.
#[test]
fn a_log_that_is_named_twice_is_refused() {
    let folder = Folder::new("twice");
    folder.write("a.csv", good_csv(40));
    folder.write("b.csv", good_csv(40));
    let both = "@/a.csv: is fitted and held out: leave it out of one of them";
    for (logs, line) in [
        ("@/b.csv @/a.csv --held-out @/a.csv", both),
        ("@/b.csv @/../F/a.csv --held-out @/a.csv", both),
        ("@/a.csv @/b.csv @/a.csv", "@/a.csv: is named twice: leave it out once"),
        ("@/a.csv --held-out @/b.csv @/b.csv", "@/b.csv: is named twice: leave it out once"),
    ] {
        let name = folder.0.file_name().expect("a folder").to_string_lossy();
        let logs = logs.replace("/F/", &format!("/{name}/"));
        for call in [
            format!("identify --compare {logs} --out @/out.toml"),
            format!("diagnose --plant {PLANT} {logs} --out @/out"),
        ] {
            let output = run(&folder, &call);
            assert_eq!(
                (output.status.code(), stderr(&output)),
                (Some(2), folder.fill_in(&format!("hysteron: {line}\n"))),
                "{call}"
            );
        }
    }
    assert_eq!(folder.names(), ["a.csv", "b.csv"]);
}

/// An actuator with plays, simulated, is found again from its log: what its file says, and what it would do.
#[test]
fn an_operator_is_fitted_by_name() {
    let folder = Folder::new("operator");
    let plant = "models/fitted-prandtl-ishlinskii.toml";
    made(&folder, plant, "decaying-sine:60V@40Hz/0.12s", "loops.csv");
    let call =
        "identify --model prandtl-ishlinskii @/loops.csv --initial relaxed --starts 1 --no-page --out @/fitted.toml";
    succeeded(&run(&folder, call));
    let found = Model::read(&folder.path("fitted.toml")).expect("a model");
    assert_eq!((found.kind.name(), found.hysteresis.weight_per_v.len()), ("prandtl-ishlinskii", 8));
    made(&folder, plant, "sine:45V@30Hz", "other.csv");
    let replay = "replay --plant @/fitted.toml @/other.csv --initial relaxed --out @/p.csv --no-page --json";
    let output = run(&folder, replay);
    succeeded(&output);
    let fit = json(&output)["fit_percent"].as_f64().expect("a number");
    // Its plays are as wide as the new log's span suggests, not as the old one's.
    assert!(fit > 99.5, "{fit} %");
    // In a loop, too: the controller's margins are those of its two slopes.
    let call = format!(
        "simulate --plant {plant} --controller controllers/pi1.toml --reference step:40um --rate 20000 --seconds 0.05 --out @/step.csv --no-page --json"
    );
    let output = run(&folder, &call);
    succeeded(&output);
    let settled_ms = json(&output)["settle_2_percent_ms"].as_f64().expect("it settles");
    assert!((0.5..30.0).contains(&settled_ms), "{settled_ms} ms");
}

/// Displacements are the same with any mass, and forces are not.
#[test]
fn a_mass_that_nobody_states_is_said_to_be_assumed() {
    let folder = Folder::new("assumed-mass");
    made(&folder, "models/thesis-newid2.toml", "square:60V@25Hz", "log.csv");
    let said = |model: &str| {
        let call = format!("identify --model {model} @/log.csv --initial relaxed --starts 1 --no-page --out @/f.toml");
        succeeded(&run(&folder, &call)).contains("the mass is assumed to be 1.0148 g")
    };
    assert!(said("linear --hysterons 0"));
    assert!(!said("linear --hysterons 0 --mass-kg 0.002") && !said("transfer-function --order 2,0"));
}

#[test]
fn transfer_functions_and_bouc_wen_are_fitted_by_name() {
    let folder = Folder::new("kinds");
    made(&folder, "models/thesis-newid2.toml", "square:60V@25Hz", "linear.csv");
    let fit =
        |model: &str| format!("identify --model {model} @/linear.csv --initial relaxed --no-page --out @/{model}.toml");
    let output = run(&folder, &format!("{} --order 2,0", fit("transfer-function")));
    succeeded(&output);
    assert!(stdout(&output).contains("2 poles, 0 zeros"), "{}", stdout(&output));
    let call = "identify --model transfer-function @/linear.csv --initial relaxed --out @/any-order.toml";
    succeeded(&run(&folder, call));
    let page = std::fs::read_to_string(folder.path("any-order.html")).expect("a page");
    for shown in [
        "poles and 0 zeros explain",
        "denominator_1",
        "Orders that were tried",
        "Best linear approximation, linear.csv",
    ] {
        assert!(page.contains(shown), "{shown}");
    }
    let output = run(&folder, &format!("{} --order 2,0 --json", fit("transfer-function")));
    let found = json(&output);
    assert_eq!(found["parameters"][0]["name"], "denominator_1");
    assert!(found["parameters"][2]["sigma"].as_f64().is_some_and(|sigma| sigma > 0.0));
    assert!(found["logs"][0]["fit_percent"].as_f64().is_some() && found["aic"].as_f64() < found["bic"].as_f64());
    let tf =
        Model::read(&folder.path("transfer-function.toml")).expect("a model").transfer_function.expect("of that kind");
    assert!((tf.denominator.value[1] / 2555.0 - 1.0).abs() < 1e-4, "{tf:?}");
    // What was fitted is a plant like any other.
    let output = run(
        &folder,
        "replay --plant @/transfer-function.toml @/linear.csv --initial relaxed --out @/p.csv --no-page --json",
    );
    succeeded(&output);
    assert!(json(&output)["fit_percent"].as_f64().expect("a number") > 99.99);
    let wrong = [
        (format!("{} --plant {PLANT}", fit("bouc-wen")), "is a plant of kind phs and --model asks for bouc-wen"),
        (format!("{} --order 2,3", fit("transfer-function")), "poles and fewer zeros"),
        ("identify @/linear.csv --out @/x.toml".to_owned(), "--model"),
        (fit("bouc-wen-oscillator"), "can't be guessed from logs alone: state a plant of that kind with --plant"),
        (
            "identify --compare --plant models/thesis-bouc-wen.toml @/linear.csv --out @/x.toml".to_owned(),
            "kind bouc-wen",
        ),
    ];
    for (call, expected) in wrong {
        let output = run(&folder, &call);
        assert_eq!(output.status.code(), Some(2), "{call}");
        assert!(
            stderr(&output).contains(expected) && stderr(&output).lines().count() == 1,
            "{call}: {}",
            stderr(&output)
        );
    }
}
