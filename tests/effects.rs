//! `hysteron effects` and plants that carry effects, as a user meets them.

use crate::support::{Folder, PLANT, json, number, root, run, stderr, stdout, succeeded};
use plant_sim::effects::REGISTRY;
use std::fs;

/// What a call that must not fail prints.
fn said(folder: &Folder, call: &str) -> String {
    let output = run(folder, call);
    assert_eq!(succeeded(&output), "", "{call}");
    stdout(&output)
}

const CREEP: &str = "\n[[effect]]\nid = \"creep\"\nform = \"kelvin-voigt\"\n[effect.parameters]\n\
                     stiffness_ratio = { value = 0.1, sigma = 0.1, source = \"made\" }\n\
                     time_constant_s = { value = 0.02, sigma = 0.1, source = \"made\" }\n";

#[test]
fn the_table_lists_every_effect_and_each_says_everything() {
    let folder = Folder::new("effects");
    let table = said(&folder, "effects");
    assert!(table.lines().all(|line| line.chars().count() <= 100), "{table}");
    for effect in REGISTRY {
        let id = effect.id();
        assert_eq!(table.lines().filter(|line| line.split_whitespace().next() == Some(id)).count(), 1, "{id}");
        let entry = said(&folder, &format!("effects {id}"));
        let words = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let about = effect.about();
        let said = [about.what, about.equation, about.source, about.signature, about.experiment, about.spec];
        for text in
            said.into_iter().chain(effect.forms().iter().map(|form| form.name)).chain(about.rivals.iter().copied())
        {
            assert!(words(&entry).contains(&words(text)), "{id} does not say {text:?}:\n{entry}");
        }
    }
}

#[test]
fn the_document_is_what_the_registry_says() {
    let folder = Folder::new("effects-markdown");
    let document = fs::read_to_string(root().join("docs/effects.md")).expect("a file of the project");
    assert!(
        document == said(&folder, "effects --markdown"),
        "docs/effects.md is out of date: run `cargo run -- effects --markdown > docs/effects.md`"
    );
}

#[test]
fn an_unknown_effect_is_a_wrong_call_that_names_the_nearest() {
    let output = run(&Folder::new("effects-unknown"), "effects vibration");
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        stderr(&output),
        "hysteron: unknown effect \"vibration\": did you mean \"vibration_mode\"? `hysteron effects` lists all\n"
    );
    assert_eq!(stdout(&output), "");
}

#[test]
fn every_command_takes_a_plant_that_carries_an_effect() {
    let folder = Folder::new("effects-carried");
    let nominal = fs::read_to_string(root().join(PLANT)).expect("a file of the project");
    folder.write("nominal.toml", &nominal);
    folder.write("augmented.toml", nominal + CREEP);
    let drive = "hold:30V@0.1s+hold:55V@0.1s+hold:-20V@0.1s+sine:74V@20Hz,for=0.2s+sine:68V@100Hz,for=0.1s";
    said(&folder, &format!("simulate --plant @/augmented.toml --command {drive} --rate 10000 --out @/log.csv"));
    let fit = |plant: &str| {
        let call = format!("replay --plant @/{plant} @/log.csv --initial relaxed --out @/prediction.csv --json");
        number(&json(&run(&folder, &call)), "fit_percent")
    };
    // A log is printed with a picometre of rounding; creep by a tenth of the stiffness is several per cent of the span.
    assert!(fit("augmented.toml") > 99.99);
    assert!(fit("nominal.toml") < 98.0);
    let call = "identify --model phs --plant @/augmented.toml @/log.csv --initial relaxed --out @/fitted.toml --json";
    let identified = json(&run(&folder, call));
    assert_eq!(identified["hysterons"], 2);
    assert!(number(&identified, "fit_percent") > 99.99);
    assert!(folder.read("fitted.toml").contains("[[effect]]\nid = \"creep\"\nform = \"kelvin-voigt\"\n"));
    assert!(fit("fitted.toml") > 99.99);
}
