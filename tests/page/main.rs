//! `hysteron serve` as its user sees it: a page in a headless Chromium, from arming to a smaller gap; and calls that can't be meant.

mod browser;
#[path = "../support/mod.rs"]
mod support;

use browser::{Browser, chromium};
use serde_json::json;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use support::{Folder, PI1, PLANT, image, root, run, stderr};

/// A running server, ended when dropped.
struct Served {
    child: Child,
    /// The address that it printed.
    address: String,
}

impl Served {
    fn start(folder: &Folder, more: &str) -> Served {
        Served::start_by(Command::new(env!("CARGO_BIN_EXE_hysteron")), folder, more)
    }

    /// As [`Served::start`], by a program that ends in the command.
    fn start_by(mut command: Command, folder: &Folder, more: &str) -> Served {
        let words = format!("serve --plant {PLANT} --controller {PI1} --port 0 --runs @/runs {more}");
        command.current_dir(root()).args(words.split_whitespace().map(|word| folder.fill_in(word)));
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the command starts");
        let mut address = String::new();
        BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut address).expect("a first line");
        Served { child, address: address.trim().to_owned() }
    }

    fn host(&self) -> &str {
        self.address.strip_prefix("http://").and_then(|rest| rest.split('/').next()).expect("an address")
    }

    /// The first line and the rest of what an HTTP request is answered with.
    fn request(&self, path: &str, headers: &str) -> String {
        let mut stream = TcpStream::connect(self.host()).expect("a port");
        write!(stream, "GET {path} HTTP/1.1\r\nConnection: close\r\n{headers}\r\n").expect("sent");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("an answer");
        answer
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The nominal plant with noise and an effect that it lacks: creep of 12 %, as a model file.
fn bench(folder: &Folder) {
    let nominal = std::fs::read_to_string(root().join(PLANT)).expect("ours");
    let hidden = "\n[sensor]\nnoise_um = { value = 0.02, source = \"test\" }\n\n[[effect]]\nid = \"creep\"\nform = \"kelvin-voigt\"\n\
                  [effect.parameters]\nstiffness_ratio = { value = 0.12 }\ntime_constant_s = { value = 0.08 }\n";
    folder.write("bench.toml", nominal + hidden);
}

/// Where the pictures go, to be looked at.
fn pictures() -> PathBuf {
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page");
    std::fs::create_dir_all(&pictures).expect("room on the disk");
    pictures
}

/// Takes control again, should the browser have been too busy to keep it.
fn hold(page: &mut Browser) {
    page.wait("document.body.dataset.control === 'mine' || (document.getElementById('control').click(), false)", 20);
}

/// Chooses or types a value and leaves the field.
fn choose(page: &mut Browser, id: &str, value: &str) {
    page.eval(&format!(
        "(() => {{ const field = document.getElementById('{id}'); field.value = '{value}'; field.dispatchEvent(new Event('change')) }})()"
    ));
}

const MODE: &str = "document.getElementById('mode').textContent";

#[test]
fn a_bench_is_driven_tuned_recorded_diagnosed_and_its_gap_made_smaller() {
    let Some(program) = chromium() else {
        println!("not run: no chromium on this machine");
        return;
    };
    let folder = Folder::new("page");
    bench(&folder);
    let served = Served::start(&folder, "--bench @/bench.toml");
    let mut page = Browser::start(&program, &folder.path("profile"));
    let pictures = pictures();

    // Arm in two actions, and a step.
    page.open(&served.address);
    page.wait(&format!("{MODE} === 'idle'"), 20);
    assert_eq!(page.eval("document.getElementById('arm').disabled"), true, "a page that only watches moves nothing");
    page.click("control");
    page.fill("amplitude", "60");
    page.click("play");
    page.click("arm");
    page.wait(&format!("{MODE} === 'armed'"), 10);
    page.click("run");
    page.wait(&format!("{MODE} === 'running'"), 10);
    page.wait("Math.abs(Number(document.getElementById('now-displacement').textContent) - 60) < 0.5", 10);

    // A new SPEC and another Kp while it runs, recorded.
    page.fill("record-name", "tuned");
    page.click("record");
    page.wait("document.getElementById('recording').textContent.includes('rows')", 10);
    page.fill("spec", "sine:40um@20Hz");
    page.click("play");
    page.wait("document.getElementById('playing').textContent.includes('sine:40um@20Hz')", 10);
    page.fill("parameter-kp", "0.6");
    page.click("apply");
    page.wait("document.getElementById('events').textContent.includes('Kp 0.85811 -> 0.6 V/um')", 10);
    page.wait("!document.getElementById('undo').disabled", 10);
    page.picture(1280, 720, &pictures.join("running-1280.png"));
    page.eval("document.getElementById('theme').click()");
    page.picture(1920, 1080, &pictures.join("running-1920-other.png"));
    page.click("record");
    page.wait("document.getElementById('events').textContent.includes('rows in')", 10);

    // A capture with its past, cursors, and the other panels.
    page.fill("trigger-level", "20");
    page.click("single");
    page.wait("document.getElementById('scope-state').textContent.includes('captured')", 10);
    page.click("cursors");
    page.eval("document.querySelector('[data-tab=parameters]').click()");
    page.fill("parameter-ki", "0.5");
    page.picture(1280, 800, &pictures.join("capture-1280.png"));
    page.click("revert");
    page.click("cursors");
    page.click("pause");
    page.wait("document.getElementById('scope-state').textContent === 'live'", 10);
    // The wheel shortens the window, a drag pauses and goes back in time, P goes live.
    page.wheel([400.0, 300.0], -120.0);
    page.wait("document.getElementById('window').value < 0.2", 10);
    page.drag([300.0, 300.0], [500.0, 300.0]);
    page.wait("document.getElementById('scope-state').textContent.startsWith('paused')", 10);
    page.wheel([400.0, 300.0], -120.0);
    page.picture(1280, 800, &pictures.join("paused-1280.png"));
    page.eval("document.activeElement.blur()");
    page.key("p", 80);
    page.wait("document.getElementById('scope-state').textContent === 'live'", 10);

    // Escape stops from wherever the focus is.
    page.eval("document.getElementById('spec').focus()");
    page.key("Escape", 27);
    page.wait(&format!("{MODE} === 'idle'"), 10);
    let log = folder.read("runs/tuned/log.csv");
    assert!(log.lines().count() > 1000, "{}", log.lines().count());
    assert!(folder.read("runs/tuned/events.jsonl").contains("-> 0.6"), "what was done is beside the rows");

    // The experiment set, a diagnosis, the effect into the plant, the set again.
    page.eval("document.querySelector('[data-tab=diagnosis]').click()");
    hold(&mut page);
    page.click("arm");
    page.click("experiments");
    page.wait("document.getElementById('passes').dataset.gaps", 60);
    hold(&mut page);
    page.click("diagnose");
    page.wait("document.querySelector('.verdict')", 240);
    let found = page.eval("document.querySelector('.verdict').textContent");
    assert!(found.as_str().is_some_and(|sentence| sentence.contains("creep")), "{found}");
    page.picture(1280, 720, &pictures.join("diagnosis-1280.png"));
    page.eval("document.getElementById('theme').click()");
    page.picture(1920, 1080, &pictures.join("diagnosis-1920-other.png"));
    hold(&mut page);
    page.click("add-effect");
    page.click("arm");
    page.click("experiments");
    page.wait("document.getElementById('passes').dataset.gaps.split(' ').length === 2", 60);
    let gaps = page.eval("document.getElementById('passes').dataset.gaps.split(' ').map(Number)");
    let (before, after) = (gaps[0].as_f64().expect("a number"), gaps[1].as_f64().expect("a number"));
    // What stays is the sensor's noise of 20 nm and the converter's 18 nm, together 27 nm; the effect is a micrometre.
    assert!(after < 0.2 * before && after < 0.05, "{before} um, then {after} um");
    page.wait("document.getElementById('speed').textContent.startsWith('runs at')", 10);
    page.picture(1920, 1080, &pictures.join("after-1920.png"));

    // Two runs beside one another, and the link's histograms.
    page.eval("document.querySelector('[data-tab=runs]').click()");
    page.wait("document.querySelectorAll('#runs input').length >= 11", 10);
    page.eval("[...document.querySelectorAll('#runs tr')].filter(row => row.textContent.includes('held-out')).forEach(row => row.querySelector('input').click())");
    page.click("compare");
    page.wait("document.querySelectorAll('#compare-table tbody tr').length === 2", 20);
    page.picture(1280, 800, &pictures.join("compare-1280.png"));
    page.eval("document.getElementById('comparison').close()");
    page.picture(1280, 800, &pictures.join("runs-1280.png"));
    page.eval("document.querySelector('[data-tab=link]').click()");
    page.wait("document.getElementById('link').textContent.includes('round trip')", 10);
    page.picture(1280, 800, &pictures.join("link-1280.png"));

    // The report is where its link says, and the page never spoke to anybody else.
    let report = page.eval("document.querySelector('#found a').getAttribute('href')");
    let answer = served.request(report.as_str().expect("a link"), &format!("Host: {}\r\n", served.host()));
    assert!(answer.starts_with("HTTP/1.1 200") && answer.contains("Diagnosis of the bench"), "{answer:.300}");
    let asked =
        page.eval("performance.getEntriesByType('resource').every(entry => entry.name.startsWith(location.origin))");
    assert_eq!(asked, true);
    assert!(page.complaints.is_empty(), "{:?}", page.complaints);
    page.open(&format!("http://{}{}", served.host(), report.as_str().expect("a link")));
    page.wait("document.querySelectorAll('canvas').length > 3", 20);
    page.picture(1280, 800, &pictures.join("report-1280.png"));
    println!("pictures: {}", pictures.display());
}

/// The page's newest socket, to be cut by a test; and what its CSV button makes, without a file.
const HOOKS: &str = "window.WebSocket = class extends WebSocket { constructor(...all) { super(...all); window.newest = this; } }; \
    URL.createObjectURL = (blob) => { window.saved = blob; return 'data:,'; }; HTMLAnchorElement.prototype.click = () => {};";

/// Rows that the plots show.
const ROWS: &str = "(document.getElementById('export').click(), window.saved.text()).then((text) => text.trim().split('\\n').slice(1))";

#[test]
fn a_page_that_was_cut_off_goes_on_and_shows_no_old_value() {
    let Some(program) = chromium() else {
        println!("not run: no chromium on this machine");
        return;
    };
    let folder = Folder::new("page-cut");
    let served = Served::start(&folder, "");
    let mut page = Browser::start(&program, &folder.path("profile"));
    page.call("Page.enable", &json!({}));
    page.call("Page.addScriptToEvaluateOnNewDocument", &json!({ "source": HOOKS }));
    page.open(&served.address);
    for button in ["control", "arm", "run"] {
        page.click(button);
    }
    page.wait("Number(document.getElementById('now-reference').textContent) === 20", 10);
    let rows = |page: &mut Browser, wanted: &str| page.wait(&format!("{ROWS}.then((rows) => {wanted})"), 20);
    let last = "Number(rows.at(-1)?.split(',')[0])";
    rows(&mut page, &format!("rows.length > 100 && {last} > 4"));

    // No number of before stands there as if it were one of now; then the plots go on, and not with what came before alone.
    let cut = "new Promise((done) => { window.newest.addEventListener('close', () => setTimeout(() => done( \
               ['reference', 'displacement', 'drive', 'gap'].map((name) => document.getElementById(`now-${name}`).textContent).join('')))); \
               window.newest.close(); })";
    assert_eq!(page.eval(cut), "––––");
    page.wait(
        "document.getElementById('banner').hidden && document.getElementById('now-drive').textContent !== '–'",
        10,
    );
    page.eval("window.since = Infinity");
    rows(
        &mut page,
        &format!(
            "{{ window.since = Math.min(window.since, {last} || Infinity); return rows.length > 100 && {last} > window.since + 0.5; }}"
        ),
    );

    // A paused view that was being asked for is asked for again: two seconds back, of which the live columns know nothing since the cut.
    page.eval("document.activeElement.blur()");
    page.key("p", 80);
    rows(&mut page, "rows.length > 100");
    page.eval("(() => { for (let k = 0; k < 40; k++) window.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft' })); window.newest.close(); })()");
    rows(&mut page, "rows.length > 100");
    // Back to live with another window: that one, in its own columns. 10 ms are 200 samples.
    choose(&mut page, "window", "0.01");
    page.click("pause");
    rows(&mut page, "rows.length > 150");

    // A trigger that waits for what never comes waits for what it is changed to.
    hold(&mut page);
    page.fill("spec", "sine:20um@20Hz");
    page.click("play");
    for button in ["arm", "run"] {
        page.click(button);
    }
    page.fill("trigger-level", "1000");
    page.click("single");
    page.wait("document.getElementById('scope-state').textContent.startsWith('waiting')", 10);
    choose(&mut page, "trigger-level", "5");
    page.wait("document.getElementById('scope-state').textContent.includes('captured')", 10);

    // An emptied field stays empty while other things change; a thin margin is told where one looks.
    page.eval("document.querySelector('[data-tab=parameters]').click()");
    page.eval("document.getElementById('parameter-ki').focus()");
    page.fill("parameter-ki", "");
    page.fill("spec", "sine:10um@20Hz");
    page.click("play");
    page.wait("document.getElementById('playing').textContent.includes('10um')", 10);
    assert_eq!(page.eval("document.getElementById('parameter-ki').value"), "");
    page.fill("parameter-kp", "2");
    page.click("apply");
    page.wait("document.getElementById('message').title.includes('dB')", 10);

    // Enter ticks a box, Space stops also there.
    page.eval("document.getElementById('spectrum-on').focus()");
    page.key("Enter", 13);
    page.wait("!document.getElementById('spectrum-on').checked", 10);
    assert_eq!(page.eval(MODE), "running");
    page.key(" ", 32);
    page.wait(&format!("{MODE} === 'idle'"), 10);
    assert_eq!(page.eval("document.getElementById('spectrum-on').checked"), false);
    assert!(page.complaints.is_empty(), "{:?}", page.complaints);
}

#[test]
fn the_flash_image_over_tcp_is_driven_from_the_page() {
    let (Some(program), Some(image)) = (chromium(), image()) else {
        println!("not run: no chromium, or no compiler for the chip");
        return;
    };
    let folder = Folder::new("page-image");
    let mut board = Command::new(env!("CARGO_BIN_EXE_hysteron"))
        .current_dir(root())
        .args(["board", "serve", &image, "--plant", PLANT, "--pace", "lockstep"])
        .stdout(Stdio::piped())
        .spawn()
        .expect("the command starts");
    let mut line = String::new();
    BufReader::new(board.stdout.take().expect("a pipe")).read_line(&mut line).expect("a first line");
    let place = line.trim().strip_prefix("serving at ").expect("a place").to_owned();
    {
        let served = Served::start(&folder, &format!("--board tcp:{place}"));
        let mut page = Browser::start(&program, &folder.path("profile"));
        page.open(&served.address);
        page.wait(&format!("{MODE} === 'idle'"), 20);
        page.wait("document.getElementById('board').title.includes('firmware')", 10);
        page.click("control");
        page.fill("amplitude", "40");
        page.click("play");
        page.click("arm");
        page.click("run");
        page.wait("Math.abs(Number(document.getElementById('now-displacement').textContent) - 40) < 0.5", 30);
        page.fill("parameter-kp", "0.6");
        page.click("apply");
        page.wait("document.getElementById('events').textContent.includes('-> 0.6 V/um')", 20);
        // An emulated core is slower than wall time, and the page says so.
        page.wait("/runs at 0\\.0*[1-9]/.test(document.getElementById('speed').textContent)", 20);
        page.eval("document.querySelector('[data-tab=link]').click()");
        page.wait("document.getElementById('link').textContent.includes('cycles at most')", 10);
        page.picture(1280, 720, &pictures().join("image-1280.png"));
        // A board that is pulled out while the loop runs.
        board.kill().expect("it runs");
        page.wait(&format!("{MODE} === 'no board'"), 20);
        page.wait("document.getElementById('banner').textContent.startsWith('The board is lost')", 10);
    }
    board.wait().expect("it ended");
}

#[test]
fn calls_that_cannot_be_meant_are_one_line_and_an_exit_code() {
    let folder = Folder::new("serve-wrong");
    let taken = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let port = taken.local_addr().expect("a port").port();
    folder.write("file", "");
    let own = format!("serve --plant {PLANT} --controller {PI1} --runs @/runs");
    for (call, code, part) in [
        (format!("{own} --port {port}"), 2, "name another with --port"),
        (format!("{own} --port 0 --board tcp:127.0.0.1:1"), 2, "tcp:127.0.0.1:1"),
        (format!("{own} --port 0 --board serial:@/none"), 2, "plug the board in"),
        (format!("{own} --port 0 --board virtual"), 2, "--image"),
        (format!("{own} --port 0 --listen nowhere"), 2, "--listen"),
        (format!("{own} --port 0 --rate 12345"), 2, "rate"),
        (format!("{own} --port 0 --rate 5000"), 2, "unstable"),
        (format!("serve --plant {PLANT} --controller {PI1} --port 0 --runs @/file"), 2, "cannot be written"),
        (format!("serve --plant @/none.toml --controller {PI1} --port 0"), 3, "none.toml"),
        (
            format!("serve --plant {PLANT} --controller controllers/pi1-unlimited.toml --port 0 --runs @/runs"),
            2,
            "finite",
        ),
    ] {
        let output = run(&folder, &call);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{call}: {said}");
        assert!(said.contains(part) && said.lines().count() == 1, "{call}: {said}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_recording_in_one_line_and_stops_the_board() {
    let Some(program) = chromium() else {
        println!("not run: no chromium on this machine");
        return;
    };
    let folder = Folder::new("page-full");
    let mut bash = Command::new("bash");
    // 128 blocks for any file of this process: as a disk that is full, without filling one.
    bash.args(["-c", "trap '' XFSZ; ulimit -f 128; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_hysteron")]);
    let mut served = Served::start_by(bash, &folder, "");
    let mut page = Browser::start(&program, &folder.path("profile"));
    page.open(&served.address);
    for button in ["control", "record", "arm", "run"] {
        page.click(button);
    }
    page.wait("document.getElementById('events').textContent.includes('log.csv: no row can be added')", 20);
    page.wait(&format!("{MODE} === 'idle'"), 10);
    let log = folder.read("runs/run/log.csv");
    assert!(log.len() > 30_000 && log.ends_with('\n'), "{}", log.len());

    // A page of an earlier start is told that it is one.
    let stale = format!("http://{}/#token=0123456789abcdef0123456789abcdef", served.host());
    page.open(&stale);
    page.wait("document.getElementById('banner').textContent.includes('of an earlier start')", 10);

    // Space stops, too, but types in a text field; and the command leaves when it is asked to.
    page.open(&served.address);
    for button in ["control", "arm", "run"] {
        page.click(button);
    }
    page.eval("document.getElementById('record-name').focus()");
    page.key(" ", 32);
    page.wait(&format!("{MODE} === 'running'"), 10);
    page.eval("document.getElementById('record-name').blur()");
    page.key(" ", 32);
    page.wait(&format!("{MODE} === 'idle'"), 10);

    // A fault is named where one looks, and left by hand.
    page.fill("spec", "hold:70V");
    page.click("play");
    page.click("arm");
    page.click("run");
    page.wait("document.getElementById('fault').textContent === 'fault: displacement trip'", 10);
    page.picture(1280, 720, &pictures().join("fault-1280.png"));
    page.click("clear");
    page.wait(&format!("{MODE} === 'idle'"), 10);
    page.picture(800, 1200, &pictures().join("narrow-800.png"));
    page.key("?", 191);
    page.wait("document.getElementById('help').open", 10);
    page.picture(1280, 720, &pictures().join("keys-1280.png"));
    page.eval("document.getElementById('help').close()");
    let id = served.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().expect("kill").success());
    assert!(served.child.wait().expect("it ends").success());
    page.wait("document.getElementById('banner').textContent.includes('is lost')", 10);
}
