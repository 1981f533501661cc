//! The part of the diagnosis page that shows where the gap lies, from a [`Where`] before and one after the named effects.

use super::number::{short_percent, three_digits};
use super::{Axis, BarItem, BarList, HeatMap, HeatScale, Ink, Page, Strip};
use crate::locate::{Harmonic, Power, StagePart, StateMap, Where};

/// Shares below this are left out of the lists of rates, of which most are empty.
const LEAST_PERCENT: f64 = 0.05;

/// Everything of `before`; `after` is set beside it where a comparison says something.
pub(super) fn location(page: &mut Page, before: &Where, after: Option<&Where>) {
    page.paragraph(
        "Shares are of the reducible power: squared residual after the refit, less that of the noise. Pale bars show what the time spent \
         there would give by itself; a bar that outruns its pale one is a place where the gap lives.",
    );
    strips(page, before, after);
    page.bar_lists(&[bands(before, after), character(before), stages(before), amplitudes(before), rates(before)]);
    harmonics(page, before);
    maps(page, before, after);
}

/// `520 → 21 nm`: rms before and after.
fn rms_note(before: &Power, after: Option<&Power>) -> String {
    let nanometres = |power: &Power| three_digits(1e3 * power.rms_um);
    let later = after.map_or(String::new(), |after| format!(" → {}", nanometres(after)));
    format!("{}{later} nm", nanometres(before))
}

fn bands(before: &Where, after: Option<&Where>) -> BarList {
    let of_after = |idx: usize| after.and_then(|after| after.bands.get(idx)).map(|band| &band.power);
    BarList {
        title: "Frequency".to_owned(),
        caption: "Share per band, with the rms before and after the named effects.".to_owned(),
        ink: Ink::Error,
        full_percent: None,
        items: before
            .bands
            .iter()
            .enumerate()
            .map(|(idx, band)| BarItem {
                label: range(band.from_hz, band.to_hz, "Hz"),
                percent: band.power.share_percent,
                behind_percent: None,
                note: rms_note(&band.power, of_after(idx)),
            })
            .collect(),
    }
}

fn stages(before: &Where) -> BarList {
    let item = |part: &StagePart| BarItem {
        label: part.stage.to_owned(),
        percent: part.share_percent,
        behind_percent: None,
        note: part.effect.to_owned(),
    };
    BarList {
        title: "Stage of the chain".to_owned(),
        caption: "What the most promising entry of each stage could explain, by a score test; stages overlap."
            .to_owned(),
        ink: Ink::Model,
        full_percent: Some(100.0),
        items: before.stages.iter().map(item).collect(),
    }
}

fn strips(page: &mut Page, before: &Where, after: Option<&Where>) {
    let of_after = |idx: usize| after.and_then(|after| after.logs.get(idx)).map(|log| &log.power);
    // Two logs may have one name; the first segment of each log begins at 0.
    let per_log = before.segments.chunk_by(|_, later| later.from_s > 0.0);
    let strips: Vec<Strip> = before
        .logs
        .iter()
        .zip(per_log)
        .enumerate()
        .map(|(idx, (log, segments))| Strip {
            label: log.log.clone(),
            note: format!(
                "{} in {} s, rms {}, noise {}",
                short_percent(log.power.share_percent),
                three_digits(log.duration_s),
                rms_note(&log.power, of_after(idx)),
                short_percent(log.power.noise_percent)
            ),
            values: segments.iter().map(|segment| segment.power.share_percent).collect(),
            readings: segments
                .iter()
                .map(|segment| {
                    format!(
                        "{}: {} of the gap, rms {}",
                        range(segment.from_s, segment.to_s, "s"),
                        short_percent(segment.power.share_percent),
                        rms_note(&segment.power, None)
                    )
                })
                .collect(),
        })
        .collect();
    page.strips(
        "Logs and stretches of time",
        "Each log from its beginning to its end; the deeper the colour, the more of the gap lies there. Beside it: its share of the gap, \
         its duration, its rms before and after the named effects, and the noise's share of its power.",
        &strips,
    );
}

fn amplitudes(before: &Where) -> BarList {
    BarList {
        title: "Drive".to_owned(),
        caption: "Share per magnitude of the drive, with the rms; pale: share of the time.".to_owned(),
        ink: Ink::Error,
        full_percent: None,
        items: before
            .amplitudes
            .iter()
            .map(|bin| BarItem {
                label: range(bin.from_v, bin.to_v, "V"),
                percent: bin.power.share_percent,
                behind_percent: Some(bin.time_percent),
                note: rms_note(&bin.power, None),
            })
            .collect(),
    }
}

fn rates(before: &Where) -> BarList {
    BarList {
        title: "Rate of the drive".to_owned(),
        caption: "Share per magnitude of the drive's rate, with the rms; pale: share of the time.".to_owned(),
        ink: Ink::Error,
        full_percent: None,
        items: before
            .rates
            .iter()
            .filter(|bin| bin.power.share_percent >= LEAST_PERCENT || bin.time_percent >= LEAST_PERCENT)
            .map(|bin| BarItem {
                label: if bin.to_v_per_s == 0.0 {
                    "at rest".to_owned()
                } else {
                    range(bin.from_v_per_s, bin.to_v_per_s, "V/s")
                },
                percent: bin.power.share_percent,
                behind_percent: Some(bin.time_percent),
                note: rms_note(&bin.power, None),
            })
            .collect(),
    }
}

