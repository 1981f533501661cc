//! The server over its socket, without a browser: who is let in, who may move the bench, and how a run ends when a page or a board is gone.
//!
//! Nothing here waits for a time to pass and then looks: each test reads what the server sends until it says what is expected.

mod support;

use bench_page::engine::{Engine, Open, StartError, Wish};
use hil_bridge::in_process::InProcess;
use hil_bridge::link::{Link, LinkError};
use hil_bridge::session::Session;
use plant_sim::controller::Controller;
use plant_sim::model::Model;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use support::{Bench, Client, file, in_process, serve, setting, start};
use tungstenite::Message;

#[test]
fn foreign_hosts_and_origins_get_one_line_and_nothing_else() {
    let bench = in_process();
    let own = format!("Host: {}\r\n", bench.host);
    let page = bench.get("/", &own);
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("frame-ancestors 'none'"), "{page:.600}");
    assert!(!page.contains(&bench.token), "the page itself holds no secret");
    for headers in [
        "Host: evil.example\r\n".to_owned(),
        format!("Host: evil.example:{}\r\n", bench.host.split(':').next_back().expect("a port")),
        format!("{own}Origin: http://evil.example\r\n"),
        format!("{own}Origin: null\r\n"),
    ] {
        let answer = bench.get("/", &headers);
        assert!(answer.starts_with("HTTP/1.1 403"), "{headers}: {answer:.100}");
        let body = answer.split("\r\n\r\n").nth(1).expect("a body");
        assert!(body.lines().count() == 1 && body.contains("hysteron serve"), "{body}");
    }
    for origin in ["", "http://evil.example", "null"] {
        assert!(bench.connect(origin).is_err_and(|error| error.contains("403")), "{origin}");
    }
    assert!(bench.get("/report/0123/report.html", &own).starts_with("HTTP/1.1 404"));
}

#[test]
fn a_stale_token_is_told_so_and_sees_nothing() {
    let bench = in_process();
    for stale in ["", "0123456789abcdef0123456789abcdef"] {
        let (mut client, first) = bench.open(stale);
        assert_eq!((&first["kind"], &first["is_final"]), (&json!("refused"), &json!(true)));
        assert!(first["reason"].as_str().is_some_and(|reason| reason.contains("earlier start")), "{first}");
        assert!(matches!(client.socket.read(), Ok(Message::Close(_)) | Err(_)));
    }
    // Nor does one that asks before it has shown any.
    let socket = bench.connect(&format!("http://{}", bench.host)).expect("our own origin");
    let mut client = Client { socket, next: 1, beats: true };
    client.send(&json!({ "id": 1, "do": "arm" }));
    assert_eq!(client.message()["kind"], "refused");
}

/// What may be another time is no reason for a page to give up.
#[test]
fn a_page_too_many_is_let_in_when_one_has_gone() {
    let bench = in_process();
    let mut pages: Vec<Client> = (0..32).map(|_| bench.page()).collect();
    let (_, first) = bench.open(&bench.token);
    assert_eq!((&first["kind"], &first["is_final"]), (&json!("refused"), &json!(false)));
    assert!(first["reason"].as_str().is_some_and(|reason| reason.contains("close one")), "{first}");
    pages.pop();
    // The server hears of it when it next writes.
    let is_in = (0..200).any(|_| {
        std::thread::sleep(Duration::from_millis(20));
        bench.open(&bench.token).1["kind"] == "hello"
    });
    assert!(is_in);
}

#[test]
fn one_page_moves_the_bench_and_any_page_stops_it() {
    let bench = in_process();
    let (mut one, mut two) = (bench.page(), bench.page());
    assert!(one.order("arm").is_err_and(|line| line.contains("take control first")));
    one.run();
    assert!(two.order("take-control").is_err_and(|line| line.contains("another page holds control")));
    assert!(two.order("record").is_err(), "a name is missing");
    assert!(two.ask(json!({ "do": "play", "text": "zero" })).is_err_and(|line| line.contains("watches")));
    two.until("other", |message| message["kind"] == "page" && message["control"] == "other");
    two.order("stop").expect("anybody may stop");
    two.mode("idle");
    one.order("release-control").expect("it had it");
    two.order("take-control").expect("it is free");
    two.until("mine", |message| message["kind"] == "page" && message["control"] == "mine");
}

