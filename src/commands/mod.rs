//! One file per command.

mod demo;
mod identify;
mod replay;
mod simulate;

pub use demo::demo;
pub use identify::identify;
pub use replay::replay;
pub use simulate::simulate;
