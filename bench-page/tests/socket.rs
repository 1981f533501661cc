//! The server over its socket, without a browser: who is let in, who may move the bench, and how a run ends when a page or a board is gone.
//!
//! Nothing here waits for a time to pass and then looks: each test reads what the server sends until it says what is expected.

use bench_page::engine::{Engine, Open, Setting, Source};
use bench_page::server::Server;
use control_core::Settings;
use hil_bridge::in_process::InProcess;
use hil_bridge::link::{Link, LinkError, Place};
use plant_sim::controller::Controller;
use plant_sim::model::Model;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Error, Message, WebSocket};

/// A server on a free port; it ends with the test's process.
struct Bench {
    host: String,
    token: String,
    runs: PathBuf,
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.runs);
    }
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

fn start(open: Open) -> Bench {
    static BENCHES: AtomicUsize = AtomicUsize::new(0);
    let number = BENCHES.fetch_add(1, Ordering::Relaxed);
    let runs = std::env::temp_dir().join(format!("hysteron-socket-{}-{number}", std::process::id()));
    std::fs::create_dir_all(&runs).expect("a temporary folder");
    let path = file("models/thesis-phs.toml");
    let plant = Source {
        name: "thesis-phs.toml".into(),
        bytes: std::fs::read(&path).expect("ours"),
        model: Model::read(&path).expect("ours"),
    };
    let settings: Settings = Controller::read(&file("controllers/pi1.toml")).expect("ours").settings(20e3);
    let setting = Setting {
        place: Place::InProcess,
        open,
        clear_fault: false,
        rate_hz: 20e3,
        seed: 1,
        plant,
        bench: None,
        controller: ("pi1.toml".into(), settings),
        runs: runs.clone(),
    };
    let server = Server::bind("127.0.0.1:0".parse().expect("an address")).expect("a free port");
    let address = server.address();
    let (host, token) = address.strip_prefix("http://").and_then(|rest| rest.split_once("/#token=")).expect("both");
    let bench = Bench { host: host.to_owned(), token: token.to_owned(), runs };
    let engine = Engine::start(setting).expect("a board in process");
    std::thread::spawn(move || server.serve(engine));
    bench
}

fn in_process() -> Bench {
    start(Box::new(|| Ok(Box::new(InProcess::nucleo()))))
}

/// A page's end of the socket.
struct Client {
    socket: WebSocket<TcpStream>,
    next: u32,
    beats: bool,
}

impl Bench {
    fn connect(&self, origin: &str) -> Result<WebSocket<TcpStream>, String> {
        let stream = TcpStream::connect(&self.host).expect("a port");
        stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a timeout");
        let mut request = format!("ws://{}/socket", self.host).into_client_request().expect("an address");
        if !origin.is_empty() {
            request.headers_mut().insert("Origin", origin.parse().expect("a header"));
        }
        match tungstenite::client(request, stream) {
            Ok((socket, _)) => Ok(socket),
            Err(error) => Err(error.to_string()),
        }
    }

    fn open(&self, token: &str) -> (Client, Value) {
        let socket = self.connect(&format!("http://{}", self.host)).expect("our own origin");
        let mut client = Client { socket, next: 1, beats: true };
        client.send(&json!({ "token": token }));
        let first = client.message();
        (client, first)
    }

    fn page(&self) -> Client {
        let (client, first) = self.open(&self.token);
        assert_eq!(first["kind"], "hello");
        client
    }

    fn get(&self, path: &str, headers: &str) -> String {
        let mut stream = TcpStream::connect(&self.host).expect("a port");
        write!(stream, "GET {path} HTTP/1.1\r\nConnection: close\r\n{headers}\r\n").expect("sent");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("an answer");
        answer
    }
}

impl Client {
    fn send(&mut self, value: &Value) {
        self.socket.send(Message::text(value.to_string())).expect("the server listens");
    }

    /// The next text; frames are passed over.
    fn message(&mut self) -> Value {
        loop {
            if let Message::Text(text) = self.socket.read().expect("the server speaks") {
                let value: Value = serde_json::from_str(&text).expect("JSON");
                if value["kind"] == "status" && self.beats {
                    self.send(&json!({ "do": "beat" }));
                }
                return value;
            }
        }
    }

    /// Reads on until a message is as wanted.
    fn until(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        for _ in 0..2000 {
            let message = self.message();
            if wanted(&message) {
                return message;
            }
        }
        panic!("never: {what}");
    }

    fn mode(&mut self, mode: &str) {
        self.until(mode, |message| message["kind"] == "status" && message["mode"] == mode);
    }

