//! What the socket's tests share: a server over a board in process, and a page's end of its socket.
//!
//! Each test program compiles this anew and uses a part of it.
#![allow(dead_code, reason = "each test program uses a part of this module")]

use bench_page::engine::{Engine, Open, Setting, Source};
use bench_page::server::Server;
use control_core::Settings;
use hil_bridge::in_process::InProcess;
use hil_bridge::link::Place;
use plant_sim::controller::Controller;
use plant_sim::model::Model;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

/// A server on a free port; it ends with the test's process.
pub struct Bench {
    pub host: String,
    pub token: String,
    pub runs: PathBuf,
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.runs);
    }
}

pub fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

pub fn start(open: Open) -> Bench {
    serve(setting("models/thesis-phs.toml", open))
}

pub fn serve(setting: Setting) -> Bench {
    let runs = setting.runs.clone();
    let server = Server::bind("127.0.0.1:0".parse().expect("an address")).expect("a free port");
    let address = server.address();
    let (host, token) = address.strip_prefix("http://").and_then(|rest| rest.split_once("/#token=")).expect("both");
    let bench = Bench { host: host.to_owned(), token: token.to_owned(), runs };
    let engine = Engine::start(setting).expect("a board in process");
    std::thread::spawn(move || server.serve(engine));
    bench
}

/// PI 1 on a board in process, in a folder of its own.
pub fn setting(model: &str, open: Open) -> Setting {
    static BENCHES: AtomicUsize = AtomicUsize::new(0);
    let number = BENCHES.fetch_add(1, Ordering::Relaxed);
    let runs = std::env::temp_dir().join(format!("hysteron-socket-{}-{number}", std::process::id()));
    std::fs::create_dir_all(&runs).expect("a temporary folder");
    let path = file(model);
    let plant = Source {
        name: model.to_owned(),
        bytes: std::fs::read(&path).expect("ours"),
        model: Model::read(&path).expect("ours"),
    };
    let settings: Settings = Controller::read(&file("controllers/pi1.toml")).expect("ours").settings(20e3);
    Setting {
        place: Place::InProcess,
        open,
        patience: None,
        clear_fault: false,
        rate_hz: 20e3,
        seed: 1,
        plant,
        bench: None,
        controller: ("pi1.toml".into(), settings),
        image: None,
        runs,
    }
}

pub fn in_process() -> Bench {
    start(Box::new(|| Ok(Box::new(InProcess::nucleo()))))
}

/// A page's end of the socket.
pub struct Client {
    pub socket: WebSocket<TcpStream>,
    pub next: u32,
    pub beats: bool,
}

impl Bench {
    pub fn connect(&self, origin: &str) -> Result<WebSocket<TcpStream>, String> {
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

    pub fn open(&self, token: &str) -> (Client, Value) {
        let socket = self.connect(&format!("http://{}", self.host)).expect("our own origin");
        let mut client = Client { socket, next: 1, beats: true };
        client.send(&json!({ "token": token }));
        let first = client.message();
        (client, first)
    }

    pub fn page(&self) -> Client {
        let (client, first) = self.open(&self.token);
        assert_eq!(first["kind"], "hello");
        client
    }

    pub fn get(&self, path: &str, headers: &str) -> String {
        let mut stream = TcpStream::connect(&self.host).expect("a port");
        write!(stream, "GET {path} HTTP/1.1\r\nConnection: close\r\n{headers}\r\n").expect("sent");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("an answer");
        answer
    }
}

impl Client {
    pub fn send(&mut self, value: &Value) {
        self.socket.send(Message::text(value.to_string())).expect("the server listens");
    }

    /// The next text; frames are passed over.
    pub fn message(&mut self) -> Value {
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
    pub fn until(&mut self, what: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        for _ in 0..2000 {
            let message = self.message();
            if wanted(&message) {
                return message;
            }
        }
        panic!("never: {what}");
    }

    pub fn mode(&mut self, mode: &str) {
        self.until(mode, |message| message["kind"] == "status" && message["mode"] == mode);
    }

    /// Asks; the answer's words, `Err` where it was refused.
    pub fn ask(&mut self, mut request: Value) -> Result<String, String> {
        self.next += 1;
        let id = self.next;
        request["id"] = id.into();
        self.send(&request);
        let reply = self.until("a reply", |message| message["kind"] == "reply" && message["id"] == id);
        let text = reply["text"].as_str().unwrap_or_default().to_owned();
        if reply["ok"] == true { Ok(text) } else { Err(text) }
    }

    pub fn order(&mut self, what: &str) -> Result<String, String> {
        self.ask(json!({ "do": what }))
    }

    /// Takes control and runs a step.
    pub fn run(&mut self) {
        for what in ["take-control", "arm", "run"] {
            self.order(what).expect(what);
        }
        self.mode("running");
    }

    /// Begins a recording that has rows.
    pub fn record(&mut self, name: &str) {
        self.ask(json!({ "do": "record", "name": name })).expect("room on the disk");
        self.until("rows", |message| message["recording"]["rows"].as_u64().is_some_and(|rows| rows > 100));
    }

    /// Waits for an event whose words hold `part`.
    pub fn event(&mut self, part: &str) {
        let has = |message: &Value| {
            let events = message["events"].as_array();
            events.is_some_and(|events| events.iter().any(|e| e["text"].as_str().is_some_and(|t| t.contains(part))))
        };
        self.until(part, has);
    }
}
