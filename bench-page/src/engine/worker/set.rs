//! The experiment set, and what follows from it: a pass with its gap, a diagnosis, the effect in the plant.

use super::{Answer, Line, Play, STATUS, Worker, bench, rms_um};
use crate::diagnosis;
use crate::engine::experiments::{self, Experiment};
use crate::engine::model::Twin;
use crate::engine::{Pass, Source, Task, lock};
use crate::recorder::free_name;
use control_core::ModeName;
use hil_bridge::pins::samples_to_rest;
use hil_bridge::session::SessionError;
use plant_sim::spec::Spec;
use std::path::PathBuf;
use virtual_board::waveform::Waveform;
use wire::ToBoard;

impl Worker<'_> {
    /// Runs the experiment set. Armed before, so that it takes two actions, as a run does.
    pub(super) fn run_set(&mut self, answer: Answer) {
        if self.mode() != Some(ModeName::Armed) {
            let _ = answer.send(Err("arm first: the set moves the bench".to_owned()));
            return;
        }
        if self.shared.task().is_some() {
            let _ = answer.send(Err("a diagnosis is being made: wait for its end".to_owned()));
            return;
        }
        if self.recorder.is_some() {
            let _ = answer.send(Err("end the recording first: the set makes its own".to_owned()));
            return;
        }
        if let Err(error) = experiments::check(&self.setting.plant) {
            let _ = answer.send(Err(error));
            return;
        }
        let _ = answer.send(Ok("the experiment set runs".to_owned()));
        self.is_set_running = true;
        self.is_set_stopped = false;
        let own = self.play.text.clone();
        let outcome = self.play_set();
        self.is_set_running = false;
        self.shared.set_task(None);
        if let (Some(mut recorder), Some(line)) = (self.recorder.take(), &self.line) {
            // A part of an experiment; why it is one, the event says.
            let _ = recorder.keep(line.session.statistics());
        }
        let _ = self.stop("the experiment set has ended");
        let settled = self.settle();
        if let Ok(play) = self.laid_out(&own) {
            self.play = play;
        }
        match outcome {
            Ok(pass) => {
                let line = format!("pass {}: gap {:.3} um rms with {}", pass.number, pass.gap_rms_um, pass.plant);
                self.passes.push(pass);
                self.event(false, line);
            }
            Err(error) => self.event(true, format!("the experiment set ended early: {error}")),
        }
        if let Err(error) = settled {
            self.event(true, error);
        }
        self.publish();
    }

    fn play_set(&mut self) -> Result<Pass, String> {
        let number = self.passes.len() + 1;
        let folder = free_name(&self.setting.runs, &format!("pass-{number}")).map_err(|error| error.to_string())?;
        std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let set = experiments::set(&self.setting.plant.model);
        // Bench and plant both from their start, so that what is between them is the model's doing and not an earlier run's.
        self.restart();
        let mut rms = Vec::new();
        let (mut all, mut held_out) = ((0.0, 0), (0.0, 0));
        for (index, experiment) in set.iter().enumerate() {
            let shares = [index, index + 1].map(|done| done as f64 / set.len() as f64);
            let gap = self.play_experiment(experiment, folder.join(experiment.name), shares)?;
            rms.push((experiment.name.to_owned(), rms_um(gap)));
            let sum = if experiment.is_held_out { &mut held_out } else { &mut all };
            *sum = (sum.0 + gap.0, sum.1 + gap.1);
        }
        Ok(Pass {
            number,
            plant: self.plant_name(),
            gap_rms_um: rms_um((all.0 + held_out.0, all.1 + held_out.1)),
            held_out_rms_um: rms_um(held_out),
            folder: folder.display().to_string(),
            experiments: rms,
        })
    }

    /// Demagnetises, then plays and records one experiment; the squared gap and the rows. `shares` of the set lie behind before and after.
    fn play_experiment(
        &mut self,
        experiment: &Experiment,
        path: PathBuf,
        [from, to]: [f64; 2],
    ) -> Result<(f64, u64), String> {
        self.shared
            .set_task(Some(Task { what: format!("experiment {}: demagnetising", experiment.name), share: from }));
        let sine = experiments::demagnetise(&self.setting.plant.model, self.setting.rate_hz);
        let waveform = Waveform { segments: vec![sine], table: Vec::new() };
        self.play = Play { text: "demagnetising sine".to_owned(), waveform, is_closed_loop: false };
        self.play_through(u64::from(sine.samples), &|_| {})?;
        self.play = self.laid_out(&experiment.spec)?;
        let spec = Spec::parse(&experiment.spec).map_err(|error| error.to_string())?;
        let seconds: f64 = spec.parts.iter().filter_map(|part| part.seconds).sum();
        let samples = (seconds * self.setting.rate_hz).round();
        self.begin_recording(path, samples as usize).map_err(|error| error.to_string())?;
        self.gap = (0.0, 0);
        let (shared, what) = (self.shared, format!("experiment {}", experiment.name));
        self.play_through(samples as u64, &|done| {
            shared.set_task(Some(Task { what: what.clone(), share: from + (to - from) * done }));
        })?;
        Ok(self.gap)
    }

    /// Arms, runs `samples` samples as fast as the link allows, and stops; a recording ends before the ramp.
    /// `progress` is told the share that is done.
    fn play_through(&mut self, samples: u64, progress: &dyn Fn(f64)) -> Result<(), String> {
        if self.mode() == Some(ModeName::Armed) {
            // Armed by hand, with the page's own waveform.
            let _ = self.line()?.session.stop();
            self.settle()?;
        }
        self.arm_board()?;
        self.order(&ToBoard::Run)?;
        let mut left = samples;
        while left > 0 {
            let done = self.chunk(left);
            left -= done;
            while let Ok(order) = self.orders.try_recv() {
                self.obey(order);
            }
            if self.published.elapsed() >= STATUS {
                progress(1.0 - left as f64 / samples as f64);
                self.publish();
            }
            if self.is_set_stopped {
                return Err("it was stopped".to_owned());
            }
            if self.line.is_none() {
                return Err("the board is gone".to_owned());
            }
            if let Some(fault) = self.fault {
                return Err(format!("the board is in {fault}"));
            }
        }
        let gap = self.gap;
        if let Some(recorder) = self.recorder.take()
            && let Some(line) = &self.line
        {
            recorder.finish(line.session.statistics(), self.fault).map_err(|error| error.to_string())?;
        }
        if let Err(error) = self.line()?.session.stop() {
            self.lose(&error);
            return Err(error.to_string());
        }
        self.settle()?;
        self.gap = gap;
        Ok(())
    }

    /// Goes on until the board is at rest; one that is lost meanwhile is told as such where that was seen.
    pub(super) fn settle(&mut self) -> Result<(), String> {
        let mut left = self.line.as_ref().map_or(0, |line| samples_to_rest(&line.ready.parameters));
        while left > 0 {
            left -= self.chunk(left.min(64));
            if self.line.as_ref().is_none_or(Line::is_at_rest) {
                return Ok(());
            }
        }
        if self.line.is_none() { Ok(()) } else { Err(SessionError::NotAtRest.to_string()) }
    }

    /// Bench and plant back to their starts; the bench's noise goes on with another seed.
    pub(super) fn restart(&mut self) {
        let seed = self.setting.seed.wrapping_add(self.passes.len() as u64);
        if let Some(line) = &mut self.line {
            line.seed = seed;
            line.bench = bench(&self.setting, line.ready.latency_s, seed);
            self.twin = Twin::new(&self.setting.plant.model, self.setting.rate_hz, line.ready.latency_s);
        }
    }

    pub(super) fn diagnose(&mut self) -> Result<String, String> {
        let Some(pass) = self.passes.last() else { return Err("run the experiment set first".to_owned()) };
        if self.shared.task().is_some() {
            return Err("a diagnosis is being made".to_owned());
        }
        let set = experiments::set(&self.setting.plant.model);
        let path = |experiment: &Experiment| PathBuf::from(&pass.folder).join(experiment.name).join("log.csv");
        let (held_out, fitted): (Vec<_>, Vec<_>) = set.iter().partition(|experiment| experiment.is_held_out);
        let folder = free_name(&self.setting.runs, &format!("diagnosis-{}", pass.number)).map_err(|e| e.to_string())?;
        diagnosis::begin(
            self.shared.clone(),
            diagnosis::Case {
                plant: self.setting.plant.clone(),
                logs: fitted.into_iter().map(path).collect(),
                held_out: held_out.into_iter().map(path).collect(),
                pass: PathBuf::from(&pass.folder),
                folder,
                seed: self.setting.seed,
            },
        )?;
        Ok(self.say("diagnosing".to_owned()))
    }

    /// Says how a diagnosis ended.
    pub(super) fn look_at_diagnosis(&mut self) {
        match self.shared.take_ended() {
            None => {}
            Some(Err(error)) => self.event(true, format!("no diagnosis: {error}")),
            Some(Ok(())) => {
                if let Some(found) = self.shared.found() {
                    self.event(false, found.diagnosis.sentence());
                }
            }
        }
    }

    pub(super) fn add_effect(&mut self) -> Result<String, String> {
        if self.recorder.is_some() {
            return Err("end the recording first: bench and plant begin anew with the effect".to_owned());
        }
        let Some(mut found) = self.shared.found() else { return Err("diagnose first".to_owned()) };
        if found.is_in_use {
            return Err("the diagnosed plant is in use already".to_owned());
        }
        if self.mode() != Some(ModeName::Idle) {
            return Err("only while idle: stop first".to_owned());
        }
        let path = found.folder.join("augmented.toml");
        let bytes = std::fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let name = format!("{}/augmented.toml", found.folder.file_name().unwrap_or_default().to_string_lossy());
        self.setting.bench.get_or_insert_with(|| self.setting.plant.clone());
        self.setting.plant = Source { name, bytes, model: found.diagnosis.augmented.clone() };
        self.restart();
        found.is_in_use = true;
        *lock(&self.shared.found) = Some(found);
        let name = self.plant_name();
        Ok(self.say(format!("the plant is now {name}: run the set again")))
    }

    /// The plant with the effects that its file carries.
    pub(super) fn plant_name(&self) -> String {
        let plant = &self.setting.plant;
        let effects: Vec<&str> = plant.model.effects.iter().map(|effect| effect.id.as_str()).collect();
        if effects.is_empty() { plant.name.clone() } else { format!("{} ({})", plant.name, effects.join(", ")) }
    }
}
