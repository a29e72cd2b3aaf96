//! Description of the run: the data that the program recorded about it, the most useful first.

use maud::{Markup, html};
use serde_json::Value;

use super::html::{ColumnAlignment, HtmlTable, format_duration, format_number};

/// Keys shown first, in this order; the others follow in their own order.
const FIRST_KEYS: [&str; 6] = ["command", "seed", "robot", "versions", "version", "wall_s"];

/// Key of the warnings, a list of texts of first importance to the reader.
const WARNINGS_KEY: &str = "warnings";

/// Returns the warnings about deviations of this run from a full benchmark: at the top of the page, in red. Empty if
/// there are none.
pub fn warnings(run: &Value) -> Markup {
    let list = run.get(WARNINGS_KEY).and_then(Value::as_array).filter(|list| !list.is_empty());
    html! { @if let Some(list) = list { ul.warnings { @for text in list { li { (unquoted(text)) } } } } }
}

/// Returns the section.
pub fn section(run: &Value) -> Markup {
    let mut rows = Vec::new();
    if let Value::Object(fields) = run {
        for key in FIRST_KEYS.iter().filter(|key| **key != "command") {
            if let Some(value) = fields.get(*key) {
                flatten(key, value, &mut rows);
            }
        }
        for (key, value) in fields.iter().filter(|(key, _)| !FIRST_KEYS.contains(&key.as_str()) && *key != WARNINGS_KEY)
        {
            flatten(key, value, &mut rows);
        }
    } else if !run.is_null() {
        flatten("run", run, &mut rows);
    }
    let (long, short): (Vec<_>, Vec<_>) = rows.into_iter().partition(|(_, text)| text.contains('\n'));
    let mut table = HtmlTable::new(
        "Settings and versions of the run",
        &[("what", ColumnAlignment::Words), ("value", ColumnAlignment::Words)],
    );
    for (key, text) in &short {
        table.row(&[key, text]);
    }
    html! {
        h2 id="run" { "Run" }
        @if let Some(command) = run.get("command").and_then(command_line) { pre { code { (command) } } }
        @if !short.is_empty() { (table) }
        @for (key, text) in &long { details { summary { (key) } pre { code { (text.trim_end()) } } } }
    }
}

/// Formats the command, given as text or as a list of words, as one line.
pub fn command_line(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Array(words) if !words.is_empty() => Some(shell_line(&words.iter().map(unquoted).collect::<Vec<_>>())),
        _ => None,
    }
}

/// Joins words to a line for a shell.
pub fn shell_line(words: &[String]) -> String {
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// Quotes a word for a shell if needed.
fn quoted(word: &str) -> String {
    let safe = |c: char| c.is_ascii_alphanumeric() || "-_./=:,@%+".contains(c);
    if !word.is_empty() && word.chars().all(safe) {
        word.to_string()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

/// Turns nested objects into rows with dotted keys.
fn flatten(key: &str, value: &Value, rows: &mut Vec<(String, String)>) {
    match value {
        Value::Object(fields) => fields.iter().for_each(|(name, value)| flatten(&format!("{key}.{name}"), value, rows)),
        Value::Null => {}
        _ if key.rsplit('.').next().is_some_and(|name| name.ends_with("_s")) && value.is_number() => {
            let name = key.strip_suffix("_s").unwrap_or(key);
            rows.push((readable_key(name), format_duration(value.as_f64().unwrap_or(f64::NAN))));
        }
        _ => rows.push((readable_key(key), unquoted(value))),
    }
}

/// Makes a key readable.
fn readable_key(key: &str) -> String {
    key.replace('_', " ")
}

/// Formats a value without JSON's quotes.
fn unquoted(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(items) => items.iter().map(unquoted).collect::<Vec<_>>().join(", "),
        Value::Number(n) if n.is_f64() => format_number(n.as_f64().unwrap_or(f64::NAN), 3),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn everything_written_down_is_shown_and_escaped() {
        let html = section(&json!({
            "wall_s": 754.6, "command": ["ftac", "bench", "--out", "a b<c>"], "seed": 18446744073709551615_u64,
            "versions": {"ftac": "0.1.0", "rapier3d": "0.36.1"}, "scenario": "line <1>\nline 2", "note": null,
        }))
        .into_string();
        for part in [
            "ftac bench --out 'a b&lt;c&gt;'",
            "18446744073709551615",
            "versions.rapier3d",
            "12 min 34 s",
            "line &lt;1&gt;\nline 2",
        ] {
            assert!(html.contains(part), "{part} is not in {html}");
        }
        assert!(!html.contains("note"));
    }

    #[test]
    fn a_run_nobody_described_leaves_a_heading() {
        assert!(section(&Value::Null).0.starts_with("<h2"));
        assert!(warnings(&Value::Null).0.is_empty() && warnings(&json!({"warnings": []})).0.is_empty());
        assert!(warnings(&json!({"warnings": ["2 of 4 <b>"]})).0.contains("<li>2 of 4 &lt;b&gt;</li>"));
        assert!(section(&json!({"command": "ftac bench"})).0.contains("<code>ftac bench</code>"));
    }
}