#[test]
fn a_page_that_is_closed_while_its_loop_runs_ends_the_run() {
    let bench = in_process();
    let (mut driver, mut watcher) = (bench.page(), bench.page());
    driver.run();
    // No goodbye: as a browser that crashed.
    drop(driver);
    watcher.event("the page that held control was closed");
    watcher.mode("idle");
    watcher.order("take-control").expect("control is free again");
}

#[test]
fn a_page_that_falls_silent_loses_control_and_the_run_ends() {
    let bench = in_process();
    let (mut driver, mut watcher) = (bench.page(), bench.page());
    driver.run();
    driver.beats = false;
    watcher.event("the page that held control is silent");
    watcher.mode("idle");
}

#[test]
fn what_cannot_be_meant_is_refused_in_one_line_and_changes_nothing() {
    let bench = in_process();
    let mut page = bench.page();
    page.order("take-control").expect("it is free");
    for (request, part) in [
        (json!({ "do": "play", "text": "sine:20um" }), "needs a frequency"),
        (json!({ "do": "play", "text": "" }), "unknown kind"),
        (json!({ "do": "play", "text": "multisine:1um@0.1-100Hz" }), "table"),
        (json!({ "do": "play", "text": "multisine:1um@1-9999Hz,realisations=10" }), "200000 samples of table"),
        (json!({ "do": "play", "text": "zero@1s+file:/etc/passwd" }), "a page plays no file"),
        (json!({ "do": "apply", "values": { "kp": -1 } }), "outside"),
        (json!({ "do": "apply", "values": { "kp": 19 } }), "unstable"),
        (json!({ "do": "apply", "values": { "reference_max": 130 } }), "trip_m"),
        (json!({ "do": "apply", "values": { "trip": 129, "reference_max": 128 } }), "displacement_max_um = 120"),
        (json!({ "do": "run" }), "refused"),
        (json!({ "do": "undo" }), "nothing to undo"),
        (json!({ "do": "end-record" }), "nothing is being recorded"),
        (json!({ "do": "experiments" }), "arm first"),
        (json!({ "do": "diagnose" }), "experiment set first"),
        (json!({ "do": "add-effect" }), "diagnose first"),
        (json!({ "do": "load", "name": "../../etc/passwd" }), "etc-passwd.toml"),
        (json!({ "do": "compare", "names": ["../x"] }), "no run of this folder"),
        (
            json!({ "do": "trigger", "trigger": { "channel": 99, "level": 0, "rising": true, "before": 1, "after": 1, "repeat": false } }),
            "channel",
        ),
    ] {
        let refused = page.ask(request.clone());
        assert!(
            refused.as_ref().is_err_and(|line| line.contains(part) && line.lines().count() == 1),
            "{request}: {refused:?}"
        );
    }
    for garbage in ["", "{", "[]", "{\"do\":\"fly\"}", "{\"do\":\"play\"}", "{\"do\":\"past\",\"first\":-1}"] {
        page.socket.send(Message::text(garbage)).expect("the server listens");
        let reply = page.until("a reply", |message| message["kind"] == "reply");
        assert!(reply["text"].as_str().is_some_and(|text| text.starts_with("not understood")), "{reply}");
    }
    page.mode("idle");
}

#[test]
fn parameters_change_as_one_while_it_runs_and_go_back() {
    let bench = in_process();
    let mut page = bench.page();
    page.run();
    let said = page.ask(json!({ "do": "apply", "values": { "kp": 0.5, "ki": 0.8 } })).expect("a stable loop");
    assert!(said.contains("Kp 0.85811 -> 0.5 V/um") && said.contains("Ki"), "{said}");
    page.ask(json!({ "do": "save", "name": "soft" })).expect("room on the disk");
    assert!(page.order("undo").is_ok_and(|said| said.contains("Kp 0.5 -> 0.85811")));
    let said = page.ask(json!({ "do": "load", "name": "soft" })).expect("a saved set");
    assert!(said.contains("-> 0.5 V/um"), "{said}");
    assert!(Controller::read(&bench.runs.join("sets/soft.toml")).is_ok(), "a set is a controller file");
    assert!(
        page.ask(json!({ "do": "apply", "values": { "link_timeout": 100 } })).is_err_and(|line| line.contains("idle"))
    );
}

