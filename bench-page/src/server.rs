//! The page's server: a few files, and one socket a page. It asks the engine and passes on what that publishes.
//!
//! | address | what |
//! | --- | --- |
//! | `/`, `/page.css`, `/*.js` | the page; nothing in it is secret |
//! | `/socket` | all else; its first message is the token |
//! | `/report/TICKET/report.html` | the last diagnosis; the ticket is told over the socket |
//!
//! Everything runs in one thread beside the engine's. What a page says is heard whatever is on its way to it: a stop waits for no picture. While a
//! frame is on its way the next ones are left out, and a page that takes nothing for half a minute is gone.

use crate::access::{Gate, Token};
use crate::ending::asked_to_end;
use crate::engine::{CHANNEL_TABLE, Engine, Wish};
use crate::lease::{Lease, PageId};
use crate::watch::{FRAMES, Trigger, Watch, past, points, spectrum, spectrum_samples};
use crate::{parameters, runs};
use axum::Router;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use futures_util::stream::SplitStream;
use futures_util::{Sink, SinkExt, StreamExt};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::VecDeque;
use std::future::{IntoFuture, pending};
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener};
use std::path::Path as FilePath;
use std::pin::Pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{Semaphore, mpsc};
use tokio::time::{MissedTickBehavior, interval, timeout};

