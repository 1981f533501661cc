//! Signals that ask this process to end: Ctrl-C and, where there is one, the signal to terminate. What becomes of them is for who listens.

use std::future::pending;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::runtime::{Builder, Runtime};
#[cfg(unix)]
use tokio::signal::unix::{Signal, SignalKind, signal};

/// A listener; from its making on none is missed.
struct Signals {
    #[cfg(unix)]
    both: [Signal; 2],
}

impl Signals {
    /// To be called within a runtime.
    fn new() -> io::Result<Signals> {
        Ok(Signals {
            #[cfg(unix)]
            both: [signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?],
        })
    }

    async fn one(&mut self) {
        #[cfg(unix)]
        {
            let [interrupt, terminate] = &mut self.both;
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
            }
        }
        #[cfg(not(unix))]
        let _ = tokio::signal::ctrl_c().await;
    }
}

/// Waits for one.
pub(crate) async fn asked_to_end() {
    match Signals::new() {
        Ok(mut signals) => signals.one().await,
        // Nothing listens, so that the system ends the process.
        Err(_) => pending().await,
    }
}

/// Listens from now on: sets `is_asked` at the first one, and at the second calls `again`, whatever is being done meanwhile.
///
/// # Errors
/// The system has no listener or no thread for it.
pub fn watch(is_asked: &'static AtomicBool, again: fn()) -> io::Result<()> {
    let runtime = Builder::new_current_thread().enable_all().build()?;
    let signals = {
        let _entered = runtime.enter();
        Signals::new()?
    };
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || listen(&runtime, signals, is_asked, again))
        .map(|_| ())
}

fn listen(runtime: &Runtime, mut signals: Signals, is_asked: &AtomicBool, again: fn()) {
    runtime.block_on(async {
        signals.one().await;
        is_asked.store(true, Ordering::Relaxed);
        signals.one().await;
    });
    again();
}
