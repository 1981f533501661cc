//! House rules that a text search can hold; CONTRIBUTING.md gives the reason of each.
//!
//! It reads the files git knows or would add, so a build folder is never searched and a new file is checked before its
//! first commit. It does not parse Rust: a forbidden word in a comment line is let through, one in a string is not.

use crate::project::{Outcome, Project, output};
use anyhow::{Context, Result, bail};
use std::fs;
use std::path::Path;

/// Lines of one Rust file. Chosen: what a reader can hold; above it, a file does two jobs.
const MAX_RUST_LINES: usize = 800;

/// Bytes of one committed file. Chosen: recorded data are small or generated; a clone stays quick.
const MAX_BYTES: usize = 1_000_000;

/// Endings of the text files whose blanks are checked; data files may look as their source made them.
const TEXT: &[&str] = &["rs", "toml", "md", "x", "sh", "yml", "yaml", "html", "css", "js", "py", "json"];

/// Files of other projects, kept as they came so that their checksums hold; only their size is checked.
const VENDORED: &[&str] = &["gap-diagnosis/assets/uPlot"];

/// Words no Rust line may have, with the reason. Split by `concat!`, so that this file passes its own search.
const FORBIDDEN_RUST: &[(&str, &str)] = &[
    (concat!("#[", "ignore"), "a test that never runs proves nothing; long ones belong in xtask long"),
    (concat!("should", "_panic"), "assert on the error value, which says why it failed"),
    (concat!("dbg", "!("), "debugging left behind"),
    (concat!("todo", "!("), "a promise left behind"),
];

/// Switches and calls that let the compiler reorder arithmetic. Simulation results must repeat bit for bit.
const FAST_MATH: &[&str] = &[
    concat!("fast", "-math"),
    concat!("fast", "_math"),
    concat!("unsafe", "-fp-math"),
    concat!("fadd", "_fast"),
    concat!("fsub", "_fast"),
    concat!("fmul", "_fast"),
    concat!("fdiv", "_fast"),
    concat!("algebraic", "_add"),
    concat!("algebraic", "_mul"),
];

/// Beginnings of paths that exist on one machine only.
const MACHINE_PATHS: &[&str] =
    &[concat!("/wor", "k/"), concat!("/roo", "t/"), concat!("/hom", "e/"), concat!("/User", "s/")];

/// Checks every file of the repository and fails with the list of what is wrong where.
pub fn run(project: &Project) -> Result<Outcome> {
    // CI may check out as another user than the one that runs; this only lists names.
    let list = ["-c", "safe.directory=*", "ls-files", "-z", "--cached", "--others"];
    let names =
        output(project.command("git").args(list).arg("--exclude-standard")).context("tidy needs git and a checkout")?;
    // What was deleted is still listed until it is committed; a link leads somewhere else.
    let is_own = |name: &&str| {
        let path = project.root.join(name);
        path.is_file() && !path.is_symlink()
    };
    let names: Vec<&str> = names.split_terminator('\0').filter(is_own).collect();
    let mut wrong = left_out(&names, |name| fs::read_to_string(project.root.join(name)).unwrap_or_default());
    let mut n_files = 0;
    for name in names {
        let bytes = fs::read(project.root.join(name)).with_context(|| format!("reading {name}"))?;
        n_files += 1;
        wrong.extend(check(name, &bytes));
    }
    wrong.sort();
    wrong.dedup();
    if !wrong.is_empty() {
        bail!("tidy, {} in {n_files} files:\n  {}", wrong.len(), wrong.join("\n  "));
    }
    println!("tidy: {n_files} files in order");
    Ok(Outcome::Passed)
}

