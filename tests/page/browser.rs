//! A headless Chromium, driven over its DevTools socket. What it does not do: wait by the clock; it asks the page again until it is so.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

/// Chromium, if it is on the PATH.
pub fn chromium() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome"];
    std::env::split_paths(&path)
        .flat_map(|folder| names.map(|name| folder.join(name)))
        .find(|candidate| candidate.is_file())
}

/// A browser with one page, ended when dropped.
pub struct Browser {
    child: Child,
    socket: WebSocket<TcpStream>,
    session: String,
    next: u64,
    /// What the page's script threw, and what the browser complained of.
    pub complaints: Vec<String>,
}

impl Browser {
    /// Starts one; `profile` is a folder for it.
    pub fn start(program: &Path, profile: &Path) -> Browser {
        let mut child = Command::new(program)
            .args([
                "--headless",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--remote-debugging-port=0",
            ])
            .arg(format!("--user-data-dir={}", profile.display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("chromium starts");
        let mut lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
        let address = lines
            .by_ref()
            .map_while(Result::ok)
            .find_map(|line| line.strip_prefix("DevTools listening on ").map(str::to_owned))
            .expect("chromium says where its DevTools are");
        // What it says later must not fill the pipe.
        std::thread::spawn(move || lines.for_each(drop));
        let host = address.strip_prefix("ws://").and_then(|rest| rest.split('/').next()).expect("an address");
        let stream = TcpStream::connect(host).expect("a DevTools port");
        stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a timeout");
        let (socket, _) = tungstenite::client(address.as_str(), stream).expect("a DevTools socket");
        let mut browser = Browser { child, socket, session: String::new(), next: 0, complaints: Vec::new() };
        let target = browser.call("Target.createTarget", &json!({ "url": "about:blank" }))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", &json!({ "targetId": target, "flatten": true }));
        browser.session = attached["sessionId"].as_str().expect("a session").to_owned();
        for domain in ["Runtime.enable", "Log.enable"] {
            browser.call(domain, &json!({}));
        }
        browser
    }

    /// A DevTools call and its result.
    pub fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.next += 1;
        let mut call = json!({ "id": self.next, "method": method, "params": parameters });
        if !self.session.is_empty() {
            call["sessionId"] = self.session.clone().into();
        }
        self.socket.send(Message::text(call.to_string())).expect("chromium listens");
        loop {
            let Message::Text(text) = self.socket.read().expect("chromium answers") else { continue };
            let answer: Value = serde_json::from_str(&text).expect("JSON");
            let entry = &answer["params"]["entry"];
            if answer["method"] == "Runtime.exceptionThrown" {
                self.complaints.push(answer["params"]["exceptionDetails"].to_string());
            } else if answer["method"] == "Log.entryAdded" && entry["level"] == "error" {
                self.complaints.push(entry["text"].to_string());
            }
            if answer["id"] == self.next {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// Opens an address. Only its fragment may differ from the last one's, so it goes by an empty page.
    pub fn open(&mut self, address: &str) {
        self.call("Page.navigate", &json!({ "url": "about:blank" }));
        self.call("Page.navigate", &json!({ "url": address }));
    }

    /// What an expression is worth on the page.
    pub fn eval(&mut self, expression: &str) -> Value {
        let parameters = json!({ "expression": expression, "awaitPromise": true, "returnByValue": true });
        let result = self.call("Runtime.evaluate", &parameters);
        assert!(result.get("exceptionDetails").is_none(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression, or what it promises, is true.
    pub fn wait(&mut self, expression: &str, seconds: u64) {
        let until = Instant::now() + Duration::from_secs(seconds);
        loop {
            // While it loads, the page lacks what it will have.
            let guarded = format!(
                "(async () => {{ try {{ return Boolean(await ({expression})) }} catch {{ return false }} }})()"
            );
            if self.eval(&guarded) == true {
                return;
            }
            if Instant::now() > until {
                let said = self.eval("document.body.innerText");
                panic!("not so in {seconds} s: {expression}\non the page:\n{}", said.as_str().unwrap_or_default());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Clicks an element, once it can be.
    pub fn click(&mut self, id: &str) {
        self.wait(&format!("!document.getElementById('{id}').disabled"), 20);
        self.eval(&format!("document.getElementById('{id}').click()"));
    }

    /// Types into a field, as its listeners see it.
    pub fn fill(&mut self, id: &str, text: &str) {
        self.eval(&format!(
            "(() => {{ const field = document.getElementById('{id}'); field.value = '{text}'; \
             field.dispatchEvent(new Event('input', {{ bubbles: true }})) }})()"
        ));
    }

    /// Presses the mouse at a point of the window, moves it and lets it go.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        for (kind, [x, y]) in [("mousePressed", from), ("mouseMoved", to), ("mouseReleased", to)] {
            let parameters = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", &parameters);
        }
    }

    /// Turns the wheel at a point of the window.
    pub fn wheel(&mut self, [x, y]: [f64; 2], down: f64) {
        let parameters = json!({ "type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": down });
        self.call("Input.dispatchMouseEvent", &parameters);
    }

    /// Presses a key and lets it go.
    pub fn key(&mut self, key: &str, code: u32) {
        for kind in ["keyDown", "keyUp"] {
            let text = if kind == "keyDown" && key.len() == 1 { key } else { "" };
            let parameters = json!({ "type": kind, "key": key, "windowsVirtualKeyCode": code, "text": text });
            self.call("Input.dispatchKeyEvent", &parameters);
        }
    }

    /// Sets the window's size and keeps a picture of it in `file`.
    pub fn picture(&mut self, width: u32, height: u32, file: &Path) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.call("Emulation.setDeviceMetricsOverride", &size);
        // Two frames: one for the size, one for what is drawn at it.
        self.eval(
            "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 300))))",
        );
        let shot = self.call("Page.captureScreenshot", &json!({ "format": "png" }));
        std::fs::write(file, decoded(shot["data"].as_str().expect("a picture"))).expect("room on the disk");
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Closing it by its own call ends its helpers as well.
        let close = json!({ "id": 0, "method": "Browser.close" });
        let _ = self.socket.send(Message::text(close.to_string()));
        let until = Instant::now() + Duration::from_secs(5);
        while Instant::now() < until {
            if matches!(self.child.try_wait(), Ok(Some(_))) {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Bytes of a base64 text.
fn decoded(text: &str) -> Vec<u8> {
    let six = |byte: u8| match byte {
        b'A'..=b'Z' => u32::from(byte - b'A'),
        b'a'..=b'z' => u32::from(byte - b'a') + 26,
        b'0'..=b'9' => u32::from(byte - b'0') + 52,
        b'+' => 62,
        _ => 63,
    };
    let mut bytes = Vec::new();
    for four in text.trim_end_matches('=').as_bytes().chunks(4) {
        let word = four.iter().enumerate().fold(0, |word, (k, byte)| word | six(*byte) << (18 - 6 * k));
        bytes.extend(&word.to_be_bytes()[1..four.len()]);
    }
    bytes
}
