//! The dependency arrows between our rooms: what `ALLOWED` does not list fails.
//!
//! A room is a folder with a package; its name is the folder's, so renaming a package hides nothing.
//! Every kind of dependency counts, development and build ones included. Rooms not built yet don't appear.

use crate::project::{Outcome, Project};
use anyhow::{Context, Result, bail};
use serde_json::Value;
use std::path::Path;

/// The root package, whose folder is the repository itself.
const ROOT: &str = "hysteron";

/// Every room with the rooms it may lean on. ARCHITECTURE.md says why; change both in one commit.
const ALLOWED: &[(&str, &[&str])] = &[
    ("control-core", &[]),
    ("wire", &["control-core"]),
    ("firmware", &["control-core", "wire"]),
    ("plant-sim", &["control-core"]),
    // Codes and volts are control-core's conversion; wire: the image is spoken to as by any host.
    ("virtual-board", &["plant-sim", "control-core", "wire"]),
    ("gap-diagnosis", &["plant-sim"]),
    ("hil-bridge", &["wire", "control-core", "plant-sim", "virtual-board"]),
    // The waveform as boards play it is virtual-board's; the parameters and their words are wire's and control-core's.
    ("bench-page", &["hil-bridge", "gap-diagnosis", "virtual-board", "plant-sim", "wire", "control-core"]),
    // Makes the sealed cases: an equation shared with the solver would make the blind check a mirror.
    ("blind-truth", &[]),
    (
        ROOT,
        &[
            "control-core",
            "wire",
            "plant-sim",
            "virtual-board",
            "gap-diagnosis",
            "hil-bridge",
            "bench-page",
            "blind-truth",
        ],
    ),
    // Measures ours against rivals; nothing leans on it.
    ("benches", &["control-core", "wire", "plant-sim", "virtual-board", "gap-diagnosis", "hil-bridge", "blind-truth"]),
    // Runs the built command as a user would, so that it needs none of the rooms.
    ("xtask", &[]),
];

/// One room leaning on another.
#[derive(Debug, PartialEq)]
struct Arrow {
    from: String,
    to: String,
}

/// Reads `cargo metadata` of every workspace here and fails on a room or an arrow that is not listed.
pub fn run(project: &Project) -> Result<Outcome> {
    let mut rooms = Vec::new();
    let mut arrows = Vec::new();
    for manifest in project.manifests() {
        let (more_rooms, more_arrows) = read(&project.metadata(&manifest)?, &project.root)?;
        rooms.extend(more_rooms);
        arrows.extend(more_arrows);
    }
    let wrong = complaints(&rooms, &arrows);
    if !wrong.is_empty() {
        bail!("arrows:\n  {}", wrong.join("\n  "));
    }
    println!("arrows: {} rooms, {} arrows, all in the allowed list", rooms.len(), arrows.len());
    Ok(Outcome::Passed)
}

fn read(metadata: &Value, root: &Path) -> Result<(Vec<String>, Vec<Arrow>)> {
    let (mut rooms, mut arrows) = (Vec::new(), Vec::new());
    for package in metadata["packages"].as_array().context("cargo metadata has no packages")? {
        let manifest = package["manifest_path"].as_str().context("a package without manifest_path")?;
        let folder = Path::new(manifest).parent().context("a manifest without a folder")?;
        let from = room(folder, root);
        for dependency in package["dependencies"].as_array().context("a package without dependencies")? {
            // Only our own rooms are path dependencies: what comes from a registry has no path.
            if let Some(path) = dependency["path"].as_str() {
                arrows.push(Arrow { from: from.clone(), to: room(Path::new(path), root) });
            }
        }
        rooms.push(from);
    }
    Ok((rooms, arrows))
}

fn room(folder: &Path, root: &Path) -> String {
    match folder.strip_prefix(root) {
        Ok(inside) if inside.as_os_str().is_empty() => ROOT.to_owned(),
        Ok(inside) => inside.display().to_string(),
        // Outside the repository: shown whole, and never in the list.
        Err(_) => folder.display().to_string(),
    }
}

fn complaints(rooms: &[String], arrows: &[Arrow]) -> Vec<String> {
    let allowed_from = |from: &str| ALLOWED.iter().find(|(name, _)| *name == from).map(|(_, to)| *to);
    let unknown = rooms
        .iter()
        .filter(|name| allowed_from(name).is_none())
        .map(|name| format!("{name}: a room that xtask/src/arrows.rs does not know; add it there with its arrows"));
    let forbidden = arrows
        .iter()
        .filter(|arrow| allowed_from(&arrow.from).is_some_and(|to| !to.contains(&arrow.to.as_str())))
        .map(|arrow| format!("{} -> {}: not in the allowed list of xtask/src/arrows.rs", arrow.from, arrow.to));
    unknown.chain(forbidden).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn metadata_with(package: &str, path: &str) -> Value {
        json!({ "packages": [{
            "manifest_path": format!("/repo/{package}Cargo.toml"),
            "dependencies": [
                { "name": "serde", "kind": null },
                { "name": "whatever-it-is-called", "kind": "dev", "path": path },
            ],
        }]})
    }

    fn check(package: &str, path: &str) -> Vec<String> {
        let (rooms, arrows) = read(&metadata_with(package, path), Path::new("/repo")).unwrap();
        assert_eq!(arrows.len(), 1, "registry dependencies are no arrows");
        complaints(&rooms, &arrows)
    }

    #[test]
    fn allowed_arrows_pass() {
        assert!(check("plant-sim/", "/repo/control-core").is_empty());
        assert!(check("", "/repo/gap-diagnosis").is_empty());
        assert!(check("benches/", "/repo/plant-sim").is_empty());
    }

    #[test]
    fn forbidden_arrows_are_named_even_for_development() {
        assert_eq!(check("control-core/", "/repo/plant-sim").len(), 1);
        assert!(check("control-core/", "/repo/plant-sim")[0].starts_with("control-core -> plant-sim"));
        assert!(check("", "/repo/firmware")[0].starts_with("hysteron -> firmware"));
        assert!(check("blind-truth/", "/repo/plant-sim")[0].starts_with("blind-truth -> plant-sim"));
        assert!(check("xtask/", "/repo")[0].starts_with("xtask -> hysteron"));
        assert!(check("plant-sim/", "/elsewhere/thing")[0].starts_with("plant-sim -> /elsewhere/thing"));
    }

    #[test]
    fn a_room_nobody_listed_fails() {
        assert!(check("shed/", "/repo/control-core")[0].starts_with("shed: a room"));
    }

    #[test]
    fn the_list_names_only_rooms_it_knows_and_has_no_circle() {
        let names: Vec<&str> = ALLOWED.iter().map(|(name, _)| *name).collect();
        let mut settled: Vec<&str> = Vec::new();
        // Settles rooms whose targets are all settled; a circle or an unknown name would leave some over.
        for _ in &names {
            for (name, to) in ALLOWED {
                if !settled.contains(name) && to.iter().all(|target| settled.contains(target)) {
                    settled.push(name);
                }
            }
        }
        assert_eq!(settled.len(), names.len(), "settled: {settled:?}");
    }
}
