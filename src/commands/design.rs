//! `hysteron design`: a controller from a wish, or `--check` of one.

use crate::arguments::DesignCall;
use crate::commands::loops::{Free, advised, within_rig};
use crate::failure::Failure;
use crate::output;
use control_core::{Inverse, MOST_HYSTERONS};
use gap_diagnosis::page::{BodeView, DesignView, Ink, PlaneView, TableView, design_page, four_digits, pole};
use plant_sim::controller::{Controller, InverseSection};
use plant_sim::design::{
    Branch, Check, Design, Frame, LowestRate, SINES_HZ, Skeleton, Wish, check, continuous, design as find,
    sampled_locus, tracking,
};
use plant_sim::margins::{Assessment, LinearRegion, Verdict, closed_loop_poles, open_loop};
use plant_sim::model::{Kind, Model};
use plant_sim::param::Param;
use plant_sim::reduce::{quasi_static, speeds};
use std::path::Path;

/// The controller whose limits and shaping a design takes where none is given.
const LIKE: &str = include_str!("../../controllers/pi1.toml");
/// Points of a frequency response.
const N_FREQUENCIES: usize = 500;
/// Regions that a page draws: those with the worst margins.
const N_DRAWN: usize = 4;

pub fn design(call: &DesignCall) -> Result<(), Failure> {
    let model = Model::read(&call.plant)?;
    let chain = model.chain();
    let mut warnings = output::about(&call.plant, model.warnings());
    let given = call.controller.as_ref().map(|path| Controller::read(path)).transpose()?;
    if call.check {
        let Some(controller) = given else {
            return Err(Failure::call("--check needs a controller: give --controller"));
        };
        let inverse = inverse(&controller, path_of(call), call.rate, call.delay_us * 1e-6)?;
        let settings = controller.settings(call.rate);
        let beyond = model.rig.iter().flat_map(|rig| rig.beyond(&settings));
        warnings.extend(beyond.map(|beyond| format!("{}: {beyond}", path_of(call).display())));
        let frame = Frame { chain: &chain, settings, delay_s: call.delay_us * 1e-6, inverse: inverse.as_ref() };
        return run_check(call, &model, &controller, &frame, &mut warnings);
    }
    if given.is_none() && model.rig.is_none() {
        warnings.push(
            "--plant has no [rig]: the limits are those of the thesis' bender, +-90 V and 120 um; state what your stage stands".into(),
        );
    }
    let mut controller = match given {
        Some(controller) => controller,
        None => bounded_by_rig(Controller::parse(LIKE, Path::new("controllers/pi1.toml"))?, &model),
    };
    if controller.unlimited {
        return Err(Failure::call(
            "a design has limits: give it [limits], [reference] and [guard] in place of `unlimited = true`",
        )
        .about(path_of(call)));
    }
    if let Some(rig) = &model.rig {
        within_rig(path_of(call), rig, &controller.settings(call.rate))?;
    }
    let source = format!("hysteron design on {}", output::file_name(&call.plant));
    let of = |value: f64| Param { value, sigma: None, sigma_abs: None, source: source.clone() };
    controller.feedforward_v_per_m = of(1.0 / chain.plant.static_gain_m_per_v());
    controller.inverse = None;
    if call.inverse {
        if model.kind != Kind::Phs {
            return Err(Failure::call("--inverse inverts hysterons: give a plant of kind phs"));
        }
        let n = chain.plant.hysterons.len();
        if n > MOST_HYSTERONS {
            return Err(Failure::call(format!(
                "--inverse inverts at most {MOST_HYSTERONS} hysterons, and --plant has {n}, those of its effects included: leave it out, or fit fewer"
            )));
        }
        controller.inverse = Some(InverseSection::of(&chain, &source));
    }
    let inverse = inverse(&controller, &call.out, call.rate, call.delay_us * 1e-6)?;
    let settings = controller.settings(call.rate);
    let frame = Frame { chain: &chain, settings, delay_s: call.delay_us * 1e-6, inverse: inverse.as_ref() };
    let clamp_um = 1e6 * f64::from(settings.reference_max_m);
    if call.step_um > clamp_um * (1.0 + f64::from(f32::EPSILON)) {
        return Err(Failure::call(format!(
            "--step-um {} lies beyond the clamp of the reference, {clamp_um:.1} um (of --controller, else five sixths of [rig] displacement_max_um): lower it",
            call.step_um
        )));
    }
    let wish = Wish {
        settling_s: call.settle_ms * 1e-3,
        overshoot_percent: call.overshoot,
        step_m: call.step_um * 1e-6,
        gain_margin_db: call.gain_margin_db,
        phase_margin_deg: call.phase_margin_deg,
    };
    let spinner = output::spinner();
    spinner.set_message("placing poles");
    let found = find(&frame, &wish)?;
    spinner.finish_and_clear();
    controller.name = format!("PI designed on {}", model.name);
    controller.kp_v_per_m = of(found.placement.kp_v_per_m);
    controller.ki_v_per_m_s = of(found.placement.ki_v_per_m_s);
    controller.design = Some(provenance_table(call));
    let frame = Frame { settings: controller.settings(call.rate), ..frame };
    let tracked = if call.track { Some(tracking(&frame)?) } else { None };
    controller.write(&call.out)?;
    output::warn(&warnings);
    let facts = design_facts(&controller, &found, tracked);
    if call.show.json {
        output::line(&design_json(&controller, &found, tracked).to_string());
    } else {
        output::facts(&facts);
        output::line(&format!("controller: {}", call.out.display()));
    }
    if let Some(path) = output::page_path(&call.show, &call.out) {
        let page = found_page(call, &model, &frame, &found, &facts, &warnings)?;
        output::save_page(&page, &path, call.show.json)?;
    }
    Ok(())
}

