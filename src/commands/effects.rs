//! `hysteron effects`: the registry, as a table, one entry in full, or all of it as Markdown (`docs/effects.md`).

use crate::arguments::EffectsCall;
use crate::failure::Failure;
use crate::output;
use plant_sim::effects::sane::{EXAMPLE, EXAMPLE_WORDS, short};
use plant_sim::effects::{self, Effect, Form, Kind, Parameter, REGISTRY, Role};

/// Columns of a terminal.
const WIDTH: usize = 100;
/// Starts that are listed one by one.
const FEW: usize = 5;

pub fn effects(call: &EffectsCall) -> Result<(), Failure> {
    let text = match &call.id {
        _ if call.markdown => markdown(),
        None => table(),
        Some(id) => match effects::find(id) {
            Some(effect) => entry(effect),
            None => {
                let nearest = effects::nearest(id);
                return Err(Failure::call(format!(
                    "unknown effect {id:?}: did you mean {nearest:?}? `hysteron effects` lists all"
                )));
            }
        },
    };
    text.lines().for_each(output::line);
    Ok(())
}

/// Every entry with what it is, stage by stage.
fn table() -> String {
    let width = REGISTRY.iter().map(|effect| effect.id().len()).max().unwrap_or(0);
    let mut text = String::new();
    for (i, effect) in REGISTRY.iter().enumerate() {
        if i == 0 || REGISTRY[i - 1].stage() != effect.stage() {
            text += &format!("{}{}\n", if i == 0 { "" } else { "\n" }, effect.stage().name());
        }
        text += &labelled(effect.id(), width, effect.about().what);
    }
    text + "\n`hysteron effects ID` says everything about one of them.\n"
}

/// Label and text in two columns, the text wrapped.
fn labelled(label: &str, width: usize, text: &str) -> String {
    let lines = wrapped(text, WIDTH - width - 4);
    let line = |(i, line): (usize, &String)| format!("  {:width$}  {line}\n", if i == 0 { label } else { "" });
    lines.iter().enumerate().map(line).collect()
}

fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut().filter(|line| line.chars().count() + 1 + word.chars().count() <= width) {
            Some(line) => *line += &format!(" {word}"),
            None => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Everything there is to say about one entry.
fn entry(effect: &dyn Effect) -> String {
    let about = effect.about();
    let mut text = format!("{} ({}): {}\n\n", effect.id(), effect.stage().name(), about.title);
    for (label, words) in [
        ("what", about.what),
        ("equation", about.equation),
        ("source", about.source),
        ("typical", about.typical),
        ("installs", about.installs),
        ("shows as", about.signature),
        ("rivals", &about.rivals.join(", ")),
        ("experiment", about.experiment),
        ("SPEC", if about.spec.is_empty() { "none" } else { about.spec }),
    ] {
        text += &labelled(label, 10, words);
    }
    text += &format!("\nforms, with bounds for {EXAMPLE_WORDS}\n");
    for form in effect.forms() {
        text += &format!("\n  {} ({})\n", form.name, kind(form.kind));
        let parameters = (form.parameters)(&EXAMPLE);
        let rows: Vec<[String; 3]> = parameters.iter().map(row).collect();
        let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let (names, bounds) = (width(0), width(1));
        for [name, range, values] in &rows {
            text += &format!("    {name:names$}  {range:bounds$}  {values}\n");
        }
        if rows.is_empty() {
            text += "    no parameters\n";
        }
    }
    text
}

/// Name, bounds, and where a search starts.
fn row(parameter: &Parameter) -> [String; 3] {
    let [low, high] = parameter.bounds.map(short);
    let values = match &parameter.role {
        Role::Amplitude(typical) => format!("typically {}", short(*typical)),
        Role::Shape(starts) | Role::Place(starts) if starts.len() <= FEW => {
            format!("from {}", starts.iter().map(|start| short(*start)).collect::<Vec<_>>().join(", "))
        }
        Role::Shape(starts) | Role::Place(starts) => {
            let [first, last] = [0, starts.len() - 1].map(|i| short(starts[i]));
            format!("from {} values, {first} to {last}", starts.len())
        }
    };
    let unit = if parameter.unit.is_empty() { String::new() } else { format!(" {}", parameter.unit) };
    let own = if parameter.is_of_each_log() { "; of each log" } else { "" };
    [parameter.name.to_owned(), format!("{low} .. {high}{unit}"), values + own]
}

fn kind(kind: Kind) -> &'static str {
    match kind {
        Kind::Predictable => "a simulation predicts it",
        Kind::Spread => "it changes the spread of what can't be predicted",
        Kind::Mean => "what can't be predicted does it in the mean",
        Kind::Lattice => "readings lie on a lattice",
        Kind::Events => "it acts at instants that nobody foresees",
        Kind::Start => "it is in the state at the start",
    }
}

/// `docs/effects.md`.
fn markdown() -> String {
    let mut text = format!(
        "# The registry of effects\n\n\
         Written by `hysteron effects --markdown > docs/effects.md`; a test holds the two together. The entries are code:\n\
         `plant-sim/src/effects/`, one file each.\n\n\
         An effect is something that a bench does and a nominal plant doesn't. Each entry may be written in several forms; a form is a part\n\
         of the chain with its numbers, and `[[effect]]` in a model file puts it there:\n\n\
         ```toml\n\
         [[effect]]\n\
         id = \"creep\"\n\
         form = \"kelvin-voigt\"\n\
         [effect.parameters]\n\
         stiffness_ratio = {{ value = 0.02, sigma = 0.1, source = \"assumed\" }}\n\
         time_constant_s = {{ value = 1.5, sigma = 0.1, source = \"assumed\" }}\n\
         ```\n\n\
         Names end in their SI unit. What a log has of its own may be left out of a file and is zero then. Bounds depend on the rig; here they\n\
         are those for {EXAMPLE_WORDS}.\n"
    );
    for (i, effect) in REGISTRY.iter().enumerate() {
        if i == 0 || REGISTRY[i - 1].stage() != effect.stage() {
            text += &format!("\n## {}\n", effect.stage().name());
        }
        text += &section(*effect);
    }
    text
}

fn section(effect: &dyn Effect) -> String {
    let about = effect.about();
    let rivals: Vec<String> = about.rivals.iter().map(|rival| format!("[`{rival}`](#{rival})")).collect();
    let equation = wrapped(about.equation, WIDTH).join("\n");
    let mut text = format!("\n### `{}`\n\n{}\n\n```text\n{equation}\n```\n\n", effect.id(), about.what);
    for (label, words) in [
        ("Source", about.source),
        ("Typical", about.typical),
        ("Installs", about.installs),
        ("Shows as", about.signature),
        ("Rivals", &rivals.join(", ")),
        ("Experiment", about.experiment),
    ] {
        text += &format!("- {label}: {words}\n");
    }
    if !about.spec.is_empty() {
        text += &format!("- SPEC: `{}`\n", about.spec);
    }
    text += "\n| form | parameter | bounds | search |\n| --- | --- | --- | --- |\n";
    effect.forms().iter().for_each(|form| text += &rows(form));
    text
}

fn rows(form: &Form) -> String {
    let parameters = (form.parameters)(&EXAMPLE);
    if parameters.is_empty() {
        return format!("| {} | none | | |\n", form.name);
    }
    let line = |(i, parameter): (usize, &Parameter)| {
        let [name, bounds, values] = row(parameter);
        format!("| {} | `{name}` | {bounds} | {values} |\n", if i == 0 { form.name } else { "" })
    };
    parameters.iter().enumerate().map(line).collect()
}
