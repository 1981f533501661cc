//! `hysteron board parameters`: what a board is set to, shown, changed and kept in its flash.

use crate::arguments::BoardParametersCall;
use crate::commands::board;
use crate::commands::link::standing;
use crate::failure::Failure;
use crate::output;
use hil_bridge::lockstep::idle_to_set;
use hil_bridge::run_directory::{RunError, parameters_json};
use serde_json::json;
use toml::Table;
use wire::{Parameters, ToBoard};

/// Shows the parameters in force, after putting in force what was asked for.
pub fn board_parameters(call: &BoardParametersCall) -> Result<(), Failure> {
    let mut session = standing(&call.at)?;
    let is_shown = call.set.is_empty() && call.controller.is_none() && !call.save && !call.clear_fault;
    let found = if is_shown { session.greet()? } else { idle_to_set::<_, RunError>(&mut session, call.clear_fault)? };
    let before = session.parameters()?;
    let mut asked = before;
    if let Some(path) = &call.controller {
        asked = asked.with_settings(&board::settings(path, f64::from(before.rate_hz))?);
    }
    for setting in &call.set {
        asked = changed(&asked, setting).map_err(|why| Failure::call(format!("--set {setting}: {why}")))?;
    }
    if asked != before {
        asked.check(&found.converters)?;
        session.order(&ToBoard::SetParameters(asked))?;
    }
    if call.save {
        session.order(&ToBoard::SaveParameters)?;
    }
    let after = session.parameters()?;
    if call.json {
        let value = json!({
            "board": found.board,
            "firmware": found.firmware,
            "changed": after != before,
            "saved": call.save,
            "parameters": parameters_json(&after),
        });
        output::line(&value.to_string());
        return Ok(());
    }
    output::facts(&[("board".into(), format!("{}, firmware {}", found.board, found.firmware))]);
    output::facts(&lines(&before, &after));
    output::line(match (call.save, after != before) {
        (true, _) => "saved: the board starts with these from now on",
        (false, true) => "in force until the board is reset: --save keeps them",
        (false, false) => "nothing was changed",
    });
    Ok(())
}

/// One parameter another, by `NAME=VALUE`.
fn changed(parameters: &Parameters, setting: &str) -> Result<Parameters, String> {
    let (name, value) = setting.split_once('=').ok_or("it is to be NAME=VALUE")?;
    let mut table = Table::try_from(parameters).map_err(|error| error.to_string())?;
    let names = || lines(parameters, parameters).into_iter().map(|(name, _)| name).collect::<Vec<_>>().join(", ");
    let place = table.get_mut(name).ok_or_else(|| format!("no such parameter; there are {}", names()))?;
    *place = if place.is_integer() {
        let whole: u16 = value.parse().map_err(|_| "a whole number from 0 to 65535 is needed")?;
        toml::Value::from(u32::from(whole))
    } else {
        let real: f32 = value.parse().map_err(|_| "a number is needed, or inf")?;
        toml::Value::from(real)
    };
    table.try_into().map_err(|error: toml::de::Error| error.message().to_owned())
}

/// Each parameter with its value, and what that was, in their own order and the shortest decimals that mean the board's 32 bits.
fn lines(before: &Parameters, after: &Parameters) -> Vec<(String, String)> {
    let text = |parameters| toml::to_string(parameters).unwrap_or_default();
    let (old, new) = (text(before), text(after));
    let named = |line: &str| line.split_once(" = ").map(|(name, value)| (name.to_owned(), value.to_owned()));
    let pairs = old.lines().zip(new.lines()).filter_map(|(old, new)| {
        let ((_, old), (name, new)) = (named(old)?, named(new)?);
        Some((name, if old == new { new } else { format!("{new}, was {old}") }))
    });
    pairs.collect()
}