/// Waits until a recording is whole.
fn ends_by_itself(bench: &Bench, recording: &str) {
    let link = bench.runs.join(recording).join("link.json");
    let is_complete = || std::fs::read_to_string(&link).is_ok_and(|text| text.contains("\"is_complete\": true"));
    let begun = std::time::Instant::now();
    while !is_complete() {
        assert!(begun.elapsed() < Duration::from_secs(60), "it goes on");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// A page that has control, and a recording under way in which the board has tripped: 70 V hold the bender at 132 um, beyond 120 um.
fn tripped(bench: &Bench, recording: &str) -> Client {
    let mut page = bench.page();
    page.order("take-control").expect("it is free");
    page.ask(json!({ "do": "play", "text": "hold:70V" })).expect("a SPEC");
    page.ask(json!({ "do": "record", "name": recording })).expect("room on the disk");
    for what in ["arm", "run"] {
        page.order(what).expect(what);
    }
    page.until("the fault", |message| message["kind"] == "status" && message["fault"] == "displacement trip");
    page
}

#[test]
fn a_fault_is_named_and_left_by_hand() {
    let bench = in_process();
    let mut page = tripped(&bench, "tripped");
    assert!(page.order("arm").is_err());
    page.order("clear-fault").expect("at 0 V");
    page.mode("idle");
    // Cleared before its end, it is a fault of the recording all the same.
    page.order("end-record").expect("there is one");
    let link = std::fs::read_to_string(bench.runs.join("tripped/link.json")).expect("a recording");
    assert!(link.contains("\"fault\": \"displacement_trip\""), "{link}");
}

#[test]
fn a_plant_of_another_kind_is_served_and_its_diagnosis_refused_in_words() {
    let mut setting = setting("models/thesis-bouc-wen.toml", Box::new(|| Ok(Box::new(InProcess::nucleo()))));
    setting.image = Some(("board.elf".into(), b"no ELF, but bytes".to_vec()));
    let bench = serve(setting);
    let mut page = bench.page();
    for what in ["take-control", "arm", "experiments"] {
        page.order(what).expect(what);
    }
    let state = page.until("a pass", |message| message["passes"][0]["number"] == 1);
    let gap_um = state["passes"][0]["gap_rms_um"].as_f64().expect("a number");
    // Bench and plant are the same: what is left is the converter's step of 63.5 nm, 18.3 nm rms where it is crossed at random.
    assert!((0.010..0.030).contains(&gap_um), "{gap_um}");
    // The set ran ahead of wall time; the loop does not wait for that to come after.
    let mut samples = Vec::new();
    while samples.len() < 20 {
        let status = page.until("a status", |message| message["kind"] == "status");
        samples.push(status["samples"].as_u64().expect("a number"));
    }
    assert!(samples[19] > samples[0], "{samples:?}");
    assert!(page.order("diagnose").is_err_and(|line| line.contains("kind bouc-wen can't be diagnosed")));
    // Stopped on its way, the set ends and makes no pass.
    page.order("arm").expect("idle");
    page.order("experiments").expect("armed");
    let recorded = page.until("a recording", |message| message["recording"].is_object());
    page.order("stop").expect("anybody may stop");
    page.event("the experiment set ended early: it was stopped");
    page.mode("idle");
    // What is beside the rows: the second pass has other noise than the first, and the image is named.
    let path = recorded["recording"]["path"].as_str().expect("a path");
    let header = |path: &Path| -> Value {
        serde_json::from_str(&std::fs::read_to_string(path.join("run.json")).expect("a header")).expect("JSON")
    };
    let (first, second) = (header(&bench.runs.join("pass-1/steps")), header(Path::new(path)));
    assert_eq!((&first["seed"], &second["seed"]), (&json!(1), &json!(2)));
    assert_eq!(second["image"]["file"], "board.elf");
}

/// A link that asks a test before it sends: whether the bytes go out.
struct Asking<A> {
    link: InProcess,
    goes_out: A,
}

impl<A: FnMut() -> Result<bool, LinkError> + Send> Link for Asking<A> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        if (self.goes_out)()? { self.link.send(bytes) } else { Ok(()) }
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        self.link.receive(patience, into)
    }

    fn now(&mut self) -> Duration {
        self.link.now()
    }

    fn patience(&self) -> Duration {
        self.link.patience()
    }
}

