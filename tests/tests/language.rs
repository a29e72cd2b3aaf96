//! The language of the code base: names and comments use the field's words and can be searched for.

use std::fs;
use std::path::{Path, PathBuf};

use e2e::root;

use crate::crate_graph::rust_files;

/// Openings that hide the noun for which a reader would search.
const RIDDLES: [&str; 4] = ["What", "Where", "Whether", "How"];

/// Words that no declared name contains, with the terms that the field uses instead.
const FORMER_TERMS: [(&str, &str); 25] = [
    ("brain", "controller"),
    ("glance", "detection"),
    ("percept", "detected object"),
    ("rehearse", "rollout"),
    ("rehearsed", "rollout"),
    ("rehearsal", "rollout"),
    ("rehearsals", "rollouts"),
    ("wish", "command, request"),
    ("wishes", "commands, requests"),
    ("guest", "policy introduction"),
    ("odds", "outcome probabilities"),
    ("worth", "score"),
    ("proving", "grasp verification"),
    ("prove", "verify"),
    ("proof", "verification"),
    ("proofs", "verifications"),
    ("proven", "verified"),
    ("story", "decision trace"),
    ("eyes", "object detector"),
    ("individual", "instance"),
    ("individuals", "instances"),
    ("weighing", "payload calibration"),
    ("weighed", "payload, scored"),
    ("patience", "timeout"),
    ("venue", "source"),
];

/// Words that no comment, message or page contains. The other former names have ordinary uses in prose.
const FORMER_WORDS: [&str; 18] = [
    "brain",
    "glance",
    "percept",
    "rehearse",
    "rehearsed",
    "rehearsal",
    "rehearsals",
    "wish",
    "wishes",
    "guest",
    "odds",
    "proving",
    "proven",
    "belief",
    "beliefs",
    "foresight",
    "patience",
    "venue",
];

/// Returns the prose of a line of Rust: its comment, or its string literals of several words.
fn prose(line: &str) -> String {
    let trimmed = line.trim_start();
    if trimmed.starts_with("//") {
        return trimmed.to_owned();
    }
    let literals = line.split('"').skip(1).step_by(2).filter(|literal| literal.contains(' '));
    literals.collect::<Vec<_>>().join(" ")
}

/// First lines of doc comments with their line numbers.
fn openings(text: &str) -> Vec<(usize, &str)> {
    let mut found = Vec::new();
    let mut inside = false;
    for (number, line) in text.lines().enumerate() {
        let line = line.trim_start();
        let said = line.strip_prefix("///").or_else(|| line.strip_prefix("//!"));
        if let Some(said) = said.filter(|_| !inside) {
            found.push((number + 1, said.trim()));
        }
        inside = said.is_some();
    }
    found
}

