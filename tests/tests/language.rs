//! The language of the code base: names and comments use the field's words and can be searched for.

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