/// The file that the call's controller comes from.
fn path_of(call: &DesignCall) -> &Path {
    call.controller.as_deref().unwrap_or(Path::new("controllers/pi1.toml"))
}

/// The inverse that a controller file states, for a loop whose drive acts `delay_s` after the sample.
pub fn inverse(controller: &Controller, path: &Path, rate_hz: f64, delay_s: f64) -> Result<Option<Inverse>, Failure> {
    let wrong = |error| Failure::call(format!("{}, [inverse]: {error}", path.display()));
    controller.inverse(rate_hz, delay_s).map_err(wrong)
}

/// Limits no wider than the rig stands; the guard at its displacement.
fn bounded_by_rig(mut controller: Controller, model: &Model) -> Controller {
    let Some(rig) = &model.rig else { return controller };
    if let Some(limits) = &mut controller.limits {
        limits.min_v = rig.drive_min_v.clone();
        limits.max_v = rig.drive_max_v.clone();
    }
    let most_um = rig.displacement_max_um.value;
    if let Some(guard) = &mut controller.guard {
        guard.trip_um = rig.displacement_max_um.clone();
    }
    if let Some(reference) = &mut controller.reference {
        reference.max_um.value = most_um * 5.0 / 6.0;
        reference.max_um.source = "chosen: five sixths of the rig's displacement".into();
    }
    controller
}

fn provenance_table(call: &DesignCall) -> toml::Table {
    let mut table = toml::Table::new();
    table.insert("plant".into(), output::file_name(&call.plant).into());
    table.insert("rate_hz".into(), call.rate.into());
    table.insert("delay_us".into(), call.delay_us.into());
    table.insert("settle_ms".into(), call.settle_ms.into());
    table.insert("overshoot_percent".into(), call.overshoot.into());
    table.insert("step_um".into(), call.step_um.into());
    table.insert("gain_margin_dB".into(), call.gain_margin_db.into());
    table.insert("phase_margin_deg".into(), call.phase_margin_deg.into());
    table
}

fn margin_facts(assessment: &Assessment) -> Vec<(String, String)> {
    vec![
        ("gain margin".to_owned(), four_digits(assessment.gain_margin_db.value, "dB")),
        ("phase margin".to_owned(), four_digits(assessment.phase_margin_deg.value, "degrees")),
        ("delay margin".to_owned(), four_digits(assessment.delay_margin_s.value * 1e6, "us")),
        ("least distance from -1".to_owned(), four_digits(assessment.modulus_margin.value, "")),
    ]
}