/// The page's files: address, type, content.
const FILES: &[(&str, &str, &str)] = &[
    ("/", "text/html; charset=utf-8", include_str!("../assets/page.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("../assets/page.css")),
    ("/page.js", "text/javascript; charset=utf-8", include_str!("../assets/page.js")),
    ("/bench.js", "text/javascript; charset=utf-8", include_str!("../assets/bench.js")),
    ("/draw.js", "text/javascript; charset=utf-8", include_str!("../assets/draw.js")),
    ("/scope.js", "text/javascript; charset=utf-8", include_str!("../assets/scope.js")),
    ("/side.js", "text/javascript; charset=utf-8", include_str!("../assets/side.js")),
    ("/panels.js", "text/javascript; charset=utf-8", include_str!("../assets/panels.js")),
];
/// The page may load its own files and speak to its own server, nothing else; no page may frame it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; \
     base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The report's page states by a nonce what it may run; here it is only kept apart from the bench's page.
const REPORT_POLICY: &str = "sandbox allow-scripts; frame-ancestors 'none'";

/// How long a new page may take to show its token.
const TOKEN_TIME: Duration = Duration::from_secs(5);
/// How long a message may be on its way before the page counts as gone: a network that is lost closes no socket.
const SENDING_TIME: Duration = Duration::from_secs(30);
/// Answers that a page may ask for without listening to them.
const MOST_UNHEARD: usize = 256;
/// Longest message of a page; the longest is a set of parameters.
const MOST_BYTES: usize = 1 << 16;
/// Frames between two statuses, loops and spectra.
const STATUS_EVERY: u64 = 3;
const SPECTRUM_EVERY: u64 = 15;
/// Pages at once; more than a lab has screens.
const MOST_PAGES: usize = 32;
/// Orders of one page that may wait for the engine's answer; stops may be twice as many, so that what came before keeps none back.
const MOST_ORDERS: usize = 8;
/// To a page that goes on asking while the engine is silent.
const NO_ANSWERS: &str = "the engine has not answered what this page asked before: wait, or use the wired stop";
/// Lists and comparisons that one page may wait for; they are read one after another.
const MOST_READS: usize = 4;
/// Lists and comparisons that are read at once for all pages: the log of ten minutes takes half a gigabyte.
const READS_AT_ONCE: usize = 2;
/// How often the lease is looked at.
const LEASE_LOOK: Duration = Duration::from_millis(200);
/// Time in which a board is at 0 V by the slowest ramp that it takes, 10 s, and has said so.
const LEAVE_WITHIN: Duration = Duration::from_secs(15);

/// What the sockets share.
struct Served {
    engine: Engine,
    gate: Gate,
    lease: Mutex<Lease>,
    reads: Arc<Semaphore>,
    since: Instant,
    pages: AtomicU64,
}

impl Served {
    fn lease(&self) -> MutexGuard<'_, Lease> {
        self.lease.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A server that has its port and does not answer yet.
pub struct Server {
    listener: TcpListener,
    at: SocketAddr,
    token: Token,
}

impl Server {
    /// Takes a port.
    ///
    /// # Errors
    /// The port can't be had.
    pub fn bind(address: SocketAddr) -> io::Result<Server> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let at = listener.local_addr()?;
        Ok(Server { listener, at, token: Token::draw() })
    }

    /// What to open in a browser. The token is in the fragment, which a browser sends to nobody.
    pub fn address(&self) -> String {
        let mut at = self.at;
        // No browser opens the address that stands for all of them.
        match at.ip() {
            IpAddr::V4(Ipv4Addr::UNSPECIFIED) => at.set_ip(Ipv4Addr::LOCALHOST.into()),
            IpAddr::V6(Ipv6Addr::UNSPECIFIED) => at.set_ip(Ipv6Addr::LOCALHOST.into()),
            _ => {}
        }
        format!("http://{at}/#token={}", self.token.text())
    }

    /// Serves until the process is asked to end; then the board is left idle.
    ///
    /// # Errors
    /// The port is lost.
    pub fn serve(self, engine: Engine) -> io::Result<()> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let served = runtime.block_on(async {
            let served = Arc::new(Served {
                engine,
                gate: Gate::new(self.at, self.token),
                lease: Mutex::default(),
                reads: Arc::new(Semaphore::new(READS_AT_ONCE)),
                since: Instant::now(),
                pages: AtomicU64::new(1),
            });
            tokio::spawn(watch_lease(served.clone()));
            let listener = tokio::net::TcpListener::from_std(self.listener)?;
            let engine = served.engine.clone();
            tokio::select! {
                served = axum::serve(listener, router(served)).into_future() => served,
                () = asked_to_end() => left_in_order(engine.ask(Wish::Leave), LEAVE_WITHIN).await,
            }
        });
        // Of runs that are being read for a comparison nobody waits for the end.
        runtime.shutdown_background();
        served
    }
}

/// Waits until the board is `left` in order, unless that fails, takes too long or the process is asked to end once more.
async fn left_in_order(left: impl Future<Output = Result<String, String>>, within: Duration) -> io::Result<()> {
    let why = tokio::select! {
        left = left => match left {
            Ok(_) => return Ok(()),
            Err(error) => error,
        },
        () = asked_to_end() => "it was asked to end once more".to_owned(),
        () = tokio::time::sleep(within) => format!("the board was not left within {within:?}"),
    };
    Err(io::Error::other(format!(
        "{why}; a board that misses this program ramps to 0 V by itself: look whether it is there"
    )))
}

fn router(served: Arc<Served>) -> Router {
    let mut router = Router::new().route("/socket", get(socket)).route("/report/{ticket}/report.html", get(report));
    for (address, kind, content) in FILES {
        router = router.route(address, get(move || async move { ([(header::CONTENT_TYPE, *kind)], *content) }));
    }
    router.layer(from_fn_with_state(served.clone(), guard)).with_state(served)
}

/// Host and Origin of every request, and what every answer carries.
async fn guard(State(served): State<Arc<Served>>, request: Request, next: Next) -> Response {
    let is_socket = request.uri().path() == "/socket";
    let headers = request.headers();
    let text = |name| headers.get(name).and_then(|value: &HeaderValue| value.to_str().ok());
    // A header that is no text is as wrong as a foreign one.
    let origin = headers.get(header::ORIGIN).map(|value| value.to_str().unwrap_or("?"));
    let host = text(header::HOST);
    let checked = served.gate.check_host(host).and_then(|()| served.gate.check_origin(origin, host, is_socket));
    let is_report = request.uri().path().starts_with("/report/");
    let mut response = match checked {
        Ok(()) => next.run(request).await,
        Err(refusal) => (StatusCode::FORBIDDEN, format!("{refusal}\n")).into_response(),
    };
    let headers = response.headers_mut();
    let mut set = |name, value| headers.insert(name, HeaderValue::from_static(value));
    set(header::X_CONTENT_TYPE_OPTIONS, "nosniff");
    set(header::REFERRER_POLICY, "no-referrer");
    set(header::CACHE_CONTROL, "no-store");
    set(header::CONTENT_SECURITY_POLICY, if is_report { REPORT_POLICY } else { POLICY });
    response
}

async fn report(State(served): State<Arc<Served>>, Path(ticket): Path<String>) -> Response {
    match served.engine.shared.found() {
        Some(found) if found.ticket == ticket => {
            ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], found.report.to_string()).into_response()
        }
        _ => (StatusCode::NOT_FOUND, "this report is not the last one: open it from the page\n").into_response(),
    }
}

