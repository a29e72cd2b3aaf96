//! The language of the code base: comments can be searched for and read.

use e2e::root;

use crate::crate_graph::rust_files;

/// Riddles begin so: the noun that a reader would search for comes late or never.
const FORBIDDEN_FIRST_WORDS: [&str; 4] = ["What", "Where", "Whether", "How"];

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

/// A doc comment names its subject first.
#[test]
fn doc_comments_name_their_subject() {
    let mut riddles = Vec::new();
    for (file, text) in rust_files(root()) {
        for (line, said) in openings(&text) {
            if FORBIDDEN_FIRST_WORDS
                .iter()
                .any(|word| said.strip_prefix(word).is_some_and(|rest| rest.starts_with(' ')))
            {
                let name = file.strip_prefix(root()).unwrap_or(&file);
                riddles.push(format!("{}:{line}: {said}", name.display()));
            }
        }
    }
    assert!(
        riddles.is_empty(),
        "{} doc comments begin with {FORBIDDEN_FIRST_WORDS:?}:\n{}",
        riddles.len(),
        riddles.join("\n")
    );
}

/// Only the first line of a comment counts, and code does not.
#[test]
fn openings_of_doc_comments() {
    let text = "/// How much.\n/// Where it is.\nlet x = 1; // What\n\n    //! Whether.\nfn f() {}\n/// Offset, m.\n";
    assert_eq!(openings(text), [(1, "How much."), (5, "Whether."), (7, "Offset, m.")]);
}
