//! Writes a case into a directory, and its truth beside it:
//! `cargo run --release -p blind-truth --example make_case -- creep 7 develop full OUTDIR`
//!
//! The first word is `null`, an effect's identifier, two of them joined by `+`, or a foreign kind's name.

use blind_truth::{EffectId, ForeignKind, Request, Size, Split, Subject, make};
use std::error::Error;
use std::fs;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [subject, seed, split, size, out] = words.as_slice() else {
        return Err("usage: make_case SUBJECT SEED develop|calibrate|report full|short OUTDIR".into());
    };
    let subject = if subject == "null" {
        Subject::Null
    } else if let Some(kind) = ForeignKind::from_id(subject) {
        Subject::Foreign(kind)
    } else {
        let effect = |id: &str| EffectId::from_id(id).ok_or_else(|| format!("no effect is called {id}"));
        Subject::Effects(subject.split('+').map(effect).collect::<Result<_, _>>()?)
    };
    let split = match split.as_str() {
        "develop" => Split::Develop,
        "calibrate" => Split::Calibrate,
        "report" => Split::Report,
        other => return Err(format!("no split is called {other}").into()),
    };
    let size = match size.as_str() {
        "full" => Size::Full,
        "short" => Size::Short,
        other => return Err(format!("no size is called {other}").into()),
    };
    let started = std::time::Instant::now();
    let case = make(&Request { seed: seed.parse()?, subject, split, size, strength: None });
    let made_s = started.elapsed().as_secs_f64();
    let folder = Path::new(out);
    fs::create_dir_all(folder)?;
    fs::write(folder.join("nominal.toml"), &case.plant_toml)?;
    for log in case.logs.iter().chain(&case.held_out) {
        fs::write(folder.join(format!("{}.csv", log.name)), log.to_csv())?;
    }
    let truth = &case.truth;
    let mut text = format!("id: {}\nseed: {}\nsplit: {}\n", case.id, case.seed, split.id());
    for effect in &truth.effects {
        text += &format!("effect: {} ({})\n", effect.id(), effect.stage());
    }
    if let Some(kind) = truth.foreign {
        text += &format!("foreign: {}\n", kind.id());
    }
    text += &format!("form: {}\n", truth.form);
    for (name, value) in &truth.parameters {
        text += &format!("parameter: {name} = {value:e}\n");
    }
    text += &format!("gap_over_noise: {:.3}\nnoise_um: {:.6}\n", truth.gap_over_noise, truth.noise_um);
    // Outside the folder, which can then be handed over whole.
    fs::write(format!("{}.truth.txt", out.trim_end_matches('/')), text)?;
    let seconds: f64 = case.logs.iter().map(|log| log.seconds()).sum();
    println!("{}: {seconds:.2} s in {} logs, made in {made_s:.2} s", case.id, case.logs.len());
    Ok(())
}