/// A link that a switch makes worse: 0 for a good link, 1 for none; else every so many frames to the board one is lost.
fn cut(switch: &Arc<AtomicU64>) -> Open {
    let switch = switch.clone();
    Box::new(move || {
        let (switch, mut sent) = (switch.clone(), 0_u64);
        let goes_out = move || {
            sent += 1;
            match switch.load(Ordering::Relaxed) {
                0 => Ok(true),
                1 => Err(LinkError::Closed),
                every => Ok(!sent.is_multiple_of(every)),
            }
        };
        Ok(Box::new(Asking { link: InProcess::nucleo(), goes_out }))
    })
}

/// A link that hangs while a test holds its gate.
fn gated(gate: &Arc<Mutex<()>>) -> Open {
    let gate = gate.clone();
    Box::new(move || {
        let gate = gate.clone();
        let goes_out = move || {
            drop(gate.lock().unwrap_or_else(PoisonError::into_inner));
            Ok(true)
        };
        Ok(Box::new(Asking { link: InProcess::nucleo(), goes_out }))
    })
}

#[test]
fn an_engine_that_hangs_leaves_the_page_heard_and_its_orders_in_sequence() {
    let gate = Arc::new(Mutex::new(()));
    let bench = start(gated(&gate));
    let mut page = bench.page();
    page.order("take-control").expect("it is free");
    let shut = gate.lock().expect("nobody panicked");
    for id in 900..908 {
        page.send(&json!({ "id": id, "do": "arm" }));
    }
    // Eight wait for the engine; the next one is told so, and other answers come.
    assert!(page.order("arm").is_err_and(|line| line.contains("has not answered")));
    page.order("runs").expect("no matter of the engine's");
    // A stop finds its place behind them.
    page.send(&json!({ "id": 950, "do": "stop" }));
    drop(shut);
    let mut replies = Vec::new();
    while replies.len() < 9 {
        let reply = page.until("a reply", |message| message["kind"] == "reply");
        replies.push((reply["id"].as_u64().expect("a number"), reply["ok"] == true));
    }
    assert_eq!((replies[0], replies[8]), ((900, true), (950, true)));
    assert!(replies.is_sorted(), "{replies:?}");
    page.mode("idle");
}

#[cfg(unix)]
#[test]
fn a_page_that_compares_runs_is_heard_meanwhile() {
    let bench = in_process();
    // A log that is open as soon as somebody writes into it: the comparison lasts as long as this test wants.
    let log = bench.runs.join("slow/log.csv");
    std::fs::create_dir(bench.runs.join("slow")).expect("room on the disk");
    assert!(std::process::Command::new("mkfifo").arg(&log).status().expect("mkfifo").success());
    let mut page = bench.page();
    page.send(&json!({ "id": 900, "do": "compare", "names": ["slow"] }));
    for id in 901..904 {
        page.send(&json!({ "id": id, "do": "runs" }));
    }
    assert!(page.order("runs").is_err_and(|line| line.contains("are being read")));
    page.run();
    page.order("stop").expect("it is heard");
    page.mode("idle");
    std::fs::write(&log, "no log\n").expect("somebody reads");
    for (id, ok) in [(900, false), (901, true), (902, true), (903, true)] {
        let reply = page.until("a reply", |message| message["kind"] == "reply");
        assert_eq!((reply["id"].as_u64(), reply["ok"].as_bool()), (Some(id), Some(ok)), "{reply}");
    }
}

#[test]
fn a_board_that_is_gone_is_said_and_asked_back() {
    let switch = Arc::new(AtomicU64::new(0));
    let bench = start(cut(&switch));
    let mut page = bench.page();
    page.run();
    page.record("cut");
    switch.store(1, Ordering::Relaxed);
    let lost = page.until("lost", |message| message["kind"] == "status" && message["mode"] == "no board");
    assert!(lost["lost"].as_str().is_some_and(|line| line.contains("look after cable")), "{lost}");
    let log = std::fs::read_to_string(bench.runs.join("cut/log.csv")).expect("a log");
    assert!(log.lines().count() > 100 && log.ends_with('\n'), "what came before is whole");
    let link = std::fs::read_to_string(bench.runs.join("cut/link.json")).expect("statistics");
    assert!(link.contains("\"is_complete\": false"), "{link}");
    assert!(page.order("arm").is_err_and(|line| line.contains("reconnect")));
    assert!(page.ask(json!({ "do": "record", "name": "none" })).is_err_and(|line| line.contains("reconnect")));
    assert!(page.order("reconnect").is_err(), "it is still cut");
    switch.store(0, Ordering::Relaxed);
    page.order("reconnect").expect("it is back");
    page.mode("idle");
}

