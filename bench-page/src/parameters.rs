//! The parameters as the page shows them: a tree with units, limits and when each may change, over [`wire::Parameters`].
//!
//! The page has micrometres and milliseconds, the board SI; the factors are here and nowhere else on the page. Whether a set can be used as a
//! whole is the board's own check ([`Parameters::check`]), not this table's: the limits here are what a form can say at once.

use control_core::Settings;
use plant_sim::controller::{Controller, GuardSection, LimitsSection, ReferenceSection, SCHEMA};
use plant_sim::param::Param;
use serde_json::{Map, Value, json};
use wire::Parameters;

/// One parameter of the tree.
pub struct Field {
    /// Key, as in controller files where they have it.
    pub key: &'static str,
    /// Branch of the tree.
    pub group: &'static str,
    /// In words.
    pub label: &'static str,
    /// Unit on the page.
    pub unit: &'static str,
    /// SI value of one such unit.
    pub scale: f64,
    /// Least and greatest value, in the page's unit.
    pub limits: [f64; 2],
    /// Whether it may change while the loop runs; others only while idle.
    pub live: bool,
    get: fn(&Parameters) -> f32,
    set: fn(&mut Parameters, f32),
}

macro_rules! field {
    ($key:literal, $group:literal, $label:literal, $unit:literal, $scale:literal, $limits:expr, $live:literal, $name:ident) => {
        Field {
            key: $key,
            group: $group,
            label: $label,
            unit: $unit,
            scale: $scale,
            limits: $limits,
            live: $live,
            get: |parameters| parameters.$name,
            set: |parameters, value| parameters.$name = value,
        }
    };
}

/// All of them. The limits are of the order that no bench of this kind leaves: ten times the thesis' gains, the bender's 120 um, amplifiers' volts.
pub const FIELDS: &[Field] = &[
    field!("kp", "law", "proportional gain Kp", "V/um", 1e6, [0.0, 20.0], true, kp_v_per_m),
    field!("ki", "law", "integral gain Ki", "V/(um ms)", 1e9, [0.0, 20.0], true, ki_v_per_m_s),
    field!("feedforward", "law", "static feedforward", "V/um", 1e6, [0.0, 20.0], true, feedforward_v_per_m),
    field!("drive_min", "drive limits", "lowest drive", "V", 1.0, [-200.0, 0.0], true, drive_min_v),
    field!("drive_max", "drive limits", "highest drive", "V", 1.0, [0.0, 200.0], true, drive_max_v),
    field!("slew", "drive limits", "largest slew", "V/ms", 1e3, [0.001, 1e6], true, slew_v_per_s),
    field!("reference_max", "reference", "clamp at +-", "um", 1e-6, [0.1, 1e3], true, reference_max_m),
    field!("reference_rate", "reference", "largest rate", "mm/s", 1e-3, [0.01, 1e5], true, reference_rate_m_per_s),
    field!(
        "reference_acceleration",
        "reference",
        "largest acceleration",
        "m/s^2",
        1.0,
        [0.1, 1e6],
        true,
        reference_acceleration_m_per_s2
    ),
    field!("trip", "guard", "displacement trip", "um", 1e-6, [0.1, 1e3], true, trip_m),
    field!("stop_time", "guard", "looks ahead by", "us", 1e-6, [0.0, 1e4], true, stop_time_s),
    field!("monitor_tolerance", "board", "monitor may differ by", "V", 1.0, [0.01, 200.0], false, monitor_tolerance_v),
    field!("link_timeout", "board", "silent host is a fault after", "ms", 1e-3, [1.0, 6e4], false, link_timeout_s),
];

/// The table, for the page.
pub fn tree() -> Value {
    let field = |field: &Field| {
        json!({
            "key": field.key, "group": field.group, "label": field.label, "unit": field.unit,
            "least": field.limits[0], "most": field.limits[1], "live": field.live,
        })
    };
    FIELDS.iter().map(field).collect()
}

/// Values in the page's units.
pub fn values(parameters: &Parameters) -> Map<String, Value> {
    let value = |field: &Field| {
        // Seven digits are all that an f32 has; its other digits would only look like some.
        let shown = f64::from((field.get)(parameters)) / field.scale;
        let rounded = format!("{shown:.6e}").parse::<f64>().unwrap_or(shown);
        (field.key.to_owned(), json!(rounded))
    };
    FIELDS.iter().map(value).collect()
}

