//! The flash images, built once for each test program, for the tests of every room that needs one.

use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

/// The folder that `cargo xtask firmware` built into; `None`, and said so, where there is no compiler for the chip.
pub fn folder() -> Option<PathBuf> {
    static FOLDER: OnceLock<Option<PathBuf>> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut command = Command::new(cargo);
        command.args(["run", "--quiet", "--package", "xtask", "--", "firmware"]);
        let output = command.output().expect("cargo xtask firmware starts");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "cargo xtask firmware: {}", String::from_utf8_lossy(&output.stderr));
        text.lines().last().and_then(|line| line.strip_prefix("firmware: ")).map(PathBuf::from)
    });
    if folder.is_none() {
        println!("not run: no compiler for thumbv7em-none-eabihf is here");
    }
    folder.clone()
}