/// Names that a text declares (items, and fields or parameters at the beginning of a line), with their line numbers.
fn declared(text: &str) -> Vec<(usize, &str)> {
    const ITEMS: [&str; 8] = ["struct", "enum", "trait", "type", "fn", "mod", "const", "static"];
    let is_name = |name: &str| {
        name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    let mut found = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim_start();
        if line.starts_with("//") {
            continue;
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        let item = words.iter().take(4).position(|word| ITEMS.contains(word)).and_then(|at| words.get(at + 1));
        let field = words.iter().take(2).find_map(|word| word.strip_suffix(':'));
        let item = item.map(|name| name.split(['(', '<', ':', ';', '{', '=']).next().unwrap_or_default());
        found.extend(item.or(field).filter(|name| is_name(name)).map(|name| (number + 1, name)));
    }
    found
}

/// Splits a name in snake or camel case into its words, in lower case.
fn words(name: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut previous = '_';
    for c in name.chars() {
        let begins = previous == '_' || (c.is_ascii_uppercase() && !previous.is_ascii_uppercase());
        if c != '_' {
            if begins {
                words.push(String::new());
            }
            words.last_mut().into_iter().for_each(|word| word.push(c.to_ascii_lowercase()));
        }
        previous = c;
    }
    words
}

/// A doc comment names its subject first.
#[test]
fn doc_comments_name_their_subject() {
    let mut riddles = Vec::new();
    for (file, text) in rust_files(root()) {
        for (line, said) in openings(&text) {
            if RIDDLES.iter().any(|word| said.strip_prefix(word).is_some_and(|rest| rest.starts_with(' '))) {
                let name = file.strip_prefix(root()).unwrap_or(&file);
                riddles.push(format!("{}:{line}: {said}", name.display()));
            }
        }
    }
    assert!(riddles.is_empty(), "{} doc comments begin with {RIDDLES:?}:\n{}", riddles.len(), riddles.join("\n"));
}

/// Declared names use the field's terms.
#[test]
fn names_use_the_fields_terms() {
    let mut found = Vec::new();
    for (file, text) in rust_files(root()) {
        for (line, name) in declared(&text) {
            let name_words = words(name);
            for (former, current) in FORMER_TERMS {
                if name_words.iter().any(|word| word == former) {
                    let file = file.strip_prefix(root()).unwrap_or(&file);
                    found.push(format!("{}:{line}: {name}: found `{former}`, expected {current}", file.display()));
                }
            }
        }
    }
    assert!(found.is_empty(), "{} names:\n{}", found.len(), found.join("\n"));
}

/// Comments, messages of the program and pages use the field's terms. Tests of former names are exempt, and so is the
/// change log.
#[test]
fn prose_uses_the_fields_terms() {
    let rust = rust_files(root()).into_iter().map(|(file, text)| (file, text.lines().map(prose).collect::<Vec<_>>()));
    let pages = pages(root()).into_iter().map(|(file, text)| (file, text.lines().map(str::to_owned).collect()));
    let mut found = Vec::new();
    for (file, lines) in rust.chain(pages) {
        let name = file.strip_prefix(root()).unwrap_or(&file).display().to_string();
        if name.ends_with("former_names.rs") || name.ends_with("language.rs") {
            continue;
        }
        for (number, line) in lines.iter().enumerate() {
            let mut words = line.split(|c: char| !c.is_ascii_alphanumeric()).map(str::to_ascii_lowercase);
            if let Some(word) = words.find(|word| FORMER_WORDS.contains(&word.as_str())) {
                found.push(format!("{name}:{}: found `{word}`", number + 1));
            }
        }
    }
    assert!(found.is_empty(), "{} lines:\n{}", found.len(), found.join("\n"));
}

/// Returns the pages of the guide, of the front page and of the architecture, and the Python sources.
fn pages(root: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    let mut folders = vec![root.join("twin/guide/src"), root.join("twin/python"), root.join("hardware-bridge/docs")];
    let mut files: Vec<PathBuf> =
        ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(|name| root.join(name)).into();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a folder of pages") {
            let path = entry.expect("an entry").path();
            let is_page = path.extension().is_some_and(|ending| ending == "md" || ending == "py");
            if path.is_dir() {
                folders.push(path);
            } else if is_page {
                files.push(path);
            }
        }
    }
    for file in files {
        let text = fs::read_to_string(&file).expect("a page");
        found.push((file, text));
    }
    found
}

/// Only comments and literals of several words are prose.
#[test]
fn prose_of_a_line() {
    assert_eq!(prose("    /// A brain."), "/// A brain.");
    assert_eq!(prose(r#"let odds = message("its odds", "odds");"#), "its odds");
    assert_eq!(prose("let wish = 1;"), "");
}

/// Only the first line of a comment counts, and code does not.
#[test]
fn openings_of_doc_comments() {
    let text = "/// How much.\n/// Where it is.\nlet x = 1; // What\n\n    //! Whether.\nfn f() {}\n/// Offset, m.\n";
    assert_eq!(openings(text), [(1, "How much."), (5, "Whether."), (7, "Offset, m.")]);
}

/// Items, fields and parameters are declared; mentions are not.
#[test]
fn names_are_declared_once() {
    let text = "pub struct OddsTable<T> {\n    pub(crate) worth: f64,\n}\n// fn brain()\nfn f(\n    wish: bool,\n) {\n    let guest = odds();\n}\n";
    let names: Vec<&str> = declared(text).into_iter().map(|(_, name)| name).collect();
    assert_eq!(names, ["OddsTable", "worth", "f", "wish"]);
    assert_eq!(words("OddsTable"), ["odds", "table"]);
    assert_eq!(words("held_by_URDF"), ["held", "by", "urdf"]);
}