fn design_facts(controller: &Controller, found: &Design, tracked: Option<[f64; 5]>) -> Vec<(String, String)> {
    let ms = found.step.settle_2_percent_ms.unwrap_or(f64::NAN);
    let mut facts = vec![
        ("Kp".to_owned(), four_digits(controller.kp_v_per_m.value, "V/m")),
        ("Ki".to_owned(), four_digits(controller.ki_v_per_m_s.value, "V/(m s)")),
        ("settling to 2 %".to_owned(), four_digits(ms, "ms")),
        ("overshoot".to_owned(), four_digits(found.step.overshoot_percent.unwrap_or(f64::NAN), "%")),
    ];
    facts.extend(margin_facts(&found.assessment));
    for (hz, percent) in SINES_HZ.iter().zip(tracked.iter().flatten()) {
        facts.push((format!("tracking error, {hz} Hz"), four_digits(*percent, "%")));
    }
    facts
}

fn design_json(controller: &Controller, found: &Design, tracked: Option<[f64; 5]>) -> serde_json::Value {
    serde_json::json!({
        "schema": "hysteron-design-1",
        "kp_V_per_m": controller.kp_v_per_m.value,
        "ki_V_per_m_s": controller.ki_v_per_m_s.value,
        "poles_per_s": found.placement.poles_per_s.map(|z| [z.re, z.im]),
        "settle_2_percent_ms": found.step.settle_2_percent_ms,
        "overshoot_percent": found.step.overshoot_percent,
        "gain_margin_dB": found.assessment.gain_margin_db.value,
        "phase_margin_deg": found.assessment.phase_margin_deg.value,
        "delay_margin_us": found.assessment.delay_margin_s.value * 1e6,
        "placements_tried": found.tried[0],
        "placements_with_margins": found.tried[1],
        "tracking_rms_percent": tracked.map(|errors| SINES_HZ.iter().zip(errors).map(|(hz, e)| [*hz, e]).collect::<Vec<_>>()),
    })
}

/// The reductions that the poles could be placed on, and what each costs.
fn reduction_section(model: &Model, skeleton: &Skeleton) -> Result<Option<(String, String, Vec<TableView>)>, Failure> {
    let plant = model.chain().plant;
    if model.kind != Kind::Phs || plant.hysterons.is_empty() {
        return Ok(None);
    }
    let speeds = speeds(&plant);
    let hysterons = speeds.iter().enumerate().map(|(i, speed)| {
        let verdict =
            if speed.of_mechanics > 1.0 { "slower than the mechanics: a spring" } else { "faster: a dashpot" };
        let microseconds = four_digits(speed.time_constant_s * 1e6, "us");
        vec![format!("hysteron {}", i + 1), microseconds, four_digits(speed.of_mechanics, ""), verdict.to_owned()]
    });
    let fast = |i: usize| speeds[i].of_mechanics <= 1.0;
    let mut rows = Vec::new();
    for (name, reduction) in [
        ("every hysteron a dashpot, Qi' = 0 (the thesis)", quasi_static(&plant, |_| true)?),
        ("only the fast ones dashpots, the slow ones kept", quasi_static(&plant, fast)?),
    ] {
        let poles = reduction.poles_per_s[1].iter().filter(|z| z.im >= 0.0).map(|z| pole(z.re, z.im));
        rows.push(vec![
            name.to_owned(),
            format!("{} %", four_digits(100.0 * reduction.worst_error, "")),
            four_digits(reduction.worst_hz, "Hz"),
            four_digits(reduction.worst_phase_deg, "°"),
            poles.collect::<Vec<_>>().join(", "),
        ]);
    }
    let text = format!(
        "Poles are placed on q'' + {} q' + {} q = {} u: in the loop's band a fast hysteron is a dashpot and a slow one a spring. The thesis \
         makes dashpots of all; the table says what that costs against the plant without dead zones.",
        four_digits(skeleton.damping_per_s, ""),
        four_digits(skeleton.constant_per_s2, ""),
        four_digits(skeleton.gain, "")
    );
    let tables = vec![
        TableView {
            caption: "Hysterons against the mechanics".into(),
            header: vec!["hysteron", "time constant", "of 1/sqrt(k/M)", "in the loop's band"],
            rows: hysterons.collect(),
        },
        TableView {
            caption: "What a reduction costs".into(),
            header: vec!["reduction", "worst error of static gain", "at", "worst phase below resonance", "poles, 1/s"],
            rows,
        },
    ];
    Ok(Some(("Linearised and reduced".to_owned(), text, tables)))
}