#[test]
fn a_board_that_comes_back_has_the_tuned_law_and_what_it_lost_is_said() {
    let switch = Arc::new(AtomicU64::new(0));
    let bench = start(cut(&switch));
    let mut page = bench.page();
    page.run();
    let is_tuned = |message: &Value, kp: f64| message["kind"] == "state" && message["parameters"]["kp"] == kp;
    page.ask(json!({ "do": "apply", "values": { "kp": 0.5, "drive_max": 50 } })).expect("a stable loop");
    let now = page.until("values", |message| message["now"]["reference_um"].as_f64().is_some_and(|um| um > 19.9));
    assert!(now["now"]["drive_v"].as_f64().is_some_and(|volts| volts > 1.0), "{now}");
    let lose = |page: &mut Client| {
        switch.store(1, Ordering::Relaxed);
        let lost = page.until("lost", |message| message["kind"] == "status" && message["mode"] == "no board");
        assert_eq!(lost["now"], Value::Null, "no value of before");
        switch.store(0, Ordering::Relaxed);
        page.order("reconnect").expect("it is back")
    };
    // Each link opens a new board, set as its image is.
    let said = lose(&mut page);
    assert_eq!(said, "the board is back");
    let state = page.until("tuned", |message| is_tuned(message, 0.5));
    assert_eq!((&state["parameters"]["drive_max"], &state["undo"]), (&json!(50.0), &json!(1)));
    page.order("undo").expect("the set before");
    page.until("undone", |message| is_tuned(message, 0.85811) && message["parameters"]["drive_max"] != 50.0);
    // What is the board's own it does not get back, and nothing leads to the earlier board's sets.
    page.ask(json!({ "do": "apply", "values": { "link_timeout": 100 } })).expect("idle");
    page.order("arm").expect("idle");
    let said = lose(&mut page);
    assert!(said.contains("silent host is a fault after 100.0 -> ") && said.contains("nothing to undo"), "{said}");
    assert!(page.order("undo").is_err_and(|line| line.contains("nothing to undo")));
}

/// Margins below 6 dB are told with the change, in the answer and as the newest event.
#[test]
fn thin_margins_are_told_with_the_change() {
    let bench = in_process();
    let mut page = bench.page();
    page.order("take-control").expect("it is free");
    let said = page.ask(json!({ "do": "apply", "values": { "kp": 2 } })).expect("stable, just");
    assert!(said.contains("-> 2.0 V/um; ") && said.contains("dB"), "{said}");
    let state = page.until("events", |message| message["events"].as_array().is_some_and(|events| events.len() > 1));
    let newest = state["events"].as_array().and_then(|events| events.last()).expect("one");
    assert!(
        newest["is_warning"] == true && newest["text"].as_str().is_some_and(|text| text.contains("dB")),
        "{newest}"
    );
}

/// A plant of many hysterons: its margins take a while, and the loop and a stop wait for none of it.
#[test]
fn a_stop_does_not_wait_for_margins() {
    let mut setting = setting("models/thesis-phs.toml", Box::new(|| Ok(Box::new(InProcess::nucleo()))));
    let text = std::fs::read_to_string(file("models/thesis-phs.toml")).expect("ours");
    let (before, after) = text.split_once("[structure]").expect("a table");
    // Soft ones that no loop feels, each another.
    let more: String = (1..8)
        .map(|k| {
            format!(
                "[[actuator.hysteron]]\ncapacitance_F = {{ value = {k}e-4, source = \"test\" }}\n\
                 slope_S = {{ value = {}e-2, source = \"test\" }}\ndead_zone_V = {{ value = {}.0, source = \"test\" }}\n",
                k * k,
                5 + k
            )
        })
        .collect();
    let text = format!("{before}{more}[structure]{after}");
    setting.plant.model = Model::parse(&text, Path::new("many.toml")).expect("a plant");
    let bench = serve(setting);
    let (mut driver, mut other) = (bench.page(), bench.page());
    driver.run();
    driver.send(&json!({ "id": 900, "do": "apply", "values": { "kp": 0.5 } }));
    driver.send(&json!({ "id": 901, "do": "play", "text": "zero" }));
    other.order("stop").expect("anybody may stop");
    let state = other.until("both", |message| {
        let events = message["events"].to_string();
        events.contains("stopped: by hand") && events.contains("Kp")
    });
    let text = state["events"].to_string();
    assert!(text.find("stopped: by hand") < text.find("Kp"), "{text}");
    // Whatever else was asked meanwhile is told why it must wait.
    let mut reply = |id: u64| driver.until("a reply", |message| message["kind"] == "reply" && message["id"] == id);
    assert_eq!(reply(900)["ok"], true);
    assert!(reply(901)["text"].as_str().is_some_and(|text| text.contains("margins")));
    other.mode("idle");
}