async fn socket(State(served): State<Arc<Served>>, upgrade: WebSocketUpgrade) -> Response {
    upgrade.max_message_size(MOST_BYTES).max_frame_size(MOST_BYTES).on_upgrade(move |socket| page(socket, served))
}

/// Ends what a silent page began.
async fn watch_lease(served: Arc<Served>) {
    let mut look = interval(LEASE_LOOK);
    loop {
        look.tick().await;
        let lapsed = served.lease().lapse(served.since.elapsed());
        if lapsed {
            // What the answer is, the events say.
            let _ = served.engine.ask(Wish::Stop("the page that held control is silent")).await;
        }
    }
}

/// What a page may ask.
#[derive(Debug, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case")]
enum Asked {
    Beat,
    TakeControl,
    ReleaseControl,
    Arm,
    Run,
    Stop,
    ClearFault,
    Play { text: String },
    Apply { values: Map<String, Value> },
    Undo,
    Save { name: String },
    Load { name: String },
    Record { name: String },
    EndRecord,
    Experiments,
    Diagnose,
    AddEffect,
    Reconnect,
    View { length: u64 },
    Past { first: u64, length: u64, count: usize },
    Trigger { trigger: Option<Trigger> },
    Want { span: u64, spectrum: bool },
    Runs,
    Compare { names: Vec<String> },
}

/// Sends what a page is to get, until it takes nothing more.
async fn write(mut sink: impl Sink<Message> + Unpin, mut unsent: mpsc::Receiver<Message>) {
    while let Some(message) = unsent.recv().await {
        if !matches!(timeout(SENDING_TIME, sink.send(message)).await, Ok(Ok(()))) {
            return;
        }
    }
}

/// Counts a page as long as it is there.
struct Present(Arc<Served>);

impl Drop for Present {
    fn drop(&mut self) {
        self.0.engine.shared.watchers.fetch_sub(1, Ordering::Relaxed);
    }
}

/// One page, from its token to its end.
async fn page(mut socket: WebSocket, served: Arc<Served>) {
    if let Err(Refused { reason, is_final }) = greet(&mut socket, &served).await {
        let refused = json!({ "kind": "refused", "reason": reason, "is_final": is_final }).to_string();
        // Nobody is left to be told where this fails.
        let _ = socket.send(Message::Text(refused.into())).await;
        let _ = socket.send(Message::Close(None)).await;
        return;
    }
    served.engine.shared.watchers.fetch_add(1, Ordering::Relaxed);
    let present = Present(served.clone());
    let id = served.pages.fetch_add(1, Ordering::Relaxed);
    let mut page = Page {
        id,
        served: served.clone(),
        watch: Watch::new(&served.engine.shared.history()),
        span: 0,
        wants_spectrum: false,
        seen: 0,
        frames: 0,
        orders: VecDeque::new(),
        reads: VecDeque::new(),
    };
    let (sink, heard) = socket.split();
    let (sender, unsent) = mpsc::channel(1);
    let writer = tokio::spawn(write(sink, unsent));
    page.talk(heard, sender).await;
    writer.abort();
    drop(present);
    let had = served.lease().release(id);
    if had {
        let _ = served.engine.ask(Wish::Stop("the page that held control was closed")).await;
    }
}

