//! The mode machine of a board: when the loop may run, and how it ends.
//!
//! ```text
//!                 arm                 run
//!      +------+ -------> +-------+ -------> +---------+
//!      | Idle |          | Armed |          | Running |
//!      +------+ <------- +-------+          +---------+
//!        ^  ^     stop       |                |     |
//!        |  |                |           stop |     |
//!        |  |  ramp done +----------+         |     |
//!        |  +------------| Stopping |<--------+     |
//!        |               +----------+               |
//!        |                   | trip(code), or the   |
//!        |                   v law's safe state     v
//!        |  clear_fault  +-------------------------------+
//!        +---------------| Fault (entered from any mode) |
//!          (0 V reached) +-------------------------------+
//! ```
//!
//! Starting takes two actions, arm and run, so that a single wrong byte or click can't move the plant. Every way out of
//! `Running` is a jerk-limited ramp to 0 V within the slew limit, open loop. An action that the diagram does not show is refused and changes nothing.

use crate::fault::FaultCode;
use crate::generator::{Generator, GeneratorState};
use crate::guard::GuardState;
use crate::law::{Law, LawState, Output};
use crate::limits::Limits;
use crate::ramp::Ramp;
use core::fmt;

/// What the board is doing, with the data that only this mode has.
// `u8`, so that the mode is a byte of its own and not hidden in another field's unused values, which cost instructions to tell apart.
#[derive(Clone, Copy, Debug)]
#[repr(u8)]
pub enum Mode {
    /// 0 V, the sensor is not looked at. Entered at start, from `Armed` by stop, from `Stopping` when its ramp is done, from
    /// `Fault` by clear_fault. Left by arm.
    Idle,
    /// 0 V, the guard watches the sensor. Entered from `Idle` by arm. Left by run, by stop (to `Idle`), or to `Fault`.
    Armed {
        /// The guard's memory.
        guard: GuardState,
    },
    /// The law (or an open-loop command) drives. Entered from `Armed` by run, at rest. Left by stop (to `Stopping`), or to `Fault`.
    Running {
        /// The law's memory.
        law: LawState,
        /// Where the reference generator stands.
        generator: GeneratorState,
        /// Its sample for the next tick, where that was made ahead of it ([`Controller::prepare`]).
        ahead: Option<f32>,
    },
    /// On the way to 0 V because of stop. Left to `Idle` when there, or to `Fault` (which continues the ramp).
    Stopping {
        /// The way.
        ramp: Ramp,
    },
    /// On the way to 0 V, then at 0 V, because of a fault. The first code stays until clear_fault, which is allowed once
    /// 0 V is reached.
    Fault {
        /// Why.
        code: FaultCode,
        /// The way.
        ramp: Ramp,
    },
}

/// The name of a mode, without its data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[allow(missing_docs, reason = "the variants of `Mode` carry the meaning")]
pub enum ModeName {
    Idle = 0,
    Armed = 1,
    Running = 2,
    Stopping = 3,
    Fault = 4,
}

impl ModeName {
    /// The word in records and messages.
    pub const fn word(self) -> &'static str {
        match self {
            ModeName::Idle => "idle",
            ModeName::Armed => "armed",
            ModeName::Running => "running",
            ModeName::Stopping => "stopping",
            ModeName::Fault => "fault",
        }
    }
}

/// What someone wants the machine to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// `Idle` to `Armed`.
    Arm,
    /// `Armed` to `Running`.
    Run,
    /// `Armed` to `Idle`, `Running` to `Stopping`.
    Stop,
    /// `Fault` to `Idle`, once 0 V is reached.
    ClearFault,
}

/// An action that the present mode does not allow. Nothing has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// What was wanted.
    pub action: Action,
    /// The mode it was wanted in.
    pub mode: ModeName,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let action = match self.action {
            Action::Arm => "arm",
            Action::Run => "run",
            Action::Stop => "stop",
            // The mode allows it, only not yet.
            Action::ClearFault if self.mode == ModeName::Fault => {
                return f.write_str("clear_fault is refused until the drive has reached 0 V");
            }
            Action::ClearFault => "clear_fault",
        };
        write!(f, "{action} is refused in mode {}", self.mode.word())
    }
}

