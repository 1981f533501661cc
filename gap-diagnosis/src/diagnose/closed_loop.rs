//! What the gap means for a controller: the tracking error that nominal and diagnosed plant predict for the same loop.

use super::DiagnoseError;
use plant_sim::controller::Controller;
use plant_sim::experiment::{Program, Setup, closed_loop_inverse, sampled_loop};
use plant_sim::log::Log;
use plant_sim::margins::{Assessment, Verdict, assess};
use plant_sim::metrics::{Task, loop_metrics};
use plant_sim::model::Model;
use plant_sim::replay::Start;
use plant_sim::spec::{Spec, SpecError, Unit};
use serde::Serialize;

/// A loop to predict.
#[derive(Clone, Debug)]
pub struct Loop {
    /// The controller.
    pub controller: Controller,
    /// What it shall follow: a SPEC of displacements.
    pub reference: String,
}

/// The error of one loop around two plants.
#[derive(Clone, Debug, Serialize)]
pub struct ClosedLoop {
    /// Name of the controller.
    pub controller: String,
    /// What it follows, a SPEC.
    pub reference: String,
    /// Samples per second, those of the first log.
    pub rate_hz: f64,
    /// Rms of reference minus displacement that the nominal plant predicts.
    pub nominal_error_um: f64,
    /// The same of the diagnosed plant.
    pub augmented_error_um: f64,
}

/// Seconds of a reference that states none.
const USUAL_S: f64 = 1.0;

impl Loop {
    /// The loop's program at the rate of `log`.
    ///
    /// # Errors
    /// If controller or reference can't run there.
    fn program(&self, log: &Log) -> Result<Program, DiagnoseError> {
        let rate_hz = log.dt_s.recip();
        let spec: Spec = self.reference.parse().map_err(|e: SpecError| of_spec(&e))?;
        let program = Program::new(&spec, rate_hz).map_err(|e| of_spec(&e))?;
        if program.unit() == Some(Unit::Volt) {
            return Err(refused(&"the reference is a displacement: give its amplitudes in um"));
        }
        Ok(program)
    }
}

fn refused(reason: &dyn std::fmt::Display) -> DiagnoseError {
    DiagnoseError::ClosedLoop { reason: reason.to_string(), in_file: false }
}

fn of_spec(error: &SpecError) -> DiagnoseError {
    DiagnoseError::ClosedLoop { reason: error.to_string(), in_file: error.in_file }
}

/// Runs `wanted` around both plants, at the rate and with the latency of `log`; beside it what makes an error none of tracking.
///
/// # Errors
/// If controller or reference can't run at that rate.
pub(super) fn predict(
    wanted: &Loop,
    nominal: &Model,
    augmented: &Model,
    log: &Log,
) -> Result<(ClosedLoop, Vec<String>), DiagnoseError> {
    let rate_hz = log.dt_s.recip();
    let program = wanted.program(log)?;
    let samples = program.samples().unwrap_or((USUAL_S * rate_hz) as usize);
    let settings = wanted.controller.settings(rate_hz);
    let inverse = wanted.controller.inverse(rate_hz, log.meta.latency_s).map_err(|e| refused(&e))?;
    let mut warnings = Vec::new();
    let mut error_um = |model: &Model, which: &str| {
        let chain = model.chain();
        let law = sampled_loop(&settings, rate_hz, log.meta.latency_s, &chain);
        // Of a plant without regions nothing can be said but what its run shows.
        let assessment = chain.linear_regions().and_then(|regions| assess(&regions, &law));
        if let Ok(Assessment { verdict: verdict @ Verdict::Unstable { .. }, .. }) = assessment {
            warnings.push(format!(
                "the loop around the {which} plant is {verdict}: its tracking error is what the limits leave of it"
            ));
        }
        let start = Start::relaxed(&chain);
        let setup = Setup { chain: &chain, start: &start, rate_hz, samples, latency_s: log.meta.latency_s, seed: 0 };
        let recording =
            closed_loop_inverse(&setup, &settings, inverse.as_ref(), &program, &|_| {}).map_err(|e| refused(&e))?;
        if recording.limited_by.iter().any(|limits| limits.is_safe_state()) {
            warnings.push(format!(
                "the loop around the {which} plant trips: its tracking error is mostly that of a drive at 0 V"
            ));
        }
        let (reference_m, displacement_m) = (&recording.reference_m, &recording.displacement_m);
        let metrics = loop_metrics(Task::Other, recording.dt_s, Some(reference_m), displacement_m);
        metrics.rms_error_um.ok_or_else(|| refused(&"the reference is shorter than a sample"))
    };
    let closed_loop = ClosedLoop {
        controller: wanted.controller.name.clone(),
        reference: wanted.reference.clone(),
        rate_hz,
        nominal_error_um: error_um(nominal, "nominal")?,
        augmented_error_um: error_um(augmented, "diagnosed")?,
    };
    Ok((closed_loop, warnings))
}
