//! Where the project lies and how this tool starts other programs.

use anyhow::{Context, Result, bail};
use serde_json::Value;
use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// How a check ended when it did not fail; a failure is an `Err`.
#[derive(Debug, PartialEq)]
pub enum Outcome {
    /// It ran to its end.
    Passed,
    /// Something optional is missing here; the text says what. Never silent, never a failure.
    NotRun(String),
}

/// The checkout this tool works on.
pub struct Project {
    /// Folder of the workspace's `Cargo.toml`.
    pub root: PathBuf,
    cargo: PathBuf,
}

impl Project {
    /// Cargo tells a program it runs where its package lies; the compile-time value serves when the binary is started by hand.
    pub fn find() -> Result<Self> {
        let package =
            env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
        let root = package.parent().context("xtask/ has no parent folder")?.to_owned();
        let cargo = env::var_os("CARGO").map_or_else(|| "cargo".into(), PathBuf::from);
        Ok(Project { root, cargo })
    }

    /// A command in the project's root that reads nothing from the terminal, so that CI and a developer see the same.
    pub fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        command.current_dir(&self.root).stdin(Stdio::null());
        command
    }

    /// The cargo that runs this tool.
    pub fn cargo(&self) -> Command {
        self.command(&self.cargo)
    }

    /// The workspaces of this repository that exist: the host's first, then those that build apart.
    pub fn manifests(&self) -> Vec<PathBuf> {
        let all = ["Cargo.toml", "firmware/Cargo.toml", "benches/Cargo.toml"];
        all.iter().map(|path| self.root.join(path)).filter(|path| path.exists()).collect()
    }

    /// `cargo metadata` of one workspace, without its dependencies: needs no network.
    pub fn metadata(&self, manifest: &Path) -> Result<Value> {
        let text = output(
            self.cargo().args(["metadata", "--no-deps", "--format-version", "1", "--manifest-path"]).arg(manifest),
        )?;
        serde_json::from_str(&text).context("reading cargo metadata")
    }

    /// Builds the `hysteron` command as users get it and says where it is.
    pub fn release_binary(&self) -> Result<PathBuf> {
        passes(self.cargo().args(["build", "--release", "--locked", "--package", "hysteron"]))?;
        let metadata = self.metadata(&self.root.join("Cargo.toml"))?;
        let target = metadata["target_directory"].as_str().context("cargo metadata has no target_directory")?;
        Ok(Path::new(target).join("release/hysteron"))
    }
}

/// Shows the command, runs it with its output passed through, and fails if it fails.
pub fn passes(command: &mut Command) -> Result<Outcome> {
    println!("$ {}", shown(command));
    let status = command.status().with_context(|| format!("starting {}", shown(command)))?;
    succeeded(command, status)
}

/// Like [`passes`], but gives up (and ends the program) after `limit`: for what may hang on a closed network.
pub fn passes_within(command: &mut Command, limit: Duration) -> Result<Outcome> {
    println!("$ {}", shown(command));
    let mut child = command.spawn().with_context(|| format!("starting {}", shown(command)))?;
    let started = Instant::now();
    let status = watch(&mut child, |child| {
        if started.elapsed() > limit {
            child.kill().context("ending a program that took too long")?;
            bail!("no end after {} s: {}", limit.as_secs(), shown(command));
        }
        Ok(())
    })?;
    succeeded(command, status)
}

/// Waits for `child`, calling `look` about twenty times a second until it ends; the child does not outlive an error.
pub fn watch(child: &mut Child, mut look: impl FnMut(&mut Child) -> Result<()>) -> Result<ExitStatus> {
    loop {
        if let Some(status) = child.try_wait().context("waiting for a program")? {
            return Ok(status);
        }
        if let Err(error) = look(child) {
            // Already ended is as good as ended by us.
            let _ = child.kill();
            child.wait().context("waiting for a program")?;
            return Err(error);
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Standard output of a command that must succeed; its standard error becomes part of the error.
pub fn output(command: &mut Command) -> Result<String> {
    let output = command.output().with_context(|| format!("starting {}", shown(command)))?;
    if !output.status.success() {
        bail!("{}: {}", shown(command), String::from_utf8_lossy(&output.stderr).trim());
    }
    String::from_utf8(output.stdout).with_context(|| format!("{} printed no UTF-8", shown(command)))
}

/// True if the command can be started and succeeds; its output is dropped.
pub fn is_there(command: &mut Command) -> bool {
    command.output().is_ok_and(|output| output.status.success())
}

fn succeeded(command: &Command, status: ExitStatus) -> Result<Outcome> {
    if !status.success() {
        bail!("{status}: {}", shown(command));
    }
    Ok(Outcome::Passed)
}

fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let name = program.file_name().unwrap_or(program.as_os_str());
    let words = std::iter::once(name).chain(command.get_args());
    words.map(OsStr::to_string_lossy).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failing_command_is_an_error_that_names_it() {
        let error = passes(Command::new("false").arg("--really")).unwrap_err().to_string();
        assert!(error.contains("false --really"), "{error}");
    }

    #[test]
    fn a_hanging_command_is_ended_at_the_limit() {
        let started = Instant::now();
        let error = passes_within(Command::new("sleep").arg("60"), Duration::from_millis(100)).unwrap_err().to_string();
        assert!(error.contains("sleep 60"), "{error}");
        // 0.1 s limit plus one 0.05 s poll; 10 s leaves room for a loaded machine and is still far from 60.
        assert!(started.elapsed() < Duration::from_secs(10));
    }

    #[test]
    fn the_root_is_the_folder_with_this_crate_in_it() {
        assert!(Project::find().unwrap().root.join("xtask/Cargo.toml").exists());
    }
}
