//! Project files agree with each other: toolchain, short forms of commands, changelog.

use std::fs;

use e2e::root;

fn read(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Returns the quoted value of the first line `key = "value"`.
fn value(file: &str, key: &str) -> String {
    let text = read(file);
    let found = text.lines().find_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix('='));
    found.unwrap_or_else(|| panic!("{file}: no {key}")).trim().trim_matches('"').to_owned()
}

/// The toolchain of a checkout is a patch release of the oldest Rust that the packages name, so that this one is tested.
#[test]
fn the_toolchain_is_the_oldest_that_builds() {
    let (toolchain, oldest) = (value("rust-toolchain.toml", "channel"), value("Cargo.toml", "rust-version"));
    assert!(toolchain.strip_prefix(&oldest).is_some_and(|rest| rest.starts_with('.')), "{toolchain}, {oldest}");
}

#[test]
fn the_citation_is_of_this_version() {
    let cited = read("CITATION.cff");
    let version = cited.lines().find_map(|line| line.strip_prefix("version: "));
    assert_eq!(version, Some(env!("CARGO_PKG_VERSION")));
}

/// CONTRIBUTING.md names each short form beside the command for which it stands.
#[test]
fn short_forms_are_explained() {
    let page = read("CONTRIBUTING.md");
    let config = read(".cargo/config.toml");
    let forms: Vec<_> = config.lines().filter_map(|line| line.split_once(" = \"")).collect();
    assert!(!forms.is_empty(), "{config}");
    for (name, command) in forms {
        let (short, long) = (format!("`cargo {name}`"), format!("`cargo {}`", command.trim_end_matches('"')));
        assert!(page.lines().any(|line| line.contains(&short) && line.contains(&long)), "{short}: {long}");
    }
}

/// The changelog has unreleased changes first, then dated versions from new to old, the first of which is that of the
/// workspace.
#[test]
fn the_changelog_keeps_its_format() {
    let page = read("CHANGELOG.md");
    let mut headings = page.lines().filter_map(|line| line.strip_prefix("## "));
    assert_eq!(headings.next(), Some("[Unreleased]"));
    let mut versions = Vec::new();
    for heading in headings {
        let (version, date) = heading.split_once("] - ").unwrap_or_else(|| panic!("{heading}: no version and date"));
        let version: Vec<u32> =
            version.trim_start_matches('[').split('.').map(|number| number.parse().expect(heading)).collect();
        let date: Vec<&str> = date.split('-').collect();
        assert_eq!(date.iter().map(|part| part.len()).collect::<Vec<_>>(), [4, 2, 2], "{heading}");
        assert!(date.concat().bytes().all(|byte| byte.is_ascii_digit()), "{heading}");
        versions.push((version, date.concat()));
    }
    assert!(versions.is_sorted_by(|newer, older| newer.0 > older.0 && newer.1 >= older.1), "{versions:?}");
    let current: Vec<u32> = env!("CARGO_PKG_VERSION").split('.').map(|n| n.parse().expect("a number")).collect();
    assert_eq!(versions.first().map(|(version, _)| version), Some(&current));
    // Kinds of changes of https://keepachangelog.com.
    let kinds = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"];
    let strange: Vec<_> =
        page.lines().filter_map(|line| line.strip_prefix("### ")).filter(|kind| !kinds.contains(kind)).collect();
    assert!(strange.is_empty(), "{strange:?}");
}