/// The regions with the worst margins, the first the worst.
fn worst_regions(regions: &[LinearRegion], assessment: &Assessment) -> Vec<LinearRegion> {
    let mut order: Vec<usize> = (0..regions.len()).collect();
    order.sort_by(|&i, &j| {
        let margin = |k: usize| assessment.regions[k].nearest_gain_margin_db();
        margin(i).total_cmp(&margin(j))
    });
    order.into_iter().take(N_DRAWN).map(|i| regions[i].clone()).collect()
}

fn margin_table(assessment: &Assessment) -> TableView {
    let row = |m: &plant_sim::margins::Margins| {
        let least =
            |value: f64, unit: &str| if value.is_finite() { four_digits(value, unit) } else { "unlimited".into() };
        vec![
            m.region.clone(),
            if m.stable { "stable".into() } else { "UNSTABLE".into() },
            least(m.nearest_gain_margin_db(), "dB"),
            least(m.phase_margin_deg, "°"),
            least(m.delay_margin_s * 1e6, "us"),
            four_digits(m.modulus_margin, ""),
        ]
    };
    TableView {
        caption: "Margins, exactly sampled and with the true delay".into(),
        header: vec!["region", "verdict", "gain", "phase", "delay", "distance from -1"],
        rows: assessment.regions.iter().map(row).collect(),
    }
}

/// Frequencies and open loops of the worst regions.
fn bode(frame: &Frame<'_>, regions: &[LinearRegion]) -> Result<(Vec<f64>, Vec<BodeView>), Failure> {
    let law = frame.law(&frame.settings);
    let top = 0.5 * law.rate_hz;
    let hz: Vec<f64> =
        (0..N_FREQUENCIES).map(|k| top * 10f64.powf(-4.0 + 4.0 * (k + 1) as f64 / N_FREQUENCIES as f64)).collect();
    let mut views = Vec::new();
    for region in regions {
        let values = open_loop(region, &law, &hz)?;
        let mut turn = 0.0;
        let mut last = f64::NAN;
        let phase_deg = values.iter().map(|value| {
            let raw = value.arg().to_degrees();
            if last - raw > 180.0 {
                turn += 360.0;
            } else if raw - last > 180.0 {
                turn -= 360.0;
            }
            last = raw;
            raw + turn
        });
        let phase_deg = phase_deg.collect();
        views.push(BodeView {
            name: region.label.clone(),
            magnitude: values.iter().map(|value| value.norm()).collect(),
            phase_deg,
        });
    }
    Ok((hz, views))
}

/// All branches as one curve, the pen lifted between them.
fn plane(name: &str, ink: Ink, branches: &[Branch]) -> PlaneView {
    let (mut x, mut y) = (Vec::new(), Vec::new());
    for branch in branches {
        x.extend(branch.iter().map(|z| z.re));
        y.extend(branch.iter().map(|z| z.im));
        x.push(f64::NAN);
        y.push(f64::NAN);
    }
    PlaneView { name: name.to_owned(), ink, x, y }
}