#[test]
fn a_stack_without_negative_volts_gets_no_set_of_zeros() {
    let mut setting = setting("models/thesis-phs.toml", Box::new(|| Ok(Box::new(InProcess::nucleo()))));
    if let Some(rig) = &mut setting.plant.model.rig {
        rig.drive_min_v.value = 0.0;
    }
    let bench = serve(setting);
    let mut page = bench.page();
    for what in ["take-control", "arm"] {
        page.order(what).expect(what);
    }
    assert!(page.order("experiments").is_err_and(|line| line.contains("stands 0 to 90 V")));
}

#[test]
fn a_recording_that_every_page_has_left_ends() {
    let bench = in_process();
    let mut page = bench.page();
    page.run();
    page.record("left");
    drop(page);
    ends_by_itself(&bench, "left");
    let mut next = bench.page();
    next.until("no recording", |message| message["kind"] == "status" && message["recording"].is_null());
    next.event("the recording was left by every page, and ends");
}

/// A fault is no rest that anybody ends by hand: nobody is there.
#[test]
fn a_recording_in_a_fault_that_every_page_has_left_ends() {
    let bench = in_process();
    drop(tripped(&bench, "left"));
    ends_by_itself(&bench, "left");
    let mut next = bench.page();
    next.event("the recording was left by every page, and ends");
    next.until("at rest", |message| message["kind"] == "status" && message["mode"] == "fault");
}

/// Its folder is taken away: what is to be written at the end has no place.
#[cfg(target_os = "linux")]
#[test]
fn a_recording_that_cannot_be_ended_well_is_said_so() {
    let bench = in_process();
    let mut page = bench.page();
    page.run();
    page.record("gone");
    // Bench and plant would begin anew in the middle of it.
    assert!(page.order("add-effect").is_err_and(|line| line.contains("end the recording first")));
    std::fs::remove_dir_all(bench.runs.join("gone")).expect("ours");
    assert!(page.order("end-record").is_err_and(|line| line.contains("cannot be written")));
    page.mode("idle");
}

/// A link to a board that outlives it, while it is not cut.
#[derive(Clone)]
struct Standing {
    board: Arc<Mutex<InProcess>>,
    is_cut: Arc<AtomicBool>,
}

impl Standing {
    fn board(&self) -> std::sync::MutexGuard<'_, InProcess> {
        self.board.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Link for Standing {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        if self.is_cut.load(Ordering::Relaxed) { Err(LinkError::Closed) } else { self.board().send(bytes) }
    }

    fn receive(&mut self, patience: Duration, into: &mut Vec<u8>) -> Result<(), LinkError> {
        self.board().receive(patience, into)
    }

    fn now(&mut self) -> Duration {
        self.board().now()
    }

    fn patience(&self) -> Duration {
        self.board().patience()
    }
}

