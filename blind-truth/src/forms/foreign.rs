//! What no registry entry explains. One form each: the right answer is `unknown`, in every split.

use super::{Planted, log_uniform, sign};
use crate::effects::ForeignKind;
use crate::sensor::{Follow, Measure};
use crate::structure::Force;
use rand::RngExt;
use rand_pcg::Pcg64;

pub(super) fn draw(kind: ForeignKind, rng: &mut Pcg64) -> Planted {
    match kind {
        ForeignKind::CrossAxisCoupling => {
            let (mean_dwell_s, tau_s) = (log_uniform(rng, 0.02, 0.15), log_uniform(rng, 1e-3, 2e-2));
            Planted::new("rms_m", (2e-8, 1e-5), move |a, bench| {
                bench.measures.push(Measure::CrossAxis { m: a, mean_dwell_s, tau_s });
            })
            .with("mean_dwell_s", mean_dwell_s)
            .with("tau_s", tau_s)
        }
        ForeignKind::PreloadGap => {
            // 60 V push with 2.8 N; a fast step back pulls as hard, a slow one with the preload spring's share only.
            let spring_share = rng.random_range(0.15..0.5);
            Planted::new("opening_share", (0.02, 0.95), move |a, bench| {
                bench.forces.push(Force::PreloadGap {
                    preload_n: 4.0 * (1.0 - a),
                    n_per_m: (1.0 - spring_share) * bench.stiffness_n_per_m,
                });
            })
            .with("preload_spring_share", spring_share)
        }
        ForeignKind::SelfHeatingHysteresis => {
            let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.05, 0.5));
            Planted::new("widening_at_60V_100Hz", (0.01, 0.9), move |a, bench| bench.heated = Some((sign * a, tau_s)))
                .with("sign", sign)
                .with("tau_s", tau_s)
        }
        ForeignKind::ControlClipping => Planted::new("inverse_change_limit_per_V", (0.01, 4.0), |a, bench| {
            bench.timing.change_limit_v = Some(1.0 / a);
        }),
        ForeignKind::MultiplicativeNoise => Planted::new("share", (1e-4, 0.05), |a, bench| {
            bench.measures.push(Measure::Multiplicative { share: a });
        })
        .band(3.0, 15.0),
        ForeignKind::ThermalStiffness => {
            let (sign, tau_s) = (sign(rng), log_uniform(rng, 0.3, 3.0));
            Planted::new("stiffness_share", (0.001, 0.2), move |a, bench| {
                bench.forces.push(Force::WarmingSpring { n_per_m: sign * a * bench.stiffness_n_per_m, tau_s });
            })
            .with("sign", sign)
            .with("tau_s", tau_s)
        }
        ForeignKind::ParametricResonance => {
            let hz = log_uniform(rng, 30.0, 1600.0);
            Planted::new("stiffness_share", (0.001, 0.2), move |a, bench| {
                bench.forces.push(Force::Pumped { n_per_m: a * bench.stiffness_n_per_m, hz });
            })
            .with("hz", hz)
        }
        ForeignKind::SensorStiction => Planted::new("break_m", (3e-8, 8e-6), |a, bench| {
            bench.follows.push(Follow::Stiction { break_m: a });
        }),
    }
}
