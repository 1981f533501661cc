//! The page of `simulate`: what was asked, what the plant did, what the drive had to give.

use super::{Axis, Chart, Ink, Loop, Page, Panel, Series};

/// What a simulation page shows. All slices have the length of `time_s`.
#[derive(Debug, Clone, Copy)]
pub struct SimulationView<'a> {
    /// Heading.
    pub title: &'a str,
    /// Which plant, controller and signal.
    pub subtitle: &'a str,
    /// The verdict in one sentence; empty for none.
    pub headline: &'a str,
    /// Sample times.
    pub time_s: &'a [f64],
    /// What was asked for; `None` in open loop.
    pub reference_um: Option<&'a [f64]>,
    /// What the plant did.
    pub displacement_um: &'a [f64],
    /// Command to the amplifier.
    pub command_v: &'a [f64],
    /// Reference minus displacement, if the caller defines it otherwise (e.g. after the delay); computed when `None`.
    pub error_um: Option<&'a [f64]>,
    /// Label and value with unit, in the order of importance.
    pub metrics: &'a [(String, String)],
    /// What the reader must know first.
    pub warnings: &'a [String],
    /// Command line, seed, versions.
    pub provenance: &'a [String],
}

/// Lays out a [`SimulationView`].
pub fn simulation_page(view: &SimulationView<'_>) -> Page {
    let mut page = Page::new(view.title);
    page.subtitle(view.subtitle).headline(view.headline).facts(view.metrics).provenance(view.provenance);
    for warning in view.warnings {
        page.warning(warning);
    }

    let micrometres = || Axis::new("displacement", "µm");
    let displacement = Series { name: "displacement", ink: Ink::Model, values: view.displacement_um };
    let mut panels = Vec::new();
    let difference_um: Vec<f64>;
    if let Some(reference_um) = view.reference_um {
        let reference = Series { name: "reference", ink: Ink::Reference, values: reference_um };
        let error_um = match view.error_um {
            Some(error_um) => error_um,
            None => {
                difference_um =
                    reference_um.iter().zip(view.displacement_um).map(|(asked, done)| asked - done).collect();
                &difference_um
            }
        };
        panels.push(Panel {
            title: "Reference and displacement",
            caption: "The displacement should lie on the dashed reference; look for overshoot after steps and for lag on slopes.",
            y: micrometres(),
            series: vec![displacement, reference],
        });
        panels.push(Panel {
            title: "Error",
            caption: "Reference minus displacement: it should return to zero after each change and stay there.",
            y: Axis::new("error", "µm"),
            series: vec![Series { name: "error", ink: Ink::Error, values: error_um }],
        });
    } else {
        panels.push(Panel {
            title: "Displacement",
            caption: "Open loop: the displacement follows the command through the hysteresis; look for drift and for where it does not return.",
            y: micrometres(),
            series: vec![displacement],
        });
    }
    panels.push(Panel {
        title: "Drive",
        caption: "Command to the amplifier: flat tops mean that a limit was reached.",
        y: Axis::new("command", "V"),
        series: vec![Series { name: "command", ink: Ink::Drive, values: view.command_v }],
    });
    page.charts(Chart::linked_over_time("time", view.time_s, &panels));

    let path = |name, x| Loop { name, ink: Ink::Model, x, y: view.displacement_um };
    if let Some(reference_um) = view.reference_um {
        page.chart(Chart::loops(
            "Displacement over reference",
            "A straight line of slope one is perfect following; a loop is lag or hysteresis that the controller did not remove.",
            Axis::new("reference", "µm"),
            micrometres(),
            &[path("displacement", reference_um)],
        ));
    }
    page.chart(Chart::loops(
        "Displacement over command",
        "The hysteresis of the actuator itself: the width of the loop is what the same voltage leaves undecided.",
        Axis::new("command", "V"),
        micrometres(),
        &[path("displacement", view.command_v)],
    ));
    page
}
