//! Builds the `no_std` rooms for the chip: the target has no `std`, so a build is the proof.

use crate::project::{Outcome, Project, is_there, output, passes};
use anyhow::{Result, bail};
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The chip's target.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Rooms that must build without `std`; those that don't exist yet are passed over.
const ROOMS: &[&str] = &["control-core", "wire"];

/// Debian's compiler and the sources of `core` that belong to it (packages rustc-web, cargo-web, rust-web-src).
const DEBIAN_CARGO: &str = "/usr/bin/cargo";
const DEBIAN_CORE: &str = "/usr/lib/rustlib/src/rust/library/core/Cargo.toml";

/// Where `core` for the chip comes from.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum Toolchain {
    /// rustup's ready-made target.
    Rustup,
    /// Debian's packages, which build `core` themselves: for machines that cannot reach rustup's server.
    Debian,
}

/// Builds every room of [`ROOMS`] and says which compiler did it.
pub fn build(project: &Project, wanted: Option<Toolchain>) -> Result<Outcome> {
    let Some(toolchain) = choose_here(project, wanted)? else {
        bail!(
            "no compiler for {TARGET} here: `cargo xtask setup` installs one (rustup's target, or Debian's packages)"
        );
    };
    let mut command = command(project, toolchain);
    // Own folders: two compilers in one would rebuild each other's work, and neither may wait for the host's builds.
    let folder = match toolchain {
        Toolchain::Rustup => "target/no-std-rustup",
        Toolchain::Debian => "target/no-std-debian",
    };
    command.args(["build", "--release", "--locked", "--target", TARGET, "--target-dir", folder]);
    if toolchain == Toolchain::Debian {
        command.arg("-Zbuild-std=core");
    }
    for room in ROOMS.iter().filter(|room| project.root.join(room).join("Cargo.toml").exists()) {
        command.args(["--package", room]);
    }
    println!("no-std: with {}", described(toolchain));
    passes(&mut command)
}

/// The compiler that is wanted, or the first of those that are here.
pub fn choose_here(project: &Project, wanted: Option<Toolchain>) -> Result<Option<Toolchain>> {
    Ok(choose(wanted, rustup_has_target(project)?, debian_has_core(project)))
}

/// The cargo that belongs to a compiler.
pub fn command(project: &Project, toolchain: Toolchain) -> Command {
    match toolchain {
        Toolchain::Rustup => project.cargo(),
        Toolchain::Debian => debian_cargo(project),
    }
}

fn choose(wanted: Option<Toolchain>, rustup: bool, debian: bool) -> Option<Toolchain> {
    let available = |toolchain: &Toolchain| match toolchain {
        Toolchain::Rustup => rustup,
        Toolchain::Debian => debian,
    };
    let order = wanted.map_or_else(|| vec![Toolchain::Rustup, Toolchain::Debian], |one| vec![one]);
    order.into_iter().find(available)
}

/// The compiler in words.
pub fn described(toolchain: Toolchain) -> &'static str {
    match toolchain {
        Toolchain::Rustup => "rustup's target",
        Toolchain::Debian => "Debian's cargo-web, rustc-web and rust-web-src",
    }
}

fn rustup_has_target(project: &Project) -> Result<bool> {
    let sysroot = output(project.command("rustc").args(["--print", "sysroot"]))?;
    Ok(Path::new(sysroot.trim()).join("lib/rustlib").join(TARGET).join("lib").is_dir())
}

fn debian_has_core(project: &Project) -> bool {
    Path::new(DEBIAN_CORE).exists() && is_there(project.command(DEBIAN_CARGO).arg("--version"))
}

/// Debian's cargo must find Debian's rustc, and none of what rustup's cargo tells the programs it runs.
fn debian_cargo(project: &Project) -> Command {
    let mut command = project.command(DEBIAN_CARGO);
    for (name, _) in std::env::vars_os() {
        let name_text = name.to_string_lossy();
        if name_text == "CARGO" || name_text.starts_with("CARGO_") || name_text.starts_with("RUSTUP_") {
            command.env_remove(&name);
        }
    }
    // Debian's rustc brings no linker for the chip along; rustup's toolchain for this machine does.
    if let Some(linker) = rustup_linker(project) {
        command.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", linker);
    }
    // -Zbuild-std is unstable; RUSTC_BOOTSTRAP lets the stable compiler take it. Only `core` is built, and only here.
    command.env("RUSTC_BOOTSTRAP", "1").env("PATH", format!("/usr/bin:{}", std::env::var("PATH").unwrap_or_default()));
    command
}

/// rust-lld, which lies beside rustup's standard library.
fn rustup_linker(project: &Project) -> Option<PathBuf> {
    let sysroot = output(project.command("rustc").args(["--print", "sysroot"])).ok()?;
    let targets = Path::new(sysroot.trim()).join("lib/rustlib").read_dir().ok()?;
    targets.flatten().map(|target| target.path().join("bin/rust-lld")).find(|linker| linker.exists())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rustup_comes_first_then_debian_then_a_clear_no() {
        assert_eq!(choose(None, true, true), Some(Toolchain::Rustup));
        assert_eq!(choose(None, false, true), Some(Toolchain::Debian));
        assert_eq!(choose(None, false, false), None);
    }

    #[test]
    fn a_wish_is_never_replaced_by_the_other() {
        assert_eq!(choose(Some(Toolchain::Debian), true, true), Some(Toolchain::Debian));
        assert_eq!(choose(Some(Toolchain::Debian), true, false), None);
    }
}