impl core::error::Error for Refused {}

/// What the plant is to do in this sample, while running.
#[derive(Clone, Copy, Debug)]
pub enum Command<'a> {
    /// Closed loop, to this reference.
    Reference {
        /// Metres.
        reference_m: f32,
    },
    /// Open loop, this drive (limited and watched all the same).
    Drive {
        /// Volts at the actuator.
        drive_v: f32,
    },
    /// Closed loop, to the generator's next sample in metres.
    GeneratedReference(Generator<'a>),
    /// Open loop, the generator's next sample in volts.
    GeneratedDrive(Generator<'a>),
}

impl Command<'_> {
    /// Whether the law follows a reference; else the drive is what is commanded.
    #[inline(always)]
    pub const fn is_closed_loop(&self) -> bool {
        matches!(self, Command::Reference { .. } | Command::GeneratedReference(_))
    }
}

/// What comes in with one sample.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// What to do; read only while running, and only then does a generator advance.
    pub command: Command<'a>,
    /// The displacement sensor.
    pub measured_m: f32,
}

/// The law with its mode machine: the whole of a board's control, one [`Controller::tick`] per sample.
#[derive(Clone, Copy, Debug)]
pub struct Controller {
    law: Law,
    mode: Mode,
}

impl Controller {
    /// Idle, at 0 V.
    pub const fn new(law: Law) -> Controller {
        Controller { law, mode: Mode::Idle }
    }

    /// In fault from the start, at 0 V: after a watchdog or brown-out reset.
    pub const fn in_fault(law: Law, code: FaultCode) -> Controller {
        Controller { law, mode: Mode::Fault { code, ramp: Ramp::done() } }
    }

    /// The law in use.
    pub fn law(&self) -> &Law {
        &self.law
    }

    /// The present mode with its data.
    pub fn mode(&self) -> &Mode {
        &self.mode
    }

    /// The present mode's name.
    pub fn mode_name(&self) -> ModeName {
        match self.mode {
            Mode::Idle => ModeName::Idle,
            Mode::Armed { .. } => ModeName::Armed,
            Mode::Running { .. } => ModeName::Running,
            Mode::Stopping { .. } => ModeName::Stopping,
            Mode::Fault { .. } => ModeName::Fault,
        }
    }

    /// The latched fault, if there is one.
    pub fn fault(&self) -> Option<FaultCode> {
        match self.mode {
            Mode::Fault { code, .. } => Some(code),
            _ => None,
        }
    }

    /// The last drive.
    pub fn drive_v(&self) -> f32 {
        match &self.mode {
            Mode::Idle | Mode::Armed { .. } => 0.0,
            Mode::Running { law, .. } => law.drive_v(),
            Mode::Stopping { ramp } | Mode::Fault { ramp, .. } => ramp.drive_v(),
        }
    }

    /// First of the two actions that start the loop.
    ///
    /// # Errors
    ///
    /// [`Refused`] unless idle.
    pub fn arm(&mut self) -> Result<(), Refused> {
        match self.mode {
            Mode::Idle => {
                self.mode = Mode::Armed { guard: GuardState::default() };
                Ok(())
            }
            _ => self.refuse(Action::Arm),
        }
    }

    /// Second of the two actions: the loop runs from the next tick on, from rest, with the generator at its
    /// beginning and under the guard that has watched since arm.
    ///
    /// # Errors
    ///
    /// [`Refused`] unless armed.
    pub fn run(&mut self) -> Result<(), Refused> {
        match self.mode {
            Mode::Armed { guard } => {
                let (law, generator) = (LawState::watched(guard), GeneratorState::default());
                self.mode = Mode::Running { law, generator, ahead: None };
                Ok(())
            }
            _ => self.refuse(Action::Run),
        }
    }