/// Who records in open loop on that board next would take the page's limits for its own.
#[test]
fn a_board_has_its_own_limits_again_after_a_refusal_a_cut_and_the_end() {
    let link = Standing { board: Arc::new(Mutex::new(InProcess::nucleo())), is_cut: Arc::default() };
    let set_to = || Session::new(link.clone()).parameters().expect("a board in process");
    let own = set_to();
    let narrow = |kp_times: f32| {
        let link = link.clone();
        let mut setting = setting("models/thesis-phs.toml", Box::new(move || Ok(Box::new(link.clone()))));
        setting.controller.1.drive_max_v = 50.0;
        setting.controller.1.kp_v_per_m *= kp_times;
        setting
    };
    let unstable = narrow(100.0);
    let refused_runs = unstable.runs.clone();
    assert!(matches!(Engine::start(unstable), Err(StartError::Unstable(_))));
    assert_eq!(set_to(), own, "a refused loop");

    let engine = Engine::start(narrow(1.0)).expect("a stable loop");
    let runs = engine.runs.clone();
    assert_eq!(set_to().drive_max_v, 50.0);
    let runtime = tokio::runtime::Builder::new_current_thread().build().expect("a runtime");
    let ask = |wish| runtime.block_on(engine.ask(wish));
    // What a board comes back with is the page's.
    link.is_cut.store(true, Ordering::Relaxed);
    assert!(ask(Wish::Run).is_err_and(|line| line.contains("look after cable")));
    link.is_cut.store(false, Ordering::Relaxed);
    ask(Wish::Reconnect).expect("it is back");
    assert_eq!(set_to().drive_max_v, 50.0);
    ask(Wish::Leave).expect("it is there");
    assert_eq!(set_to(), own, "the end");

    // One that is gone keeps them, and whoever ends it is told.
    let engine = Engine::start(narrow(1.0)).expect("a stable loop");
    let lost_runs = engine.runs.clone();
    link.is_cut.store(true, Ordering::Relaxed);
    let ask = |wish| runtime.block_on(engine.ask(wish));
    assert!(ask(Wish::Run).is_err_and(|line| line.contains("look after cable")));
    let told = ask(Wish::Leave);
    assert!(told.as_ref().is_err_and(|line| line.starts_with("the board was lost, and may keep")), "{told:?}");
    for folder in [refused_runs, runs, lost_runs] {
        let _ = std::fs::remove_dir_all(folder);
    }
}

#[test]
fn a_link_that_loses_frames_is_counted_and_no_reason_to_stop() {
    let switch = Arc::new(AtomicU64::new(0));
    let bench = start(cut(&switch));
    let mut page = bench.page();
    page.order("take-control").expect("it is free");
    // One frame in seven: samples, orders and the waveform's parts alike.
    switch.store(7, Ordering::Relaxed);
    for turn in 0..5 {
        page.ask(json!({ "do": "play", "text": "zero@0.01s+sine:20um@50Hz,for=1s" })).expect("a SPEC");
        for what in ["arm", "run"] {
            page.order(what).unwrap_or_else(|error| panic!("{what} in turn {turn}: {error}"));
        }
        page.mode("running");
        page.ask(json!({ "do": "play", "text": "sine:20um@100Hz" })).expect("while it runs");
        page.ask(json!({ "do": "apply", "values": { "kp": 0.5 + 0.01 * f64::from(turn) } })).expect("a stable loop");
        let status = page.until("losses", |message| message["link"]["lost"].as_u64().is_some_and(|lost| lost > 10));
        assert_eq!(status["lost"], Value::Null);
        page.order("stop").expect("heard at last");
        page.mode("idle");
    }
}

#[test]
fn a_watcher_that_reads_nothing_loses_frames_and_holds_nobody_up() {
    let bench = in_process();
    let (mut fast, mut slow) = (bench.page(), bench.page());
    // Every sample: a megabyte a second, far more than a socket's buffers hold.
    slow.send(&json!({ "do": "view", "length": 1 }));
    slow.send(&json!({ "do": "want", "span": 100_000, "spectrum": true }));
    fast.run();
    let time = |message: &Value| message["time_s"].as_f64().unwrap_or(0.0);
    let from = time(&fast.until("a status", |message| message["kind"] == "status"));
    fast.until("ten seconds", |message| message["kind"] == "status" && time(message) > from + 10.0);
    let own = fast.until("its own", |message| message["kind"] == "page");
    assert_eq!(own["lost_samples"], 0, "{own}");
    // Its stop waits for no picture.
    slow.send(&json!({ "do": "stop" }));
    fast.mode("idle");
    // What was on its way comes first; then it is told what it missed.
    slow.until("losses", |message| {
        message["lost_frames"].as_u64().is_some_and(|n| n > 10)
            && message["lost_samples"].as_u64().is_some_and(|n| n > 0)
    });
    // It is still there, and heard.
    slow.order("runs").expect("an answer");
}
