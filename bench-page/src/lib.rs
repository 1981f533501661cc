//! The bench in a browser: a board in the loop with the simulated plant, watched, tuned, recorded and diagnosed on one page.
//!
//! | module | what it is |
//! | --- | --- |
//! | [`engine`] | the thread that keeps the loop going, and what may be asked of it |
//! | [`history`] | the samples, in bounded memory, as columns of any length |
//! | [`watch`] | what one page gets of them: frames, triggered captures, spectra; what a slow one loses |
//! | [`lease`] | who holds control |
//! | [`access`] | who may speak to the server at all |
//! | [`server`] | the page and its socket |
//! | [`parameters`] | the parameters in the page's units |
//! | [`recorder`], [`runs`] | run directories: made, listed, compared |
//! | [`diagnosis`] | a diagnosis beside the running loop |
//! | [`ending`] | signals that ask the process to end |
//!
//! What it does not do: control law, plant, link and diagnosis are other rooms'. It draws nothing but its page, loads nothing from
//! anywhere, and is no safety device: the wired stop is.
//!
//! A page's place in the stream needs neither server nor browser:
//!
//! ```
//! use bench_page::history::{CHANNELS, Column, History};
//! use bench_page::watch::Watch;
//!
//! let mut history = History::default();
//! let mut watch = Watch::new(&history);
//! watch.set_length(32, &history);
//! (0..1000).for_each(|k| history.push(&Column::of([k as f32; CHANNELS], 0)));
//! // 31 whole columns of 32 samples: least and greatest of each channel, and what limited it.
//! let frame = watch.live(&history).expect("a column is whole");
//! assert_eq!(frame.len(), 40 + 31 * (8 * CHANNELS + 1));
//! ```

pub mod access;
pub mod diagnosis;
pub mod ending;
pub mod engine;
pub mod history;
pub mod lease;
pub mod parameters;
pub mod recorder;
pub mod runs;
pub mod server;
pub mod watch;
