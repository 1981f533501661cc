//! Initial state: what happened before the log.

use super::{About, Form, Kind};

effect!(InitialState, "initial_state", Actuator);

const ABOUT: About = About {
    title: "initial state",
    what: "The log starts elsewhere than assumed: a hysteretic plant remembers what was done before.",
    equation: "q(0), q'(0), v_i(0) as fitted and not as assumed; q: displacement, v_i: voltage of hysteron i. At rest \
               any |v_i| <= d_i/2 is an equilibrium, d_i: width of the dead zone; where the plant has oscillators, how far each is \
               from rest and its speed as well",
    source: "equation (2.9) of the thesis: the equilibria of a hysteretic plant form a continuum",
    typical: "a tenth of the stroke",
    installs: "nothing: the start of each log is fitted instead of assumed",
    signature: "the residual is largest at the start and dies out, or stays constant until the drive first turns \
                beyond where it was",
    rivals: &["creep", "sensor_offset", "sensor_drift"],
    experiment: "a decaying sine before the log (demagnetising) erases what was before; an offset stays",
    spec: "minor-loops:60V@2Hz+zero@2s+sine:40V@1Hz,for=4s",
};

const FORMS: &[Form] =
    &[Form { name: "start", kind: Kind::Start, parameters: |_| Vec::new(), install: |_, _| {}, mirrors: None }];
