//! What the page tests share: a hostile name, looks into a page, and a real browser that opens one.

// Each test file takes what it needs of these.
#![allow(dead_code)]

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use gap_diagnosis::page::Page;

pub const HOSTILE: &str = "</script><script>document.documentElement.dataset.hacked=1</script><img src=x onerror=\"document.documentElement.dataset.hacked=2\"> \"quoted\" 'single' & \u{2028}";

/// A generous limit: a page takes two seconds on an idle core, and this machine may be building on all of them.
const PATIENCE: Duration = Duration::from_secs(120);

/// Every JSON block of the page, parsed.
pub fn drawings(html: &str) -> Vec<serde_json::Value> {
    html.split("<script type=\"application/json\">")
        .skip(1)
        .map(|rest| rest.split("</script>").next().unwrap_or_default())
        .map(|json| serde_json::from_str(json).expect("chart data are JSON"))
        .collect()
}

/// Nothing on the page may name another place: only uPlot's own banner has an address, in a comment.
pub fn assert_fetches_nothing(html: &str) {
    let banner = "/*! https://github.com/leeoniya/uPlot (v1.6.32) */";
    assert_eq!(html.matches(banner).count(), 1);
    let rest = html.replace(banner, "");
    for scheme in
        ["http://", "https://", "@import", "url(", "<iframe", "<object", "XMLHttpRequest", "fetch(", "WebSocket"]
    {
        assert!(!rest.contains(scheme), "{scheme}");
    }
    assert!(html.contains("default-src 'none'"));
    assert_eq!(
        html.contains("<noscript>"),
        html.contains("<figure class=\"chart"),
        "plots need scripts, the rest does not"
    );
}

/// The document after its scripts and then `script` ran in a window `width` pixels wide; `None` where there is no browser.
/// Fails on any message that the browser reports as an error.
pub fn dom_after(name: &str, page: &Page, width: u32, script: &str) -> Option<String> {
    let Some(browser) = browser() else {
        eprintln!("not run: no chromium on this machine");
        return None;
    };
    let directory = std::env::temp_dir().join(format!("hysteron-browser-{name}-{width}-{}", std::process::id()));
    std::fs::create_dir_all(&directory).expect("temporary directory");
    let path = directory.join("page.html");
    let html = page.to_html();
    let nonce = attribute(&html, "<style nonce").to_owned();
    let probed = html.replace("</body>", &format!("<script nonce=\"{nonce}\">{{ {script} }}</script></body>"));
    std::fs::write(&path, probed).expect("page written");

    // No window of chromium is narrower than 500 pixels, a frame is; the page tells the frame's owner what it has to tell.
    let is_framed = script.contains("postMessage");
    let shown = if is_framed { directory.join("frame.html") } else { path };
    if is_framed {
        let listen = "onmessage = event => { document.documentElement.dataset.heard = event.data; }";
        let frame = format!(
            "<script>{listen}</script><iframe style='border:0' width={width} height=1600 src=page.html></iframe>"
        );
        std::fs::write(&shown, format!("<!DOCTYPE html><meta charset=utf-8><link rel=icon href=data:,>{frame}"))
            .expect("frame written");
    }

    let output = directory.join("stdout");
    let errors = directory.join("stderr");
    let mut child = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--enable-logging=stderr"])
        .arg(format!("--user-data-dir={}", directory.join("profile").display()))
        .args([format!("--window-size={width},1600"), "--virtual-time-budget=2000".to_owned(), "--dump-dom".to_owned()])
        .arg(format!("file://{}", shown.display()))
        .stdout(Stdio::from(std::fs::File::create(&output).expect("file for the document")))
        .stderr(Stdio::from(std::fs::File::create(&errors).expect("file for the log")))
        .spawn()
        .expect("the browser starts");
    let started = Instant::now();
    while child.try_wait().expect("the browser can be asked").is_none() {
        if started.elapsed() > PATIENCE {
            child.kill().expect("the browser can be stopped");
            child.wait().expect("the browser ended");
            panic!("the browser took more than {} s", PATIENCE.as_secs());
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let dom = std::fs::read_to_string(&output).expect("a document in UTF-8");
    let log = String::from_utf8_lossy(&std::fs::read(&errors).expect("a log")).into_owned();
    std::fs::remove_dir_all(&directory).expect("removed");

    assert!(dom.contains("</html>"), "no document; the browser said: {log}");
    let complaints: Vec<&str> = log.lines().filter(|line| line.contains("CONSOLE")).collect();
    assert!(complaints.is_empty(), "{complaints:?}");
    assert!(!dom.contains("data-error"), "{}", attribute(&dom, "data-error"));
    Some(dom)
}

fn browser() -> Option<PathBuf> {
    let directories = std::env::var_os("PATH")?;
    std::env::split_paths(&directories)
        .flat_map(|directory| ["chromium", "chromium-browser", "google-chrome"].map(|name| directory.join(name)))
        .find(|path: &PathBuf| Path::is_file(path))
}

/// The first value of `name="..."`.
pub fn attribute<'a>(html: &'a str, name: &str) -> &'a str {
    let start = format!("{name}=\"");
    html.split(&start).nth(1).and_then(|rest| rest.split('"').next()).unwrap_or_default()
}