/// Why a page is not let in.
struct Refused {
    reason: String,
    /// Asking again is no use: a stale token stays stale.
    is_final: bool,
}

/// The token, in time.
async fn greet(socket: &mut WebSocket, served: &Served) -> Result<(), Refused> {
    let for_now = |reason: String| Refused { reason, is_final: false };
    let first = timeout(TOKEN_TIME, socket.recv()).await.map_err(|_| for_now("no token came".to_owned()))?;
    let Some(Ok(Message::Text(text))) = first else {
        return Err(for_now("the first message must be the token".to_owned()));
    };
    let value: Value = serde_json::from_str(&text).unwrap_or_default();
    let offered = value["token"].as_str().unwrap_or_default();
    let checked = served.gate.check_token(offered);
    checked.map_err(|refusal| Refused { reason: refusal.to_string(), is_final: true })?;
    if served.engine.shared.watchers.load(Ordering::Relaxed) >= MOST_PAGES {
        return Err(for_now(format!("{MOST_PAGES} pages are open: close one")));
    }
    let channel = |(key, words, unit): &(&str, &str, &str)| json!({ "key": key, "words": words, "unit": unit });
    let hello = json!({
        "kind": "hello",
        "version": env!("CARGO_PKG_VERSION"),
        "rate_hz": served.engine.rate_hz,
        "channels": CHANNEL_TABLE.iter().map(channel).collect::<Vec<_>>(),
        "parameters": parameters::tree(),
        "limits": control_core::Limits::from_bits(u8::MAX).words().collect::<Vec<_>>(),
        "runs": served.engine.runs.display().to_string(),
        "time_samples": served.engine.shared.history().end(),
    });
    socket.send(Message::Text(hello.to_string().into())).await.map_err(|error| for_now(error.to_string()))
}

/// An answer that is there later.
type Later = Pin<Box<dyn Future<Output = Message> + Send>>;

/// The answer that was asked for first; never, where none is awaited. Left before its end, it loses nothing.
async fn first(awaited: &mut VecDeque<Later>) -> Message {
    match awaited.front_mut() {
        Some(later) => {
            let message = later.await;
            awaited.pop_front();
            message
        }
        None => pending().await,
    }
}

/// One page's state here.
struct Page {
    id: PageId,
    served: Arc<Served>,
    watch: Watch,
    /// Samples of the loop plot; 0 for none.
    span: u64,
    wants_spectrum: bool,
    /// Version of what changes seldom that the page has.
    seen: u64,
    frames: u64,
    /// Answers of the engine.
    orders: VecDeque<Later>,
    /// Answers out of files; each is begun when the one before is there.
    reads: VecDeque<Later>,
}

impl Page {
    async fn talk(&mut self, mut heard: SplitStream<WebSocket>, sender: mpsc::Sender<Message>) {
        let mut unsent = VecDeque::new();
        let mut frames = interval(Duration::from_secs(1) / FRAMES);
        // A page that was slow gets the next frame when it is due, not all that it missed.
        frames.set_missed_tick_behavior(MissedTickBehavior::Skip);
        loop {
            tokio::select! {
                message = heard.next() => match message {
                    Some(Ok(Message::Text(text))) => unsent.extend(self.answer(&text)),
                    Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                    Some(Ok(Message::Binary(_) | Message::Close(_)) | Err(_)) | None => return,
                },
                permit = sender.reserve(), if !unsent.is_empty() => match (permit, unsent.pop_front()) {
                    (Ok(permit), Some(message)) => permit.send(message),
                    // The writer has given up.
                    _ => return,
                },
                answer = first(&mut self.orders) => unsent.push_back(answer),
                answer = first(&mut self.reads) => unsent.push_back(answer),
                _ = frames.tick() => {
                    let is_free = unsent.is_empty() && sender.capacity() > 0;
                    unsent.extend(if is_free { self.frame() } else { Vec::new() });
                }
            }
            if unsent.len() > MOST_UNHEARD {
                return;
            }
        }
    }

