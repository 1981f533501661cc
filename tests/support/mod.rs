//! What the whole-path tests share: the command as a process, a folder for each test, and logs to feed it.
//!
//! Each test program compiles this anew and uses a part of it.
#![allow(dead_code, reason = "each test program uses a part of this module")]

mod flash_image;

use control_core::ModeName;
use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Whether what costs more than a minute is run: with HYSTERON_LONG=1 (`cargo xtask long`). If not, `what` is said not to be.
pub fn is_long(what: &str) -> bool {
    if !is_long_tier() {
        println!("not run: {what} (dear; HYSTERON_LONG=1 or cargo xtask long runs it)");
    }
    is_long_tier()
}

fn is_long_tier() -> bool {
    std::env::var_os("HYSTERON_LONG").is_some()
}

/// Of cases that each cost a diagnosis the first, or all with HYSTERON_LONG=1 (`cargo xtask long`).
pub fn asked<T, const N: usize>(cases: [T; N]) -> impl Iterator<Item = T> {
    let most = if is_long_tier() { N } else { 1 };
    cases.into_iter().take(most)
}

/// The workspace's root.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The thesis' plant and controllers.
pub const PLANT: &str = "models/thesis-phs.toml";
pub const PI1: &str = "controllers/pi1.toml";

/// Runs the command from the workspace's root.
pub fn hysteron<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hysteron"));
    command.current_dir(root()).args(arguments).output().expect("the command starts")
}

/// Runs the command with the words of `line`; `@/` in a word stands for the folder.
pub fn run(folder: &Folder, line: &str) -> Output {
    hysteron(line.split_whitespace().map(|word| folder.fill_in(word)))
}

/// A folder of a test, gone when the test passes or fails.
pub struct Folder(pub PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("hysteron-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).expect("a temporary folder");
        Self(path)
    }

    /// `text` with the folder's path for each `@/`.
    pub fn fill_in(&self, text: &str) -> String {
        text.replace("@/", &format!("{}/", self.0.display()))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::write(&path, content).expect("a file in a temporary folder");
        path
    }

    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Names of all files, hidden ones too, in order.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).expect("a temporary folder");
        let mut names: Vec<String> =
            entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A process that does not outlive its test.
pub struct Kept(pub Child);