/// A cross at each pole, in proportion to what is drawn.
fn crosses(name: &str, ink: Ink, poles: &[[f64; 2]], drawn: &[PlaneView]) -> PlaneView {
    let span = |of: fn(&PlaneView) -> &Vec<f64>| {
        let values = || drawn.iter().flat_map(of).copied().filter(|v| v.is_finite());
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    let (wide, high) = (0.01 * span(|view| &view.x), 0.03 * span(|view| &view.y));
    let (mut x, mut y) = (Vec::new(), Vec::new());
    for [re, im] in poles {
        x.extend([re - wide, re + wide, f64::NAN, re - wide, re + wide, f64::NAN]);
        y.extend([im - high, im + high, f64::NAN, im + high, im - high, f64::NAN]);
    }
    PlaneView { name: name.to_owned(), ink, x, y }
}

fn locus(
    frame: &Frame<'_>,
    skeleton: Option<(&Skeleton, f64, f64)>,
    regions: &[LinearRegion],
) -> Result<Vec<PlaneView>, Failure> {
    let law = frame.law(&frame.settings);
    let mut views = Vec::new();
    if let Some((skeleton, kp, ki)) = skeleton {
        let branches = skeleton.locus(kp, ki);
        views.push(plane("skeleton, continuous", Ink::Drive, &branches));
    }
    let mut poles = Vec::new();
    if let Some(region) = regions.first() {
        views.push(plane(&format!("sampled, {}", region.label), Ink::Model, &sampled_locus(region, &law)?));
        let now = continuous(&closed_loop_poles(region, &law, 1.0)?, law.rate_hz);
        poles = now.iter().map(|z| [z.re, z.im]).collect();
    }
    // What is far to the left decays within a sample or two and would squeeze the rest together.
    let reach = 0.2 * law.rate_hz;
    poles.retain(|[re, _]| *re >= -reach);
    for view in &mut views {
        for (x, y) in view.x.iter_mut().zip(&mut view.y) {
            if *x < -reach {
                (*x, *y) = (f64::NAN, f64::NAN);
            }
        }
    }
    views.push(crosses("the design, sampled", Ink::Error, &poles, &views));
    Ok(views)
}

fn pole_table(frame: &Frame<'_>, found: &Design, regions: &[LinearRegion]) -> Result<TableView, Failure> {
    let law = frame.law(&frame.settings);
    let wished: Vec<String> =
        found.placement.poles_per_s.iter().filter(|z| z.im >= 0.0).map(|z| pole(z.re, z.im)).collect();
    let mut rows = vec![vec!["placed on the skeleton, continuous".to_owned(), wished.join(", ")]];
    for region in regions {
        let now = continuous(&closed_loop_poles(region, &law, 1.0)?, law.rate_hz);
        let poles: Vec<String> = now.iter().filter(|z| z.im >= 0.0).map(|z| pole(z.re, z.im)).collect();
        rows.push(vec![format!("sampled, ln z / T: {}", region.label), poles.join(", ")]);
    }
    Ok(TableView { caption: "Poles, 1/s".into(), header: vec!["loop", "poles"], rows })
}

fn found_page(
    call: &DesignCall,
    model: &Model,
    frame: &Frame<'_>,
    found: &Design,
    facts: &[(String, String)],
    warnings: &[String],
) -> Result<gap_diagnosis::page::Page, Failure> {
    let skeleton = Skeleton::of(frame.chain)?;
    let regions = worst_regions(&frame.chain.linear_regions()?, &found.assessment);
    let mut sections = Vec::new();
    sections.extend(reduction_section(model, &skeleton)?);
    let text = format!(
        "A real pole and a pair on the skeleton leave two numbers free. Of {} placements {} keep the margins in every region; the one with the most \
         integral action whose step is as wished was taken.",
        found.tried[0], found.tried[1]
    );
    let tables = vec![pole_table(frame, found, &regions)?, margin_table(&found.assessment)];
    sections.push(("Placed and sampled".to_owned(), text, tables));
    let (hz, bode) = bode(frame, &regions)?;
    let gains = (&skeleton, found.placement.kp_v_per_m, found.placement.ki_v_per_m_s);
    let locus = locus(frame, Some(gains), &regions)?;
    let micro = |values: &[f64]| values.iter().map(|v| v * 1e6).collect::<Vec<f64>>();
    let run = &found.recording;
    let time_s: Vec<f64> = (0..run.displacement_m.len()).map(|k| k as f64 * run.dt_s).collect();
    let alone = skeleton.chain(frame.chain);
    let reduced = Frame { chain: &alone, delay_s: 0.0, inverse: None, ..*frame };
    let step = plant_sim::spec::Spec::parse(&format!("step:{}um", call.step_um))?;
    let reduced = micro(&reduced.run(&step, time_s.len() as f64 * run.dt_s)?.displacement_m);
    let reduced = if reduced.len() == time_s.len() { reduced } else { Vec::new() };
    let headline = format!(
        "Settles in {} with {} overshoot; {} of gain margin in the worst region.",
        facts[2].1, facts[3].1, facts[4].1
    );
    Ok(design_page(&DesignView {
        title: "Controller design",
        subtitle: &format!("{}, {} Hz, drive {} us after the sample", model.name, call.rate, call.delay_us),
        headline: &headline,
        facts,
        warnings,
        sections: &sections,
        locus: &locus,
        frequency_hz: &hz,
        bode: &bode,
        step: [&time_s, &micro(&run.reference_m), &micro(&run.displacement_m)],
        step_reduced_um: &reduced,
        provenance: &output::provenance(None),
    }))
}

fn run_check(
    call: &DesignCall,
    model: &Model,
    controller: &Controller,
    frame: &Frame<'_>,
    warnings: &mut Vec<String>,
) -> Result<(), Failure> {
    let found = check(frame, model)?;
    let tracked = if call.track { Some(tracking(frame)?) } else { None };
    let unstable = matches!(found.assessment.verdict, Verdict::Unstable { .. });
    let advised =
        || advised(&found.assessment, &frame.chain.linear_regions()?, &frame.law(&frame.settings), Free::Both);
    if matches!(found.assessment.verdict, Verdict::BelowSixDb { .. }) {
        warnings.push(format!("{}: {}", path_of(call).display(), advised()?));
    }
    if let (Some(rig), Some(worst)) = (&model.rig, found.peaks.first())
        && worst.peak_m * 1e6 > rig.displacement_max_um.value
    {
        warnings.push(format!(
            "{}: the worst peak, {}, lies beyond [rig] displacement_max_um = {}: {} ({})",
            path_of(call).display(),
            four_digits(worst.peak_m * 1e6, "um"),
            rig.displacement_max_um.value,
            worst.scenario,
            worst.plant
        ));
    }
    if let Some(peak) = found.peaks.iter().find(|peak| peak.tripped) {
        warnings.push(format!("the law trips: {} ({})", peak.scenario, peak.plant));
    }
    let facts = check_facts(&found, tracked);
    let json = check_json(&found, tracked);
    output::save(&call.out, format!("{json}\n").as_bytes())?;
    output::warn(warnings);
    if call.show.json {
        output::line(&json.to_string());
    } else {
        output::facts(&facts);
        if let Some(worst) = found.peaks.first() {
            output::line(&format!("worst peak: {} ({})", worst.scenario, worst.plant));
        }
        if let Some(certificate) = &found.certificate {
            output::line(&certificate.statement);
        }
        output::line(&format!("findings: {}", call.out.display()));
    }
    if let Some(path) = output::page_path(&call.show, &call.out) {
        let page = check_page(call, model, controller, frame, &found, &facts, warnings)?;
        output::save_page(&page, &path, call.show.json)?;
    }
    if unstable {
        return Err(Failure::call(advised()?).about(path_of(call)));
    }
    Ok(())
}

fn check_facts(found: &Check, tracked: Option<[f64; 5]>) -> Vec<(String, String)> {
    let mut facts = margin_facts(&found.assessment);
    let or_none = |value: Option<f64>, scale: f64, unit: &str| {
        value.map_or("none: unstable as it is".to_owned(), |value| four_digits(value * scale, unit))
    };
    facts.push(("largest stable delay".to_owned(), or_none(found.largest_delay_s, 1e6, "us")));
    let (words, rate_hz) = match found.lowest_rate {
        Some(LowestRate::AtMost(hz)) => ("lowest stable rate, at most", Some(hz)),
        Some(LowestRate::Edge(hz)) => ("lowest stable rate", Some(hz)),
        None => ("lowest stable rate", None),
    };
    facts.push((words.to_owned(), or_none(rate_hz, 1.0, "Hz")));
    if let Some(worst) = found.peaks.first() {
        facts.push(("worst peak".to_owned(), four_digits(worst.peak_m * 1e6, "um")));
    }
    if let Some(certificate) = &found.certificate {
        let word = if certificate.is_certified { "certified" } else { "not certified" };
        facts.push(("global stability".to_owned(), word.to_owned()));
    }
    for (hz, percent) in SINES_HZ.iter().zip(tracked.iter().flatten()) {
        facts.push((format!("tracking error, {hz} Hz"), four_digits(*percent, "%")));
    }
    facts
}

fn check_json(found: &Check, tracked: Option<[f64; 5]>) -> serde_json::Value {
    let peaks = found.peaks.iter().map(|peak| {
        serde_json::json!({
            "scenario": peak.scenario, "plant": peak.plant, "peak_um": peak.peak_m * 1e6, "asked_um": peak.asked_m * 1e6,
            "peak_V": peak.peak_v, "tripped": peak.tripped,
        })
    });
    serde_json::json!({
        "schema": "hysteron-design-check-1",
        "verdict": found.assessment.to_string(),
        "gain_margin_dB": found.assessment.gain_margin_db.value,
        "phase_margin_deg": found.assessment.phase_margin_deg.value,
        "delay_margin_us": found.assessment.delay_margin_s.value * 1e6,
        "largest_stable_delay_us": found.largest_delay_s.map(|s| s * 1e6),
        "lowest_stable_rate_hz": found.lowest_rate.map(|(LowestRate::Edge(hz) | LowestRate::AtMost(hz))| hz),
        "is_lowest_rate_found": matches!(found.lowest_rate, Some(LowestRate::Edge(_))),
        "certified": found.certificate.as_ref().map(|c| c.is_certified),
        "certificate": found.certificate.as_ref().map(|c| c.statement.clone()),
        "peaks": peaks.collect::<Vec<_>>(),
        "tracking_rms_percent": tracked.map(|errors| SINES_HZ.iter().zip(errors).map(|(hz, e)| [*hz, e]).collect::<Vec<_>>()),
    })
}

fn check_page(
    call: &DesignCall,
    model: &Model,
    controller: &Controller,
    frame: &Frame<'_>,
    found: &Check,
    facts: &[(String, String)],
    warnings: &[String],
) -> Result<gap_diagnosis::page::Page, Failure> {
    let regions = worst_regions(&frame.chain.linear_regions()?, &found.assessment);
    let peaks = found.peaks.iter().map(|peak| {
        vec![
            peak.scenario.clone(),
            peak.plant.to_owned(),
            four_digits(peak.peak_m * 1e6, "µm"),
            four_digits(peak.peak_v, "V"),
            if peak.tripped { "trips".into() } else { "–".into() },
        ]
    });
    let peaks = TableView {
        caption: "Peaks, the worst first".into(),
        header: vec!["reference", "plant", "displacement", "command", "guard"],
        rows: peaks.collect(),
    };
    let mut sections = vec![(
        "Margins".to_owned(),
        "Each region is a set of hysterons outside their dead zones; margins say nothing on switching between them."
            .to_owned(),
        vec![margin_table(&found.assessment)],
    )];
    if let Some(certificate) = &found.certificate {
        sections.push(("Global stability".to_owned(), certificate.statement.clone(), Vec::new()));
    }
    let text = "The largest displacement with the controller's own clamp, shaping and limits, on the plant as stated and at the corners of its \
                uncertainty.";
    sections.push(("Worst peak".to_owned(), text.to_owned(), vec![peaks]));
    let (hz, bode) = bode(frame, &regions)?;
    let locus = locus(frame, None, &regions)?;
    Ok(design_page(&DesignView {
        title: "Controller check",
        subtitle: &format!(
            "{} on {}, {} Hz, drive {} us after the sample",
            controller.name, model.name, call.rate, call.delay_us
        ),
        headline: &format!("{}.", found.assessment),
        facts,
        warnings,
        sections: &sections,
        locus: &locus,
        frequency_hz: &hz,
        bode: &bode,
        step: [&[], &[], &[]],
        step_reduced_um: &[],
        provenance: &output::provenance(None),
    }))
}