    /// Ends the loop by the ramp to 0 V, or disarms.
    ///
    /// # Errors
    ///
    /// [`Refused`] unless armed or running.
    pub fn stop(&mut self) -> Result<(), Refused> {
        match &self.mode {
            Mode::Armed { .. } => {
                self.mode = Mode::Idle;
                Ok(())
            }
            Mode::Running { law, .. } => {
                self.mode = Mode::Stopping { ramp: Ramp::to_zero(law.drive_v(), self.law.slew_v()) };
                Ok(())
            }
            _ => self.refuse(Action::Stop),
        }
    }

    /// Leaves the fault mode.
    ///
    /// # Errors
    ///
    /// [`Refused`] unless in fault and at 0 V.
    pub fn clear_fault(&mut self) -> Result<(), Refused> {
        match &self.mode {
            Mode::Fault { ramp, .. } if ramp.is_done() => {
                self.mode = Mode::Idle;
                Ok(())
            }
            _ => self.refuse(Action::ClearFault),
        }
    }

    /// A fault seen outside of the law: link loss, overrun, sensor at its rail. From any mode; a fault already latched stays.
    pub fn trip(&mut self, code: FaultCode) {
        let ramp = match &self.mode {
            Mode::Fault { .. } => return,
            Mode::Idle | Mode::Armed { .. } => Ramp::done(),
            Mode::Running { law, .. } => Ramp::to_zero(law.drive_v(), self.law.slew_v()),
            Mode::Stopping { ramp } => *ramp,
        };
        self.mode = Mode::Fault { code, ramp };
    }

    /// The last tick's drive came too late for the DAC, which keeps `held_v`, the drive before it. From there go the next sample's slew limit and
    /// the ramp of a trip; a ramp under way repeats its step. What was measured and generated in that tick stays.
    pub fn not_latched(&mut self, held_v: f32) {
        match &mut self.mode {
            Mode::Idle | Mode::Armed { .. } => {}
            Mode::Running { law, .. } => law.hold(held_v),
            Mode::Stopping { ramp } | Mode::Fault { ramp, .. } => ramp.step_back(),
        }
    }

    /// Puts another law in force from the next tick on, without a bump of the drive; a ramp under way keeps its own pace.
    pub fn exchange_law(&mut self, law: Law) {
        if let Mode::Running { law: state, .. } = &mut self.mode {
            law.take_over(&self.law, state);
        }
        self.law = law;
    }

    /// The next ticks' command is `next`, not `last` any more. A board calls this between two samples, whenever it takes another command: a loop
    /// that ran open and is closed now begins where the plant is and with the drive in force ([`Law::close`]), not where it was when it last was
    /// closed. An open loop needs no preparation: its drive goes to what is commanded at the slew rate, as at its start.
    pub fn change_command(&mut self, last: &Command<'_>, next: &Command<'_>) {
        if let Mode::Running { law: state, .. } = &mut self.mode
            && next.is_closed_loop()
            && !last.is_closed_loop()
        {
            self.law.close(state);
        }
    }