/// Files beside a `tests/suite.rs` that neither it nor the package's manifest names: cargo would pass over them in silence.
fn left_out(names: &[&str], read: impl Fn(&str) -> String) -> Vec<String> {
    let mut wrong = Vec::new();
    for package in names.iter().filter_map(|name| name.strip_suffix("tests/suite.rs")) {
        let folder = format!("{package}tests/");
        let named = read(&format!("{folder}suite.rs")) + &read(&format!("{package}Cargo.toml"));
        for name in names {
            let Some(file) = name.strip_prefix(&folder).and_then(|file| file.strip_suffix(".rs")) else { continue };
            let test = file.trim_end_matches("/mod").trim_end_matches("/main");
            let is_named = ["mod {};", "name = \"{}\""].iter().any(|line| named.contains(&line.replace("{}", test)));
            if test != "suite" && !test.contains('/') && !is_named {
                wrong.push(format!("{name}: not in {folder}suite.rs, so that it never runs"));
            }
        }
    }
    wrong
}

fn check(name: &str, bytes: &[u8]) -> Vec<String> {
    let mut wrong = Vec::new();
    if bytes.len() > MAX_BYTES {
        wrong.push(format!("{name}: {} bytes, more than {MAX_BYTES}", bytes.len()));
    }
    if VENDORED.iter().any(|prefix| name.starts_with(prefix)) {
        return wrong;
    }
    let Ok(text) = std::str::from_utf8(bytes) else {
        return wrong;
    };
    for (line_idx, line) in text.lines().enumerate() {
        check_line(name, line).into_iter().for_each(|complaint| {
            wrong.push(format!("{name}:{}: {complaint}", line_idx + 1));
        });
    }
    if is_text(name) && !text.is_empty() && !text.ends_with('\n') {
        wrong.push(format!("{name}: does not end in a newline"));
    }
    if is_rust(name) {
        let n_lines = text.lines().count();
        if n_lines > MAX_RUST_LINES {
            wrong.push(format!("{name}: {n_lines} lines, more than {MAX_RUST_LINES}: split it"));
        }
        // A `tests.rs` is the inside of a module whose own file says what it is.
        if !text.starts_with("//!") && !name.ends_with("/tests.rs") {
            wrong.push(format!("{name}:1: does not open with `//!` saying what the file is"));
        }
    }
    wrong
}

fn check_line(name: &str, line: &str) -> Vec<String> {
    let mut wrong = Vec::new();
    if is_text(name) && line.ends_with([' ', '\t']) {
        wrong.push("trailing blank".to_owned());
    }
    wrong.extend(
        MACHINE_PATHS.iter().filter(|path| has_path(line, path)).map(|path| format!("`{path}`: a path of one machine")),
    );
    if is_comment(name, line) {
        return wrong;
    }
    if is_rust(name) {
        if line.contains('\t') {
            wrong.push("tab".to_owned());
        }
        let words = FORBIDDEN_RUST.iter().filter(|(word, _)| line.contains(word));
        wrong.extend(words.map(|(word, reason)| format!("`{word}`: {reason}")));
    }
    if is_rust(name) || is_build_file(name) {
        let flags = FAST_MATH.iter().filter(|flag| line.contains(*flag));
        wrong.extend(flags.map(|flag| format!("`{flag}`: results must repeat bit for bit")));
    }
    wrong
}

/// A path counts where it begins a word: `https://example.org/.../` holds none.
fn has_path(line: &str, path: &str) -> bool {
    line.match_indices(path)
        .any(|(at, _)| !line[..at].ends_with(|before: char| before.is_alphanumeric() || "._-/*}~$".contains(before)))
}

fn is_comment(name: &str, line: &str) -> bool {
    let mark = if is_rust(name) { "//" } else { "#" };
    line.trim_start().starts_with(mark)
}

fn is_rust(name: &str) -> bool {
    name.ends_with(".rs")
}

fn is_build_file(name: &str) -> bool {
    name.ends_with(".toml") || name.ends_with(".sh") || name.starts_with(".ci/")
}

