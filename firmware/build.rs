//! Hands the repository's linker map to the linker, and states the commit that the image is built from.

use std::path::PathBuf;
use std::process::Command;
use std::{env, fs};

fn main() {
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy("../memory.x", out.join("memory.x")).expect("the repository's memory.x");
    println!("cargo:rustc-link-search={}", out.display());
    // -Tlink.x comes from the root's .cargo/config.toml; defmt's section is only this image's business.
    println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    // Without a level defmt leaves out all but errors.
    println!("cargo:rustc-env=DEFMT_LOG=info");
    println!("cargo:rerun-if-changed=../memory.x");
    println!("cargo:rerun-if-changed=build.rs");
    // The same sources give the same bytes: no time and no path, only the commit where there is one.
    let commit = Command::new("git").args(["rev-parse", "--short=9", "HEAD"]).output().ok();
    let commit =
        commit.filter(|output| output.status.success()).and_then(|output| String::from_utf8(output.stdout).ok());
    println!("cargo:rustc-env=HYSTERON_COMMIT={}", commit.as_deref().unwrap_or("no commit").trim());
    if let Some(head) = git_head() {
        println!("cargo:rerun-if-changed={head}");
    }
}

/// The file that changes with every commit, wherever this checkout keeps it.
fn git_head() -> Option<String> {
    let output = Command::new("git").args(["rev-parse", "--git-path", "logs/HEAD"]).output().ok()?;
    let path = String::from_utf8(output.stdout).ok()?.trim().to_owned();
    PathBuf::from(&path).exists().then_some(path)
}