/// `parameters` with the values of the page; what the page did not send stays.
///
/// # Errors
/// One line: which key is unknown or out of its limits.
pub fn changed(parameters: &Parameters, values: &Map<String, Value>) -> Result<Parameters, String> {
    let mut changed = *parameters;
    let shown = self::values(parameters);
    for (key, value) in values {
        let field = FIELDS.iter().find(|field| field.key == key).ok_or_else(|| format!("{key}: no such parameter"))?;
        let number = value.as_f64().ok_or_else(|| format!("{}: not a number", field.label))?;
        // What was not touched keeps its bits, although the page has seven digits of it.
        if shown.get(key).and_then(Value::as_f64) == Some(number) {
            continue;
        }
        let [least, most] = field.limits;
        if !(least..=most).contains(&number) {
            return Err(format!("{}: {number} {} is outside {least} to {most}", field.label, field.unit));
        }
        (field.set)(&mut changed, (number * field.scale) as f32);
    }
    Ok(changed)
}

/// Labels and new values of what differs, for the list of events.
pub fn difference(before: &Parameters, after: &Parameters) -> String {
    let (old, new) = (values(before), values(after));
    let changed = FIELDS.iter().filter(|field| old[field.key] != new[field.key]);
    let words: Vec<String> = changed
        .map(|field| format!("{} {} -> {} {}", field.label, old[field.key], new[field.key], field.unit))
        .collect();
    words.join(", ")
}

/// A controller file with these settings.
pub fn controller(name: &str, settings: &Settings) -> Controller {
    let param = |value: f64| Param { value, sigma: None, sigma_abs: None, source: "set on the bench page".into() };
    // Seven digits of an f32, so that 0.1 is not 0.10000000149.
    let round = |value: f32, scale: f64| param(format!("{:.6e}", f64::from(value) * scale).parse().unwrap_or_default());
    let bounded = |value: f32, scale| value.is_finite().then(|| round(value, scale));
    Controller {
        schema: SCHEMA.to_owned(),
        name: name.to_owned(),
        kp_v_per_m: round(settings.kp_v_per_m, 1.0),
        ki_v_per_m_s: round(settings.ki_v_per_m_s, 1.0),
        feedforward_v_per_m: round(settings.feedforward_v_per_m, 1.0),
        unlimited: false,
        limits: Some(LimitsSection {
            min_v: round(settings.drive_min_v, 1.0),
            max_v: round(settings.drive_max_v, 1.0),
            slew_v_per_s: round(settings.slew_v_per_s, 1.0),
        }),
        reference: Some(ReferenceSection {
            max_um: round(settings.reference_max_m, 1e6),
            rate_um_per_s: bounded(settings.reference_rate_m_per_s, 1e6),
            acceleration_um_per_s2: bounded(settings.reference_acceleration_m_per_s2, 1e6),
        }),
        guard: Some(GuardSection {
            trip_um: round(settings.trip_m, 1e6),
            stop_time_us: round(settings.stop_time_s, 1e6),
        }),
        inverse: None,
        design: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn what_the_page_sends_back_untouched_changes_no_bit() {
        let parameters = Parameters::NUCLEO_PI1;
        assert_eq!(changed(&parameters, &values(&parameters)), Ok(parameters));
    }

    #[test]
    fn a_value_is_set_in_si_and_named_in_the_events() {
        let before = Parameters::NUCLEO_PI1;
        let set = |key: &str, value: Value| changed(&before, &Map::from_iter([(key.to_owned(), value)]));
        let after = set("kp", json!(0.5)).unwrap();
        assert_eq!((after.kp_v_per_m, after.ki_v_per_m_s), (5e5, before.ki_v_per_m_s));
        assert_eq!(difference(&before, &after), "proportional gain Kp 0.85811 -> 0.5 V/um");
        assert_eq!(set("trip", json!(110)).unwrap().trip_m, 110e-6);
        for (key, value, part) in [
            ("kp", json!(-1), "outside"),
            ("kp", json!("x"), "not a number"),
            ("kp", json!(null), "not a number"),
            ("speed", json!(1), "no such parameter"),
        ] {
            let error = set(key, value).unwrap_err();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn every_default_lies_within_its_limits() {
        let shown = values(&Parameters::NUCLEO_PI1);
        for field in FIELDS {
            let value = shown[field.key].as_f64().unwrap();
            assert!((field.limits[0]..=field.limits[1]).contains(&value), "{} {value}", field.key);
        }
    }

    #[test]
    fn a_saved_set_is_a_controller_file_with_the_same_settings() {
        let settings = Parameters::NUCLEO_PI1.settings();
        let text = toml::to_string(&controller("mine", &settings)).unwrap();
        let read = Controller::parse(&text, Path::new("mine.toml")).unwrap();
        let again = read.settings(20e3);
        // One rounding to seven digits and one back are at most a part in 2^22.
        assert!((again.kp_v_per_m / settings.kp_v_per_m - 1.0).abs() < 2.4e-7);
        assert!((again.trip_m / settings.trip_m - 1.0).abs() < 2.4e-7);
    }
}
