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

/// The files of `firmware/src/bin` that are boards.
const BOARDS: [&str; 2] = ["nucleo-g474re", "external-16bit"];

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

/// Lints of the images, warnings denied; half a minute the first time. Debian's packages bring no clippy for the chip.
pub fn clippy(project: &Project) -> Result<Outcome> {
    if bare::choose_here(project, Some(Toolchain::Rustup))?.is_none() {
        return Ok(Outcome::NotRun(format!("lints of the flash images: rustup has no {TARGET} here")));
    }
    let mut command = bare::command(project, Toolchain::Rustup);
    command.args(["clippy", "--release", "--locked", "--manifest-path", "firmware/Cargo.toml"]);
    command.args(["--target", TARGET, "--target-dir", folder(Toolchain::Rustup), "--", "-D", "warnings"]);
    passes(&mut command)
}

/// Builds twice from nothing and compares the files byte for byte. In one folder, because debug information names it; what is flashed does
/// not depend on it.
pub fn twice(project: &Project) -> Result<Outcome> {
    let Some(toolchain) = bare::choose_here(project, None)? else {
        return Ok(Outcome::NotRun(format!("no compiler for {TARGET} here")));
    };
    let folder = project.root.join("target/firmware-twice");
    let mut seen: Vec<Vec<Vec<u8>>> = Vec::new();
    for _ in 0..2 {
        if folder.exists() {
            std::fs::remove_dir_all(&folder)?;
        }
        let mut command = bare::command(project, toolchain);
        command.args(["build", "--release", "--locked", "--manifest-path", "firmware/Cargo.toml", "--target", TARGET]);
        command.arg("--target-dir").arg(&folder);
        if toolchain == Toolchain::Debian {
            command.arg("-Zbuild-std=core");
        }
        passes(&mut command)?;
        let images = BOARDS.iter().map(|board| std::fs::read(folder.join(TARGET).join("release").join(board)));
        seen.push(images.collect::<Result<_, _>>()?);
    }
    for (k, board) in BOARDS.iter().enumerate() {
        if seen[0][k] != seen[1][k] {
            bail!("{board}: two builds of the same sources differ");
        }
        println!("firmware: {board}: {} bytes, the same twice", seen[0][k].len());
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