    /// One sample. Can't fail; same deadline as [`Law::step`].
    // Always, because a board's interrupt is its one caller that counts instructions: a call would carry input and output over memory.
    #[inline(always)]
    pub fn tick(&mut self, input: &Input<'_>) -> Output {
        match &mut self.mode {
            Mode::Idle => at_rest(Limits::NONE),
            Mode::Armed { guard } => {
                let latched = self.law.guard().watch(guard, input.measured_m);
                if !latched.is_empty() {
                    self.trip(FaultCode::of_safe_state(latched));
                }
                at_rest(latched)
            }
            Mode::Running { law, generator, ahead } => {
                let is_closed = input.command.is_closed_loop();
                let wish = match input.command {
                    Command::Reference { reference_m: wish } | Command::Drive { drive_v: wish } => wish,
                    Command::GeneratedReference(source) | Command::GeneratedDrive(source) => match ahead.take() {
                        Some(wish) => wish,
                        None => source.next(generator),
                    },
                };
                let result = if is_closed {
                    self.law.try_step(law, wish, input.measured_m)
                } else {
                    self.law.try_step_open(law, wish, input.measured_m)
                };
                match result {
                    Ok(output) => output,
                    Err(latched) => {
                        let reference_m = law.reference_m();
                        let (drive_v, limited_by) = self.give_up(latched);
                        Output { drive_v, reference_m, limited_by }
                    }
                }
            }
            Mode::Stopping { ramp } => {
                let output = descending(ramp, Limits::NONE);
                if ramp.is_done() {
                    self.mode = Mode::Idle;
                }
                output
            }
            Mode::Fault { code, ramp } => descending(ramp, code.limits()),
        }
    }

    /// The law has given up in this sample. Its own way to 0 V is not smooth; the ramp starts from the drive before, in this same sample.
    #[cold]
    #[inline(never)]
    fn give_up(&mut self, latched: Limits) -> (f32, Limits) {
        self.trip(FaultCode::of_safe_state(latched));
        match &mut self.mode {
            Mode::Fault { code, ramp } => (ramp.step(), code.limits() | Limits::RAMP),
            _ => (0.0, latched),
        }
    }

    /// Makes the sample of a generator that the next tick with this `command` will want: nothing in it depends on the measurement. A board
    /// calls this between two samples, so that the tick is the shorter. Changes no result.
    pub fn prepare(&mut self, command: &Command<'_>) {
        if let Mode::Running { generator, ahead, .. } = &mut self.mode
            && ahead.is_none()
            && let Command::GeneratedReference(source) | Command::GeneratedDrive(source) = command
        {
            *ahead = Some(source.next(generator));
        }
    }

    fn refuse(&self, action: Action) -> Result<(), Refused> {
        Err(Refused { action, mode: self.mode_name() })
    }
}

/// 0 V.
fn at_rest(limited_by: Limits) -> Output {
    Output { drive_v: 0.0, reference_m: 0.0, limited_by }
}