fn character(before: &Where) -> BarList {
    let found = &before.character;
    let item = |label: &str, percent, behind_percent, note: &str| BarItem {
        label: label.to_owned(),
        percent,
        behind_percent,
        note: note.to_owned(),
    };
    let correlation = |label: &str, value: f64, note: &str| {
        item(label, 100.0 * value.abs(), None, &format!("{value:+.2}; {note}").replace('-', "−"))
    };
    let mut items = vec![
        item("a constant per log", found.offset_percent, None, "offset"),
        item("odd in the drive", found.odd_in_drive_percent, None, "gain, odd nonlinearity"),
        item("even in the drive", found.even_in_drive_percent, None, "asymmetry"),
        item("rising less falling", found.loop_percent, None, "hysteresis or a lag"),
        item("while it rises", found.rising_percent, Some(found.rising_time_percent), ""),
        item("while it falls", found.falling_percent, Some(found.falling_time_percent), ""),
        item("while it rests", found.rest_percent, Some(found.rest_time_percent), "creep, drift, hum"),
    ];
    if let Some(coherent_percent) = found.coherent_percent {
        items.push(item("the same in every period", coherent_percent, None, "no noise, nothing unlocked"));
    }
    items.extend([
        correlation("correlation with displacement", found.displacement_correlation, "gain, stiffness"),
        correlation("with velocity", found.velocity_correlation, "lag if negative"),
        correlation("with acceleration", found.acceleration_correlation, "mass, second lag"),
    ]);
    BarList {
        title: "How it goes with the motion".to_owned(),
        caption: "Shares that overlap, and correlations (a bar of 100 % is ±1).".to_owned(),
        ink: Ink::Extra,
        full_percent: Some(100.0),
        items,
    }
}

fn harmonics(page: &mut Page, before: &Where) {
    if before.harmonics.stretches.is_empty() {
        return;
    }
    let cell = |harmonic: &Harmonic| {
        // Three sigma: below, noise alone makes such an amplitude too often.
        if harmonic.amplitude_um > 3.0 * harmonic.sigma_um {
            format!("{} ∠ {:.0}°", three_digits(1e3 * harmonic.amplitude_um), harmonic.phase_deg).replace('-', "−")
        } else {
            "–".to_owned()
        }
    };
    let rows: Vec<Vec<String>> = before
        .harmonics
        .stretches
        .iter()
        .map(|stretch| {
            let mut row = vec![
                stretch.log.clone(),
                range(stretch.from_s, stretch.to_s, "s"),
                format!("{} Hz", three_digits(stretch.fundamental_hz)),
                format!("{} V", three_digits(stretch.drive_amplitude_v)),
            ];
            row.extend(stretch.harmonics.iter().map(cell));
            row
        })
        .collect();
    page.table(
        "Harmonics of the residual where the drive is periodic: amplitude in nm and phase against the drive; a dash is within three sigma of nothing. \
         Odd orders point to symmetric effects (hysteresis, friction, cubic stiffness), even ones to asymmetry.",
        &["log", "stretch", "drive", "amplitude", "1", "2", "3", "4", "5", "6", "7"],
        &rows,
    );
}

fn maps(page: &mut Page, before: &Where, after: Option<&Where>) {
    let mut maps = Vec::new();
    for (idx, map) in before.states.iter().enumerate() {
        let over = format!("over {} and {}", map.x.quantity, map.y.quantity);
        let mean = heat_map(map, &map.mean_um, HeatScale::Diverging, &format!("Mean residual {over}"), "mean residual");
        match after.and_then(|after| after.states.get(idx)) {
            Some(later) => {
                let limit = Some(mean.limit());
                let mut then =
                    heat_map(later, &later.mean_um, HeatScale::Diverging, "With the named effects", "mean residual");
                then.limit = limit;
                maps.extend([mean, then]);
            }
            None => {
                let rms =
                    heat_map(map, &map.rms_um, HeatScale::Sequential, &format!("Rms residual {over}"), "rms residual");
                maps.extend([mean, rms]);
            }
        }
    }
    page.heat_maps(&maps);
}

fn heat_map(map: &StateMap, values: &[f64], scale: HeatScale, title: &str, quantity: &str) -> HeatMap {
    HeatMap {
        title: title.to_owned(),
        caption: match scale {
            HeatScale::Diverging => {
                "Orange: the bench lies above the model, blue: below it. An upper half of one colour and a lower of the other is a loop."
            }
            HeatScale::Sequential => "Deep where the model fails most.",
        }
        .to_owned(),
        x: Axis::new(map.x.quantity, map.x.unit),
        y: Axis::new(map.y.quantity, map.y.unit),
        x_edges: map.x.edges.clone(),
        y_edges: map.y.edges.clone(),
        values: values.to_vec(),
        quantity: quantity.to_owned(),
        unit: "µm".to_owned(),
        scale,
        limit: None,
    }
}

/// `4.64 to 10 Hz`.
fn range(from: f64, to: f64, unit: &str) -> String {
    format!("{} to {} {unit}", three_digits(from), three_digits(to))
}
