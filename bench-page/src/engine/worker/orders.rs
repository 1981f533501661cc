//! What others wish: each wish has one answer, and a refusal says what to do.

use super::super::{Order, Wish};
use super::{Hosted, Play, Worker, connect};
use crate::engine::model::{judge, within_rig};
use crate::recorder::{Recorder, Subject, file_name, free_name};
use crate::{parameters, runs};
use control_core::{FaultCode, GeneratorState, ModeName, Settings};
use hil_bridge::lockstep::LockstepError;
use hil_bridge::run_directory::RunError;
use hil_bridge::session::SessionError;
use plant_sim::controller::Controller;
use plant_sim::spec::{Shape, Spec, Unit};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::mpsc;
use virtual_board::waveform::Waveform;
use wire::{Parameters, ToBoard};

/// How often a request is sent before its silence is an answer.
const ATTEMPTS: u32 = 4;
/// Sets of parameters that can be gone back to.
const UNDO: usize = 100;
/// Folder of the saved sets, beside the runs.
pub const SETS: &str = "sets";

impl Worker<'_> {
    pub(super) fn obey(&mut self, order: Order) {
        let Order { wish, answer } = order;
        let busy = match wish {
            Wish::Stop(_) | Wish::Leave => None,
            _ if self.is_set_running => Some("the experiment set runs: stop it first"),
            _ if self.is_judging => Some("the margins of a new set are being computed: ask again in a moment"),
            _ => None,
        };
        if let Some(busy) = busy {
            let _ = answer.send(Err(busy.to_owned()));
            return;
        }
        if let Wish::Experiments = wish {
            return self.run_set(answer);
        }
        let done = self.carry_out(wish);
        self.publish();
        let _ = answer.send(done);
    }

    fn carry_out(&mut self, wish: Wish) -> Result<String, String> {
        match wish {
            Wish::Arm => self.arm(),
            Wish::Run => self.order(&ToBoard::Run).map(|()| self.say(format!("running {}", self.play.text))),
            Wish::Stop(why) => self.stop(why),
            Wish::ClearFault => {
                self.order(&ToBoard::ClearFault)?;
                self.fault = None;
                Ok(self.say("fault cleared".to_owned()))
            }
            Wish::Play(text) => self.set_play(&text),
            Wish::Apply(values) => {
                let before = self.parameters()?;
                let after = parameters::changed(&before, &values)?;
                self.set_parameters(&before, after, true)
            }
            Wish::Undo => {
                let before = self.parameters()?;
                let Some(earlier) = self.undo.last().copied() else { return Err("nothing to undo".to_owned()) };
                let done = self.set_parameters(&before, earlier, false)?;
                self.undo.pop();
                Ok(done)
            }
            Wish::Save(name) => self.save(&name),
            Wish::Load(name) => {
                let before = self.parameters()?;
                let controller = Controller::read(&self.listed_set(&name)?).map_err(|error| error.to_string())?;
                if controller.inverse.is_some() {
                    return Err(format!("{name}: [inverse] runs in `hysteron simulate` only: remove the section"));
                }
                let after = before.with_settings(&controller.settings(self.setting.rate_hz));
                self.set_parameters(&before, after, true).map(|done| format!("{name}: {done}"))
            }
            Wish::Record(name) => self.record(&name),
            Wish::EndRecord => match self.end_recording(None) {
                Some(ended) => ended,
                None => Err("nothing is being recorded".to_owned()),
            },
            Wish::Diagnose => self.diagnose(),
            Wish::AddEffect => self.add_effect(),
            Wish::Reconnect => self.reconnect(),
            Wish::Leave => {
                let left = self.leave();
                self.has_left = true;
                left.map(|()| "the board is idle".to_owned())
            }
            // Answered before, because it takes long.
            Wish::Experiments => Ok(String::new()),
        }
    }

    /// One request, again where it or its answer was lost on the way; a board that is gone is given up.
    pub(super) fn order(&mut self, request: &ToBoard<'_>) -> Result<(), String> {
        let mut left = ATTEMPTS;
        loop {
            left -= 1;
            match self.line()?.session.order(request) {
                Ok(()) => {
                    self.refresh();
                    return Ok(());
                }
                Err(SessionError::Silent { .. }) if left > 0 => {
                    self.refresh();
                    // Heard, and only its answer lost: a second one would be refused.
                    let is_so = match request {
                        ToBoard::Arm => self.mode() == Some(ModeName::Armed),
                        ToBoard::Run => self.mode() == Some(ModeName::Running),
                        ToBoard::ClearFault => self.mode() == Some(ModeName::Idle),
                        _ => false,
                    };
                    if is_so {
                        return Ok(());
                    }
                }
                Err(error @ (SessionError::Refused { .. } | SessionError::Silent { .. })) => {
                    return Err(error.to_string());
                }
                Err(error) => {
                    self.lose(&error);
                    return Err(error.to_string());
                }
            }
        }
    }

    /// The mode as the board has it now; a sample would tell it, too, but not before the answer to a click.
    fn refresh(&mut self) {
        if let Some(line) = &mut self.line
            && let Ok(account) = line.session.status()
        {
            line.mode = account.mode;
            line.account = account;
        }
    }

    fn arm(&mut self) -> Result<String, String> {
        self.arm_board()?;
        Ok(self.say("armed: Run starts the loop".to_owned()))
    }

    /// Gives an idle board what is to be played, and arms it.
    pub(super) fn arm_board(&mut self) -> Result<(), String> {
        if self.mode() == Some(ModeName::Idle) {
            self.send_waveform()?;
        }
        self.order(&ToBoard::Arm)
    }

    /// A segment sent twice would be played twice, so where one is lost all of it begins again; anything else is sent again by itself.
    fn send_waveform(&mut self) -> Result<(), String> {
        let (waveform, is_closed_loop) = (self.play.waveform.clone(), self.play.is_closed_loop);
        let mut left = ATTEMPTS;
        loop {
            left -= 1;
            let session = &mut self.line()?.session;
            let sent = waveform.send(is_closed_loop, |request| {
                let attempts = if matches!(request, ToBoard::WaveSegment(_)) { 1 } else { ATTEMPTS };
                let mut done = session.order(request);
                for _ in 1..attempts {
                    let Err(SessionError::Silent { .. }) = done else { break };
                    done = session.order(request);
                }
                done
            });
            match sent {
                Err(SessionError::Silent { .. }) if left > 0 => {}
                sent => return sent.map_err(|error| error.to_string()),
            }
        }
    }

    pub(super) fn stop(&mut self, why: &str) -> Result<String, String> {
        self.is_set_stopped = true;
        match self.mode() {
            None => return Err("there is no board to stop".to_owned()),
            Some(ModeName::Idle | ModeName::Stopping | ModeName::Fault) => return Ok("nothing runs".to_owned()),
            Some(ModeName::Armed | ModeName::Running) => {}
        }
        if let Err(error) = self.line()?.session.stop() {
            self.lose(&error);
            return Err(error.to_string());
        }
        self.refresh();
        Ok(self.say(format!("stopped: {why}")))
    }

    pub(super) fn laid_out(&self, text: &str) -> Result<Play, String> {
        let spec = Spec::parse(text).map_err(|error| error.to_string())?;
        // Who may see the page may move the bench; the files of this machine are nothing of theirs, not even a line in a refusal.
        if spec.parts.iter().any(|part| matches!(part.shape, Shape::File { .. })) {
            return Err(
                "a page plays no file: give the samples' file to `hysteron simulate`, `hil` or `record`".to_owned()
            );
        }
        let waveform = Waveform::new(&spec, self.setting.rate_hz).map_err(|error| error.to_string())?;
        Ok(Play { text: text.to_owned(), waveform, is_closed_loop: spec.unit != Some(Unit::Volt) })
    }

    fn set_play(&mut self, text: &str) -> Result<String, String> {
        let play = self.laid_out(text)?;
        match self.mode() {
            Some(ModeName::Running) => {
                self.hosted = Some(Hosted {
                    waveform: play.waveform.clone(),
                    is_closed_loop: play.is_closed_loop,
                    state: GeneratorState::default(),
                    ahead: VecDeque::new(),
                    told: None,
                });
            }
            Some(ModeName::Armed) => {
                return Err("the board is armed with another waveform: run or stop first".to_owned());
            }
            _ => {}
        }
        self.play = play;
        Ok(self.say(format!("plays {text}")))
    }

    fn set_parameters(&mut self, before: &Parameters, after: Parameters, is_new: bool) -> Result<String, String> {
        let line = self.line()?;
        let checked = after.check(&line.ready.board.converters).map_err(|error| error.to_string())?;
        let latency_s = line.ready.latency_s;
        let what = parameters::difference(before, &after);
        if what.is_empty() {
            return Ok("nothing changed".to_owned());
        }
        within_rig(&self.setting.plant, &after.settings())?;
        let warning = self.judge_beside(after.settings(), latency_s)?;
        self.order(&ToBoard::SetParameters(after))?;
        let line = self.line()?;
        line.ready.parameters = after;
        line.ready.checked = checked;
        if is_new {
            self.undo.push(*before);
            if self.undo.len() > UNDO {
                self.undo.remove(0);
            }
        }
        let said = self.say(what);
        let Some(warning) = warning else { return Ok(said) };
        let both = format!("{said}; {warning}");
        // The newest line is the one that is looked at.
        self.event(true, warning);
        Ok(both)
    }

    /// What is to be said of the loop that `settings` close, while the one that there is goes on: with many hysterons that takes seconds, and a
    /// stop waits for none of them.
    fn judge_beside(&mut self, settings: Settings, latency_s: f64) -> Result<Option<String>, String> {
        let chain = self.twin.chain.clone();
        let (sender, outcome) = mpsc::channel();
        let work = move || sender.send(judge(&chain, &settings, latency_s));
        std::thread::Builder::new()
            .name("margins".into())
            .spawn(work)
            .map_err(|error| format!("the margins' thread can't be started: {error}"))?;
        self.is_judging = true;
        let judged = loop {
            match outcome.recv_timeout(self.wait()) {
                Ok(judged) => break Some(judged),
                Err(mpsc::RecvTimeoutError::Timeout) => {}
                Err(mpsc::RecvTimeoutError::Disconnected) => break None,
            }
            self.go_on();
            if self.has_left {
                break None;
            }
        };
        self.is_judging = false;
        match judged {
            None if self.has_left => Err("hysteron serve has ended".to_owned()),
            None => Err("the margins can't be computed: the set in force stays".to_owned()),
            Some(Ok(judged)) => judged,
            // Not every diagnosed plant has regions that are linear: then the guards of the board are what there is.
            Some(Err(error)) => Ok(Some(format!("margins not computed: {error}"))),
        }
    }

    /// Where a set of this name is: a controller file, so that every command takes it.
    fn set_path(&self, name: &str) -> Result<PathBuf, String> {
        match file_name(name) {
            stem if stem.is_empty() => Err("give the set a name".to_owned()),
            stem => Ok(self.setting.runs.join(SETS).join(format!("{stem}.toml"))),
        }
    }

    /// The set that is listed under this name, whatever its file is called.
    fn listed_set(&self, name: &str) -> Result<PathBuf, String> {
        let listed = runs::sets(&self.setting.runs.join(SETS)).iter().any(|listed| listed == name);
        if listed { Ok(self.setting.runs.join(SETS).join(format!("{name}.toml"))) } else { self.set_path(name) }
    }

    fn save(&mut self, name: &str) -> Result<String, String> {
        let path = self.set_path(name)?;
        let settings = self.parameters()?.settings();
        let folder = self.setting.runs.join(SETS);
        std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        parameters::controller(name, &settings).write(&path).map_err(|error| error.to_string())?;
        Ok(self.say(format!("saved {}", path.display())))
    }

    fn record(&mut self, name: &str) -> Result<String, String> {
        self.line()?;
        if self.recorder.is_some() {
            return Err("a recording is being made: end it first".to_owned());
        }
        let stem = Some(file_name(name)).filter(|stem| !stem.is_empty()).unwrap_or_else(|| "run".to_owned());
        let path = free_name(&self.setting.runs, &stem).map_err(|error| error.to_string())?;
        self.begin_recording(path, 0).map_err(|error| error.to_string())?;
        let name = self.recorder.as_ref().map(|recorder| recorder.path.display().to_string()).unwrap_or_default();
        Ok(self.say(format!("records into {name}")))
    }

    pub(super) fn begin_recording(&mut self, path: PathBuf, samples: usize) -> Result<(), RunError> {
        let Some(line) = &self.line else { return Ok(()) };
        let plant = self.setting.bench.as_ref().unwrap_or(&self.setting.plant);
        let subject = Subject {
            place: &self.setting.place,
            ready: &line.ready,
            plant: (&plant.name, &plant.bytes),
            spec: &self.play.text,
            samples,
            seed: line.seed,
            image: self.setting.image.as_ref().map(|(name, bytes)| (name.as_str(), bytes.as_slice())),
        };
        self.recorder = Some(Recorder::begin(&path, &subject)?);
        Ok(())
    }

    /// Ends a recording, by hand or because it can't go on; then the loop is stopped, as `hysteron hil` does.
    pub(super) fn end_recording(&mut self, error: Option<&str>) -> Option<Result<String, String>> {
        let mut recorder = self.recorder.take()?;
        let (path, rows) = (recorder.path.display().to_string(), recorder.rows);
        let statistics = self.line.as_ref().map(|line| line.session.statistics());
        let ended = match (error, statistics) {
            (None, Some(statistics)) => recorder.finish(statistics, self.fault).map_err(|error| error.to_string()),
            (Some(error), Some(statistics)) => {
                // The first failure is the one to tell.
                let _ = recorder.keep(statistics);
                Err(error.to_owned())
            }
            (error, None) => Err(error.unwrap_or("there is no board").to_owned()),
        };
        Some(match ended {
            Ok(()) => Ok(self.say(format!("recorded {rows} rows in {path}"))),
            Err(error) => {
                let _ = self.stop("the recording can't go on");
                let line = format!("the recording ended after {rows} rows, which are there: {error}");
                self.event(true, line.clone());
                Err(line)
            }
        })
    }

    fn reconnect(&mut self) -> Result<String, String> {
        if self.line.is_some() {
            return Err("the board is there".to_owned());
        }
        let line = match connect(&self.setting, self.setting.clear_fault, self.left) {
            // What a board makes of a lost host is no news to whoever asks it back.
            Err(LockstepError::InFault { fault, .. }) if fault == FaultCode::LinkLoss.word().replace('_', " ") => {
                connect(&self.setting, true, self.left)
            }
            connected => connected,
        };
        let line = line.map_err(|error| error.to_string())?;
        let now = line.ready.parameters;
        self.line = Some(line);
        self.lost = None;
        self.fault = None;
        self.restart();
        let said = self.say("the board is back".to_owned());
        let Some([_, last]) = self.left.filter(|[_, last]| *last != now) else { return Ok(said) };
        // Earlier sets are the earlier board's, with its calibration.
        self.undo.clear();
        let what = Some(parameters::difference(&last, &now)).filter(|what| !what.is_empty());
        let what = what.unwrap_or_else(|| "its calibration is another".to_owned());
        let warning = format!("the board came back with other parameters: {what}; nothing to undo");
        self.event(true, warning.clone());
        Ok(format!("{said}; {warning}"))
    }
}
