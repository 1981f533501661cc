//! Builds the flash image, says with which compiler and where it lies; flashes it where asked to.

use crate::bare::{self, TARGET, Toolchain};
use crate::project::{Outcome, Project, is_there, passes};
use anyhow::{Result, bail};
use std::path::PathBuf;

/// Where it is built: own folders, because two compilers in one would rebuild each other's work.
fn folder(toolchain: Toolchain) -> &'static str {
    match toolchain {
        Toolchain::Rustup => "target/firmware-rustup",
        Toolchain::Debian => "target/firmware-debian",
    }
}

/// Builds every image. The last line is the folder they lie in, for who runs this.
pub fn build(project: &Project, wanted: Option<Toolchain>) -> Result<Outcome> {
    if !project.root.join("firmware/Cargo.toml").exists() {
        return Ok(Outcome::NotRun("firmware/ does not exist here".into()));
    }
    let Some(toolchain) = bare::choose_here(project, wanted)? else {
        return Ok(Outcome::NotRun(format!("no compiler for {TARGET} here: `cargo xtask setup` installs one")));
    };
    println!("firmware: with {}", bare::described(toolchain));
    let mut command = bare::command(project, toolchain);
    command.args(["build", "--release", "--locked", "--manifest-path", "firmware/Cargo.toml"]);
    command.args(["--target", TARGET, "--target-dir", folder(toolchain)]);
    if toolchain == Toolchain::Debian {
        command.arg("-Zbuild-std=core");
    }
    passes(&mut command)?;
    println!("firmware: {}", images(project, toolchain).display());
    Ok(Outcome::Passed)
}

/// Builds twice, in two folders, and compares the files byte for byte.
pub fn twice(project: &Project) -> Result<Outcome> {
    let Some(toolchain) = bare::choose_here(project, None)? else {
        return Ok(Outcome::NotRun(format!("no compiler for {TARGET} here")));
    };
    build(project, Some(toolchain))?;
    let again = project.root.join("target/firmware-again");
    let mut command = bare::command(project, toolchain);
    command.args(["build", "--release", "--locked", "--manifest-path", "firmware/Cargo.toml", "--target", TARGET]);
    command.arg("--target-dir").arg(&again);
    if toolchain == Toolchain::Debian {
        command.arg("-Zbuild-std=core");
    }
    passes(&mut command)?;
    for board in ["nucleo-g474re", "external-16bit"] {
        let first = std::fs::read(images(project, toolchain).join(board))?;
        let second = std::fs::read(again.join(TARGET).join("release").join(board))?;
        if first != second {
            bail!("{board}: two builds of the same sources differ");
        }
        println!("firmware: {board}: {} bytes, the same twice", first.len());
    }
    Ok(Outcome::Passed)
}

fn images(project: &Project, toolchain: Toolchain) -> PathBuf {
    project.root.join(folder(toolchain)).join(TARGET).join("release")
}

/// Builds and flashes one image with probe-rs, which the user has installed.
pub fn flash(project: &Project, board: &str) -> Result<Outcome> {
    if !is_there(project.command("probe-rs").arg("--version")) {
        bail!("probe-rs is not installed: `cargo install probe-rs-tools --locked`, then plug the board in");
    }
    let Some(toolchain) = bare::choose_here(project, None)? else {
        bail!("no compiler for {TARGET} here: `cargo xtask setup` installs one");
    };
    build(project, Some(toolchain))?;
    let image = images(project, toolchain).join(board);
    if !image.exists() {
        bail!("no image for a board {board:?}: the files in firmware/src/bin name the boards");
    }
    passes(project.command("probe-rs").args(["run", "--chip", "STM32G474RETx"]).arg(image))
}