    /// Asks; the answer's words, `Err` where it was refused.
    fn ask(&mut self, mut request: Value) -> Result<String, String> {
        self.next += 1;
        let id = self.next;
        request["id"] = id.into();
        self.send(&request);
        let reply = self.until("a reply", |message| message["kind"] == "reply" && message["id"] == id);
        let text = reply["text"].as_str().unwrap_or_default().to_owned();
        if reply["ok"] == true { Ok(text) } else { Err(text) }
    }

    fn order(&mut self, what: &str) -> Result<String, String> {
        self.ask(json!({ "do": what }))
    }

    /// Takes control and runs a step.
    fn run(&mut self) {
        for what in ["take-control", "arm", "run"] {
            self.order(what).expect(what);
        }
        self.mode("running");
    }

    /// Waits for an event whose words hold `part`.
    fn event(&mut self, part: &str) {
        let has = |message: &Value| {
            let events = message["events"].as_array();
            events.is_some_and(|events| events.iter().any(|e| e["text"].as_str().is_some_and(|t| t.contains(part))))
        };
        self.until(part, has);
    }
}

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
        assert_eq!(first["kind"], "refused");
        assert!(first["reason"].as_str().is_some_and(|reason| reason.contains("earlier start")), "{first}");
        assert!(matches!(client.socket.read(), Ok(Message::Close(_)) | Err(_)));
    }
    // Nor does one that asks before it has shown any.
    let socket = bench.connect(&format!("http://{}", bench.host)).expect("our own origin");
    let mut client = Client { socket, next: 1, beats: true };
    client.send(&json!({ "id": 1, "do": "arm" }));
    assert_eq!(client.message()["kind"], "refused");
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
        (json!({ "do": "apply", "values": { "kp": -1 } }), "outside"),
        (json!({ "do": "apply", "values": { "kp": 19 } }), "unstable"),
        (json!({ "do": "apply", "values": { "reference_max": 130 } }), "trip_m"),
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

#[test]
fn a_fault_is_named_and_left_by_hand() {
    let bench = in_process();
    let mut page = bench.page();
    // 70 V hold the bender at 132 um: beyond the trip of 120 um.
    page.order("take-control").expect("it is free");
    page.ask(json!({ "do": "play", "text": "hold:70V" })).expect("a SPEC");
    for what in ["arm", "run"] {
        page.order(what).expect(what);
    }
    page.until("the fault", |message| message["kind"] == "status" && message["fault"] == "displacement trip");
    assert!(page.order("arm").is_err());
    page.order("clear-fault").expect("at 0 V");
    page.mode("idle");
}

/// A link that is cut by a switch.
struct Cut {
    link: InProcess,
    is_cut: Arc<AtomicBool>,
}

impl Link for Cut {
    fn send(&mut self, bytes: &[u8]) -> Result<(), LinkError> {
        if self.is_cut.load(Ordering::Relaxed) { Err(LinkError::Closed) } else { self.link.send(bytes) }
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

#[test]
fn a_board_that_is_gone_is_said_and_asked_back() {
    let is_cut = Arc::new(AtomicBool::new(false));
    let switch = is_cut.clone();
    let bench = start(Box::new(move || Ok(Box::new(Cut { link: InProcess::nucleo(), is_cut: switch.clone() }))));
    let mut page = bench.page();
    page.run();
    page.ask(json!({ "do": "record", "name": "cut" })).expect("room on the disk");
    page.until("rows", |message| message["recording"]["rows"].as_u64().is_some_and(|rows| rows > 100));
    is_cut.store(true, Ordering::Relaxed);
    let lost = page.until("lost", |message| message["kind"] == "status" && message["mode"] == "no board");
    assert!(lost["lost"].as_str().is_some_and(|line| line.contains("look after cable")), "{lost}");
    let log = std::fs::read_to_string(bench.runs.join("cut/log.csv")).expect("a log");
    assert!(log.lines().count() > 100 && log.ends_with('\n'), "what came before is whole");
    assert!(page.order("arm").is_err_and(|line| line.contains("reconnect")));
    assert!(page.order("reconnect").is_err(), "it is still cut");
    is_cut.store(false, Ordering::Relaxed);
    page.order("reconnect").expect("it is back");
    page.mode("idle");
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
    // What was on its way comes first; then it is told what it missed.
    slow.until("losses", |message| {
        message["lost_frames"].as_u64().is_some_and(|n| n > 10)
            && message["lost_samples"].as_u64().is_some_and(|n| n > 0)
    });
    assert!(matches!(slow.socket.read(), Ok(_) | Err(Error::Io(_))));
}