impl Kept {
    /// Waits for what it is to bring about before it ends.
    pub fn until(&mut self, is_there: impl Fn() -> bool) {
        while !is_there() {
            assert!(self.0.try_wait().expect("a child").is_none(), "it ended by itself");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The command with the words of `line` as a process, what it says kept.
pub fn spawned(folder: &Folder, line: &str) -> Kept {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hysteron"));
    command.current_dir(root()).args(line.split_whitespace().map(|word| folder.fill_in(word)));
    Kept(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the command starts"))
}

/// `board serve` with more arguments, and where a host finds the board.
pub fn served(image: &str, more: &[&str]) -> (Kept, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hysteron"));
    command.current_dir(root()).args(["board", "serve", image, "--plant", PLANT]).args(more);
    let mut server = Kept(command.stdout(Stdio::piped()).spawn().expect("the command starts"));
    let mut said = String::new();
    let mut out = BufReader::new(server.0.stdout.take().expect("piped"));
    out.read_line(&mut said).expect("where it serves");
    let place = said.trim().strip_prefix("serving at ").expect("a place").to_owned();
    (server, place)
}

/// What the command printed on standard error.
pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("standard error is text")
}

/// What the command printed on standard output.
pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("standard output is text")
}

/// Asserts success and gives what was printed on standard error, warnings at most.
pub fn succeeded(output: &Output) -> String {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    said
}

/// The JSON object that the command printed: one line, each number finite or null.
pub fn json(output: &Output) -> serde_json::Map<String, serde_json::Value> {
    let said = stdout(output);
    assert_eq!(said.lines().count(), 1, "{said}{}", stderr(output));
    // JSON has no NaN and no infinity: a text that parses has none.
    match serde_json::from_str(&said) {
        Ok(serde_json::Value::Object(map)) => map,
        other => panic!("{other:?}: {said}"),
    }
}

/// A number of such an object.
pub fn number(map: &serde_json::Map<String, serde_json::Value>, key: &str) -> f64 {
    map.get(key).and_then(serde_json::Value::as_f64).unwrap_or_else(|| panic!("{key} in {map:?}"))
}

/// A good log: `rows` rows at 1 kHz, a sine of 30 V and 25 Hz through a gain of 1.9 um/V.
pub fn good_csv(rows: usize) -> String {
    let mut text = "# rate_hz: 1000\ntime_s,command_V,displacement_um\n".to_owned();
    for row in 0..rows {
        let command_v = 30.0 * (std::f64::consts::TAU * 25.0 * row as f64 / 1e3).sin();
        text.push_str(&format!("{:.3},{command_v:.6},{:.6}\n", row as f64 / 1e3, 1.9 * command_v));
    }
    text
}

/// A column of a CSV log by its name.
pub fn column(csv: &str, name: &str) -> Vec<f64> {
    let mut lines = csv.lines().filter(|line| !line.starts_with('#'));
    let header = lines.next().expect("a header");
    let index = header.split(',').position(|column| column == name).unwrap_or_else(|| panic!("{name} in {header}"));
    lines.map(|line| line.split(',').nth(index).and_then(|cell| cell.parse().ok()).expect("a number")).collect()
}

/// Where the image lies; `None`, and said so, where there is no compiler for the chip.
pub fn image() -> Option<String> {
    Some(flash_image::folder()?.join("nucleo-g474re").display().to_string())
}

/// Answers everything that comes in with `answer`, or hangs up.
pub fn impostor(answer: Option<Vec<u8>>) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    std::thread::spawn(move || {
        let Ok((mut host, _)) = listener.accept() else { return };
        let mut bytes = [0; 512];
        while host.read(&mut bytes).is_ok_and(|n| n > 0) {
            match &answer {
                Some(answer) if host.write_all(answer).is_ok() => {}
                _ => return,
            }
        }
    });
    format!("tcp:{address}")
}

/// An identity as a board of `firmware` sends it.
pub fn identity(firmware: &str) -> Vec<u8> {
    let identity = wire::Identity {
        version: wire::VERSION,
        board: "nucleo-g474re",
        firmware,
        converters: wire::Converters::NUCLEO_G474RE,
        reference_step_m: 1e-9,
        table_samples: 4096,
        segments: 16,
        capture_samples: 0,
    };
    frame(&mut wire::Sender::default(), &wire::ToHost::Identity(identity))
}

/// A message as a board sends it.
pub fn frame(sender: &mut wire::Sender, message: &wire::ToHost<'_>) -> Vec<u8> {
    let mut bytes = [0; wire::MAX_ENCODED_BYTES];
    let n = sender.encode(message, &mut bytes).expect("room");
    bytes[..n].to_vec()
}

/// A board that says no more than who and how it is, until it is told to stop, and whether it was.
pub fn fake_board(firmware: &'static str, mode: ModeName, fault: u8) -> (String, Arc<AtomicBool>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address");
    let was_stopped = Arc::new(AtomicBool::new(false));
    let is_stopped = Arc::clone(&was_stopped);
    std::thread::spawn(move || {
        let Ok((mut host, _)) = listener.accept() else { return };
        let (mut receiver, mut sender) = (wire::Receiver::new(), wire::Sender::default());
        let mut bytes = [0; 512];
        while let Ok(n @ 1..) = host.read(&mut bytes) {
            for byte in &bytes[..n] {
                let Some(Ok(heard)) = receiver.push(*byte) else { continue };
                let answer = match heard.message::<wire::ToBoard<'_>>() {
                    Ok(wire::ToBoard::Hello) => identity(firmware),
                    Ok(wire::ToBoard::KeepAlive) => {
                        let mode = if is_stopped.load(Ordering::Relaxed) { ModeName::Idle } else { mode };
                        frame(&mut sender, &wire::ToHost::Status(status(mode, fault)))
                    }
                    Ok(wire::ToBoard::GetParameters) => {
                        frame(&mut sender, &wire::ToHost::Parameters(wire::Parameters::NUCLEO_PI1))
                    }
                    Ok(wire::ToBoard::Stop) => {
                        is_stopped.store(true, Ordering::Relaxed);
                        frame(&mut sender, &wire::ToHost::Done { sequence: heard.sequence })
                    }
                    _ => continue,
                };
                if host.write_all(&answer).is_err() {
                    return;
                }
            }
        }
    });
    (format!("tcp:{address}"), was_stopped)
}

/// How a board in this mode is that drives its own pins.
fn status(mode: ModeName, fault: u8) -> wire::Status {
    wire::Status {
        mode: mode as u8,
        fault,
        reset: wire::ResetCause::PowerOn,
        input: wire::InputSource::Analog,
        samples: 7,
        overruns: 0,
        lost_samples: 0,
        ready_cycles: 0,
        ready_max_cycles: 0,
        bad_frames: 0,
    }
}

/// The binary on the words of `line`, under a limit of 64 KB for any file it writes: as on a disk that is full, without filling one. It says one
/// line and ends with code 2, and what it handed over to `run/log.csv` before is whole; returns that log.
#[cfg(target_os = "linux")]
pub fn run_on_a_full_disk(folder: &Folder, line: &str) -> String {
    let words: Vec<String> = line.split_whitespace().map(|word| folder.fill_in(word)).collect();
    let script = format!("trap '' XFSZ; ulimit -f 128; exec \"$0\" {}", words.join(" "));
    let output = Command::new("bash")
        .current_dir(root())
        .args(["-c", &script, env!("CARGO_BIN_EXE_hysteron")])
        .output()
        .expect("bash");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("log.csv: no row can be added") && said.lines().count() == 1, "{said}");
    let log = folder.read("run/log.csv");
    assert!(log.len() > 30_000 && log.ends_with('\n'), "{}", log.len());
    log
}