    /// What a tick brings.
    fn frame(&mut self) -> Vec<Message> {
        let mut messages = Vec::new();
        self.watch.tick(self.served.since.elapsed());
        self.frames += 1;
        let shared = &self.served.engine.shared;
        {
            let history = shared.history();
            messages.extend(self.watch.live(&history).map(binary));
            messages.extend(self.watch.capture(&history).map(binary));
            if self.span > 0 && self.frames.is_multiple_of(STATUS_EVERY) {
                messages.push(binary(points(&history, self.span)));
            }
        }
        if self.wants_spectrum && self.frames.is_multiple_of(SPECTRUM_EVERY) {
            let samples = spectrum_samples(&shared.history());
            messages.extend(spectrum(&samples, self.served.engine.rate_hz).map(binary));
        }
        if self.frames.is_multiple_of(STATUS_EVERY) {
            messages.push(Message::Text(shared.status().to_string().into()));
            let (version, state) = shared.state();
            if version != self.seen {
                self.seen = version;
                messages.push(Message::Text(state.to_string().into()));
            }
            messages.push(Message::Text(self.own().to_string().into()));
        }
        messages
    }

    /// What is this page's alone.
    fn own(&self) -> Value {
        let control = match self.served.lease().holder() {
            None => "none",
            Some(holder) if holder == self.id => "mine",
            Some(_) => "other",
        };
        json!({
            "kind": "page",
            "control": control,
            "watchers": self.served.engine.shared.watchers.load(Ordering::Relaxed),
            "lost_frames": self.watch.lost_frames,
            "lost_samples": self.watch.lost_samples,
        })
    }

    /// What is answered at once, and nothing where the answer comes later or none is wanted.
    fn answer(&mut self, text: &str) -> Option<Message> {
        let value: Value = serde_json::from_str(text).unwrap_or_default();
        // The number that the answer carries; a request without one gets it all the same.
        let id = value["id"].as_u64().and_then(|id| u32::try_from(id).ok()).unwrap_or(0);
        let asked = match Asked::deserialize(value) {
            Ok(asked) => asked,
            Err(error) => return Some(reply(id, Err(format!("not understood: {error}")), Value::Null)),
        };
        let done = match asked {
            Asked::Beat => {
                self.served.lease().beat(self.id, self.served.since.elapsed());
                return None;
            }
            Asked::TakeControl => {
                let taken = self.served.lease().take(self.id, self.served.since.elapsed());
                taken.map(|()| "this page holds control".to_owned()).map_err(|error| error.to_string())
            }
            Asked::Stop | Asked::ReleaseControl if self.orders.len() >= 2 * MOST_ORDERS => Err(NO_ANSWERS.to_owned()),
            Asked::ReleaseControl => {
                let had = self.served.lease().release(self.id);
                let free = || Ok("control is free".to_owned());
                if had {
                    // How the stop went, the events say.
                    return self.order(Wish::Stop("control was released"), move |_| reply(id, free(), Value::Null));
                }
                free()
            }
            // Whoever sees that something is wrong may stop it.
            Asked::Stop => return self.order(Wish::Stop("by hand"), move |done| reply(id, done, Value::Null)),
            Asked::View { length } => {
                self.watch.set_length(length, &self.served.engine.shared.history());
                return None;
            }
            Asked::Past { first, length, count } => {
                return Some(binary(past(&self.served.engine.shared.history(), id, first, length, count)));
            }
            Asked::Trigger { trigger } => {
                let history = self.served.engine.shared.history();
                self.watch.set_trigger(trigger, &history).map(|()| "trigger".to_owned())
            }
            Asked::Want { span, spectrum } => {
                (self.span, self.wants_spectrum) = (span, spectrum);
                return None;
            }
            Asked::Runs | Asked::Compare { .. } if self.reads.len() >= MOST_READS => {
                Err(format!("{MOST_READS} lists and comparisons are being read: ask again when one is there"))
            }
            Asked::Runs => return self.read(id, |folder| Ok(json!(runs::list(folder)))),
            Asked::Compare { names } => {
                return self.read(id, move |folder| runs::compare(folder, &names).map(|runs| json!(runs)));
            }
            other => match wish(other) {
                Some(_) if !self.served.lease().is_held_by(self.id) => {
                    Err("this page watches: take control first".to_owned())
                }
                Some(_) if self.orders.len() >= MOST_ORDERS => Err(NO_ANSWERS.to_owned()),
                Some(wish) => return self.order(wish, move |done| reply(id, done, Value::Null)),
                None => Err("not understood".to_owned()),
            },
        };
        Some(reply(id, done, Value::Null))
    }