/// One sample of a ramp, marked as such while it moves.
fn descending(ramp: &mut Ramp, limits: Limits) -> Output {
    if ramp.is_done() {
        return at_rest(limits);
    }
    Output { drive_v: ramp.step(), reference_m: 0.0, limited_by: limits | Limits::RAMP }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generator::Segment;
    use crate::settings::Settings;
    use std::string::ToString;

    fn law() -> Law {
        let settings = Settings {
            rate_hz: 20e3,
            kp_v_per_m: 8.5811e5,
            ki_v_per_m_s: 9.6755e8,
            feedforward_v_per_m: 530_737.0,
            drive_min_v: -90.0,
            drive_max_v: 90.0,
            slew_v_per_s: 2e5,
            reference_max_m: 100e-6,
            reference_rate_m_per_s: f32::INFINITY,
            reference_acceleration_m_per_s2: f32::INFINITY,
            trip_m: 120e-6,
            stop_time_s: 0.0,
        };
        Law::try_build(&settings).expect("sound settings")
    }

    fn hold(measured_m: f32) -> Input<'static> {
        Input { command: Command::Reference { reference_m: 50e-6 }, measured_m }
    }

    /// A controller in each mode, the ramps under way.
    fn in_mode(name: ModeName) -> Controller {
        let mut controller = Controller::new(law());
        if name == ModeName::Idle {
            return controller;
        }
        controller.arm().expect("idle");
        if name == ModeName::Armed {
            return controller;
        }
        controller.run().expect("armed");
        for _ in 0..20 {
            controller.tick(&hold(0.0));
        }
        match name {
            ModeName::Stopping => controller.stop().expect("running"),
            ModeName::Fault => controller.trip(FaultCode::LinkLoss),
            _ => {}
        }
        assert!(controller.drive_v() > 50.0);
        controller
    }

    const MODES: [ModeName; 5] =
        [ModeName::Idle, ModeName::Armed, ModeName::Running, ModeName::Stopping, ModeName::Fault];

    #[test]
    fn the_whole_table_of_actions() {
        use ModeName::*;
        type Act = fn(&mut Controller) -> Result<(), Refused>;
        let actions: [(Action, Act); 4] = [
            (Action::Arm, Controller::arm),
            (Action::Run, Controller::run),
            (Action::Stop, Controller::stop),
            (Action::ClearFault, Controller::clear_fault),
        ];
        let allowed = [
            (Action::Arm, Idle, Armed),
            (Action::Run, Armed, Running),
            (Action::Stop, Armed, Idle),
            (Action::Stop, Running, Stopping),
        ];
        for mode in MODES {
            for (action, act) in actions {
                let mut controller = in_mode(mode);
                let before_v = controller.drive_v();
                let result = act(&mut controller);
                match allowed.iter().find(|(a, from, _)| *a == action && *from == mode) {
                    Some((_, _, to)) => {
                        assert_eq!(result, Ok(()));
                        assert_eq!(controller.mode_name(), *to);
                    }
                    None => {
                        assert_eq!(result, Err(Refused { action, mode }));
                        assert_eq!(controller.mode_name(), mode);
                        let text = Refused { action, mode }.to_string();
                        assert!(text.contains("refused"), "{text}");
                    }
                }
                assert_eq!(controller.drive_v(), before_v);
            }
        }
    }

    #[test]
    fn every_mode_can_fault_and_a_fault_is_cleared_only_at_zero_volts() {
        for mode in MODES {
            let mut controller = in_mode(mode);
            let before_v = controller.drive_v();
            controller.trip(FaultCode::Overrun);
            let expected = if mode == ModeName::Fault { FaultCode::LinkLoss } else { FaultCode::Overrun };
            assert_eq!(controller.fault(), Some(expected));
            assert_eq!(controller.drive_v(), before_v);
            let mut last_v = before_v;
            while controller.drive_v() != 0.0 {
                assert!(controller.clear_fault().is_err());
                // The sensor is not believed any more.
                let output = controller.tick(&hold(f32::NAN));
                // Slew 10 V per sample; the ramp's own rounding is 2e-6 of its start.
                assert!((output.drive_v - last_v).abs() <= 10.0 + 2e-6 * 90.0);
                assert!(output.limited_by.contains(Limits::RAMP));
                last_v = output.drive_v;
            }
            assert_eq!(controller.clear_fault(), Ok(()));
            assert_eq!(controller.mode_name(), ModeName::Idle);
        }
    }

    #[test]
    fn a_trip_acts_in_its_own_sample() {
        for (bad_m, code, limits) in [
            (f32::NAN, FaultCode::NotANumber, Limits::NOT_A_NUMBER),
            (f32::INFINITY, FaultCode::NotANumber, Limits::NOT_A_NUMBER),
            (121e-6, FaultCode::DisplacementTrip, Limits::TRIP),
        ] {
            let mut controller = in_mode(ModeName::Running);
            let before_v = controller.drive_v();
            let output = controller.tick(&hold(bad_m));
            assert!(output.drive_v < before_v && output.drive_v > before_v - 10.0);
            assert!(output.limited_by.contains(limits | Limits::RAMP));
            assert_eq!(controller.fault(), Some(code));

            let mut armed = in_mode(ModeName::Armed);
            assert_eq!(armed.tick(&hold(bad_m)).drive_v, 0.0);
            assert_eq!(armed.fault(), Some(code));
        }
    }

    #[test]
    fn stopping_ends_in_idle_at_zero_volts() {
        let mut controller = in_mode(ModeName::Stopping);
        let mut samples = 0;
        while controller.mode_name() == ModeName::Stopping {
            controller.tick(&hold(0.0));
            samples += 1;
            // 90 V at 10 V per sample: at most ceil(1.875 * 9) + 1 samples.
            assert!(samples <= 18);
        }
        assert_eq!(controller.mode_name(), ModeName::Idle);
        assert_eq!(controller.tick(&hold(0.0)).drive_v, 0.0);
    }

    #[test]
    fn a_fault_while_stopping_continues_the_ramp() {
        let mut stopped = in_mode(ModeName::Stopping);
        let mut faulted = stopped;
        faulted.trip(FaultCode::LinkLoss);
        for _ in 0..30 {
            assert_eq!(stopped.tick(&hold(0.0)).drive_v, faulted.tick(&hold(0.0)).drive_v);
        }
    }

    #[test]
    fn preparing_changes_no_result() {
        let segments = [Segment::hold(1.0, 1).expect("sound"), Segment::ladder(5.0, 2, 2).expect("sound")];
        let generator = Generator::new(&segments);
        let input = Input { command: Command::GeneratedDrive(generator), measured_m: 0.0 };
        let play = |is_prepared: bool| {
            let mut controller = Controller::new(law());
            controller.arm().expect("idle");
            controller.run().expect("armed");
            [(); 12].map(|()| {
                if is_prepared {
                    controller.prepare(&input.command);
                    controller.prepare(&input.command);
                }
                controller.tick(&input).drive_v
            })
        };
        assert_eq!(play(true), play(false));
        assert_eq!(play(true)[..6], [1.0, 2.5, 2.5, 5.0, 5.0, 2.5]);
    }

    #[test]
    fn a_generator_advances_only_while_running() {
        let segments = [Segment::hold(1.0, 1).expect("sound"), Segment::hold(5.0, 1).expect("sound")];
        let generator = Generator::new(&segments);
        let input = Input { command: Command::GeneratedDrive(generator), measured_m: 0.0 };
        let mut controller = Controller::new(law());
        assert_eq!(controller.tick(&input).drive_v, 0.0);
        controller.arm().expect("idle");
        assert_eq!(controller.tick(&input).drive_v, 0.0);
        controller.run().expect("armed");
        assert_eq!(controller.tick(&input).drive_v, 1.0);
        assert_eq!(controller.tick(&input).drive_v, 5.0);
        let closed = Input { command: Command::GeneratedReference(generator), measured_m: 0.0 };
        // 5 m is clamped to 100 um; the drive moves by its slew, 10 V.
        let output = controller.tick(&closed);
        assert_eq!(output.reference_m, 100e-6);
        assert_eq!(output.drive_v, 15.0);
    }

    #[test]
    fn only_closing_an_open_loop_changes_what_the_law_remembers() {
        let generator = Generator::new(&[]);
        let drives = [Command::Drive { drive_v: 40.0 }, Command::GeneratedDrive(generator)];
        let references = [Command::Reference { reference_m: 70e-6 }, Command::GeneratedReference(generator)];
        let changes = |controller: &Controller, last, next| {
            let mut changed = *controller;
            changed.change_command(&last, &next);
            std::format!("{changed:?}") != std::format!("{controller:?}")
        };
        let mut unseen = Controller::new(law());
        unseen.arm().expect("idle");
        unseen.run().expect("armed");
        for drive in drives {
            for reference in references {
                for controller in MODES.map(in_mode) {
                    let is_running = controller.mode_name() == ModeName::Running;
                    assert_eq!(changes(&controller, drive, reference), is_running);
                }
                assert!(!changes(&unseen, drive, reference));
                for (last, next) in [(reference, drive), (drive, drives[0]), (reference, references[0])] {
                    assert!(!changes(&in_mode(ModeName::Running), last, next));
                }
            }
        }
    }

    fn open(drive_v: f32) -> Input<'static> {
        Input { command: Command::Drive { drive_v }, measured_m: 0.0 }
    }

    #[test]
    fn a_drive_that_was_not_latched_counts_for_no_slew() {
        for late in 1..5 {
            let mut controller = in_mode(ModeName::Running);
            let held_v = controller.drive_v();
            for _ in 0..late {
                controller.tick(&open(-90.0));
                controller.not_latched(held_v);
                assert_eq!(controller.drive_v(), held_v);
            }
            // Slew 10 V per sample, from what the DAC has; so does the ramp of a trip begin there.
            let mut tripped = controller;
            assert_eq!(controller.tick(&open(-90.0)).drive_v, held_v - 10.0);
            tripped.trip(FaultCode::Overrun);
            assert_eq!(tripped.drive_v(), held_v);
            assert!(tripped.tick(&open(-90.0)).drive_v >= held_v - 10.0);
        }
    }

    #[test]
    fn drives_that_were_not_latched_wind_nothing_up() {
        // The wish is beyond the slew limit all the time, so the integral stands still, as in a loop whose drive is stuck.
        let mut controller = Controller::new(law());
        controller.arm().expect("idle");
        controller.run().expect("armed");
        let integral_v = |controller: &Controller| match controller.mode() {
            Mode::Running { law, .. } => law.integral_v(),
            mode => panic!("{mode:?}"),
        };
        for _ in 0..100 {
            assert_eq!(controller.tick(&hold(0.0)).drive_v, 10.0);
            controller.not_latched(0.0);
            assert_eq!(integral_v(&controller), 0.0);
        }
        // Within the slew limit it grows until the wish is beyond it, and no more: Kp e + I <= 10 V and one increment.
        let near = Input { command: Command::Reference { reference_m: 5e-6 }, measured_m: 0.0 };
        for _ in 0..100 {
            controller.tick(&near);
            controller.not_latched(0.0);
        }
        let (most_v, increment_v) = (10.0 - (8.5811e5 + 530_737.0) * 5e-6, 9.6755e8 / 20e3 * 5e-6);
        let reached_v = integral_v(&controller);
        assert!(reached_v > most_v - increment_v && reached_v <= most_v, "{reached_v} of {most_v}");
    }

    #[test]
    fn a_ramp_repeats_what_was_not_latched() {
        for mode in [ModeName::Stopping, ModeName::Fault] {
            let mut controller = in_mode(mode);
            let mut held_v = controller.drive_v();
            while controller.drive_v() != 0.0 {
                let late = controller.tick(&hold(0.0));
                if controller.drive_v() == 0.0 {
                    break;
                }
                controller.not_latched(held_v);
                assert_eq!(controller.drive_v(), held_v);
                let repeated = controller.tick(&hold(0.0));
                assert_eq!(repeated, late);
                held_v = repeated.drive_v;
            }
            // Arrived, it stays.
            controller.not_latched(held_v);
            assert_eq!(controller.tick(&hold(0.0)).drive_v, 0.0);
        }
        // A law that gives up takes the ramp's first step in the same sample.
        let mut controller = in_mode(ModeName::Running);
        let held_v = controller.drive_v();
        let late = controller.tick(&hold(f32::NAN));
        controller.not_latched(held_v);
        assert_eq!(controller.drive_v(), held_v);
        assert_eq!(controller.tick(&hold(0.0)).drive_v, late.drive_v);
        for mode in [ModeName::Idle, ModeName::Armed] {
            let mut controller = in_mode(mode);
            controller.not_latched(0.0);
            assert_eq!((controller.mode_name(), controller.tick(&hold(0.0)).drive_v), (mode, 0.0));
        }
    }

    #[test]
    fn a_reset_by_the_watchdog_starts_in_fault() {
        let mut controller = Controller::in_fault(law(), FaultCode::WatchdogReset);
        assert_eq!(controller.tick(&hold(0.0)).drive_v, 0.0);
        assert!(controller.arm().is_err());
        assert_eq!(controller.clear_fault(), Ok(()));
        assert_eq!(controller.arm(), Ok(()));
    }
}
