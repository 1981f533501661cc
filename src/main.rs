//! The hysteron command.
fn main() {}