    /// Gives the engine an order at once; its answer goes to the page when it is there.
    fn order(
        &mut self,
        wish: Wish,
        answer: impl FnOnce(Result<String, String>) -> Message + Send + 'static,
    ) -> Option<Message> {
        let done = self.served.engine.ask(wish);
        self.orders.push_back(Box::pin(async move { answer(done.await) }));
        None
    }

    /// Reads in the folder of runs, beside the sockets' thread.
    fn read(
        &mut self,
        id: u32,
        work: impl FnOnce(&FilePath) -> Result<Value, String> + Send + 'static,
    ) -> Option<Message> {
        let (folder, reads) = (self.served.engine.runs.clone(), self.served.reads.clone());
        self.reads.push_back(Box::pin(async move {
            let permit = reads.acquire_owned().await;
            // A page that is gone does not end what was begun for it, so the permit goes along.
            let read = tokio::task::spawn_blocking(move || {
                let _permit = permit;
                work(&folder)
            });
            match read.await.unwrap_or_else(|error| Err(error.to_string())) {
                Ok(value) => reply(id, Ok(String::new()), value),
                Err(error) => reply(id, Err(error), Value::Null),
            }
        }));
        None
    }
}

/// What only the page that holds control may wish.
fn wish(asked: Asked) -> Option<Wish> {
    Some(match asked {
        Asked::Arm => Wish::Arm,
        Asked::Run => Wish::Run,
        Asked::ClearFault => Wish::ClearFault,
        Asked::Play { text } => Wish::Play(text),
        Asked::Apply { values } => Wish::Apply(values),
        Asked::Undo => Wish::Undo,
        Asked::Save { name } => Wish::Save(name),
        Asked::Load { name } => Wish::Load(name),
        Asked::Record { name } => Wish::Record(name),
        Asked::EndRecord => Wish::EndRecord,
        Asked::Experiments => Wish::Experiments,
        Asked::Diagnose => Wish::Diagnose,
        Asked::AddEffect => Wish::AddEffect,
        Asked::Reconnect => Wish::Reconnect,
        _ => return None,
    })
}

fn binary(bytes: Vec<u8>) -> Message {
    Message::Binary(bytes.into())
}

fn reply(id: u32, done: Result<String, String>, value: Value) -> Message {
    let (ok, text) = match done {
        Ok(text) => (true, text),
        Err(text) => (false, text),
    };
    Message::Text(json!({ "kind": "reply", "id": id, "ok": ok, "text": text, "value": value }).to_string().into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_waits_for_ever_for_a_board_that_is_left_and_one_that_cannot_be_is_told() {
        type Left = Pin<Box<dyn Future<Output = Result<String, String>>>>;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let is_left = |left: Left| runtime.block_on(left_in_order(left, Duration::from_millis(20)));
        assert!(is_left(Box::pin(std::future::ready(Ok("the board is idle".to_owned())))).is_ok());
        let lost = is_left(Box::pin(std::future::ready(Err("the board was lost".to_owned()))));
        let slow = is_left(Box::pin(pending()));
        for (left, words) in [(lost, "the board was lost; "), (slow, "the board was not left within 20ms; ")] {
            let why = left.unwrap_err().to_string();
            assert!(why.starts_with(words), "{why}");
        }
    }
}