fn is_text(name: &str) -> bool {
    let extension = Path::new(name).extension().and_then(|ending| ending.to_str());
    name.starts_with(".ci/") || extension.is_some_and(|ending| TEXT.contains(&ending))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complaints(name: &str, text: &str) -> Vec<String> {
        check(name, text.as_bytes())
    }

    #[track_caller]
    fn one(name: &str, text: &str, expected: &str) {
        let wrong = complaints(name, text);
        assert!(wrong.len() == 1 && wrong[0].contains(expected), "{expected}: {wrong:?}");
    }

    #[test]
    fn a_tidy_file_passes() {
        assert_eq!(complaints("a/src/lib.rs", "//! What it is.\n\nfn f() {}\n"), [""; 0]);
        assert_eq!(complaints("a/src/law/tests.rs", "use super::*;\n"), [""; 0]);
        assert_eq!(complaints("empty.md", ""), [""; 0]);
    }

    #[test]
    fn blanks_and_endings_are_held() {
        one("a.rs", "//! X.\nfn f() {} \n", "a.rs:2: trailing blank");
        one("a.md", "Text  \n", "trailing blank");
        one("a.rs", "//! X.\n\tfn f() {}\n", "tab");
        one("a.rs", "//! X.", "newline");
        assert!(check("gap-diagnosis/assets/uPlot.min.css", b"a{}").is_empty());
        assert_eq!(check("gap-diagnosis/assets/uPlot.min.css", &vec![b'a'; MAX_BYTES + 1]).len(), 1);
        assert_eq!(complaints("log.csv", "1, 2 \n3, 4"), [""; 0], "data stays as its source made it");
    }

    #[test]
    fn rust_opens_with_what_it_is_and_stays_readable() {
        one("a.rs", "fn f() {}\n", "does not open with");
        one("a.rs", &format!("//! X.\n{}", "fn f() {}\n".repeat(MAX_RUST_LINES)), "801 lines");
    }

    #[test]
    fn a_test_that_no_suite_names_is_found() {
        let read = |name: &str| match name {
            "a/tests/suite.rs" => "mod chain;\nmod parts;\n".to_owned(),
            "a/Cargo.toml" => "[[test]]\nname = \"alone\"\n".to_owned(),
            _ => String::new(),
        };
        let named = [
            "a/tests/suite.rs",
            "a/tests/chain.rs",
            "a/tests/parts/mod.rs",
            "a/tests/parts/rival.rs",
            "a/tests/alone.rs",
        ];
        assert_eq!(left_out(&[&named[..], &["b/tests/any.rs"]].concat(), read), [""; 0]);
        let wrong = left_out(&[&named[..], &["a/tests/new.rs", "a/tests/page/main.rs"]].concat(), read);
        assert!(wrong.len() == 2 && wrong[0].starts_with("a/tests/new.rs") && wrong[1].contains("page"), "{wrong:?}");
    }

    #[test]
    fn forbidden_words_are_found_in_code_and_not_in_comment_lines() {
        for (word, _) in FORBIDDEN_RUST {
            one("a.rs", &format!("//! X.\n    {word}x)]\n"), word);
            assert_eq!(complaints("a.rs", &format!("//! X.\n    // no {word} here\n")), [""; 0]);
        }
    }

    #[test]
    fn reordered_arithmetic_is_found_where_it_acts() {
        for flag in FAST_MATH {
            one("a.rs", &format!("//! X.\nx.{flag}(y);\n"), flag);
            one(".cargo/config.toml", &format!("rustflags = [\"-C{flag}\"]\n"), flag);
            assert_eq!(complaints("a.md", &format!("Why {flag} is banned.\n")), [""; 0]);
            assert_eq!(complaints("Cargo.toml", &format!("# {flag} is banned.\n")), [""; 0]);
        }
    }

    #[test]
    fn paths_of_one_machine_are_found_anywhere_but_inside_other_paths() {
        for path in MACHINE_PATHS {
            one("a.md", &format!("See `{path}x`.\n"), path);
            one("a.rs", &format!("//! {path}x\n"), path);
            assert_eq!(complaints("a.md", &format!("https://example.org{path}x\n")), [""; 0]);
            assert_eq!(complaints("a.md", &format!("docs{path}x\n")), [""; 0]);
        }
    }

    #[test]
    fn big_files_are_found_even_when_binary() {
        let big = vec![0xff; MAX_BYTES + 1];
        assert_eq!(check("a.npy", &big).len(), 1);
        assert_eq!(check("a.npy", &big[1..]), [""; 0]);
    }
}
