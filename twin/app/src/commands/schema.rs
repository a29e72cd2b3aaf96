//! `ftac schema`: what `--json` prints, as JSON Schema.

use anyhow::{Context as _, bail};
use serde_json::{Value, json};

use crate::terminal::{Outcome, Terminal};

/// A schema for each command, and one for what every command prints when it fails.
pub const SCHEMAS: &str = include_str!("../../data/json-output.json");

/// Prints the schema of a command's output, or those of all commands.
pub fn run(terminal: &Terminal, command: &[String]) -> Outcome {
    let all: Value = serde_json::from_str(SCHEMAS).context("data/json-output.json")?;
    let found = if command.is_empty() { all } else { of_command(&all, &command.join(" "))? };
    terminal.print(&found, &(serde_json::to_string_pretty(&found)? + "\n"))?;
    Ok(None)
}

/// A schema on its own: what the command prints when it is done, or when it fails.
fn of_command(all: &Value, name: &str) -> anyhow::Result<Value> {
    let commands = all["commands"].as_object().context("data/json-output.json: commands")?;
    let Some(schema) = commands.get(name) else {
        let known: Vec<&str> = commands.keys().map(String::as_str).collect();
        bail!("COMMAND: found `{name}`, expected one of {}", known.join(", "));
    };
    Ok(json!({ "$schema": all["$schema"], "title": format!("ftac {name} --json"), "anyOf": [schema, all["error"]] }))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::Command;

    use super::*;
    use crate::cli::described;

    /// Commands that print no result of their own.
    const WITHOUT: [&str; 5] = ["completions", "help", "man", "schema", "view"];

    fn leaves(command: &Command, path: &str, into: &mut BTreeSet<String>) {
        let own: Vec<&Command> = command.get_subcommands().filter(|own| own.get_name() != "help").collect();
        if own.is_empty() {
            into.insert(path.to_owned());
        }
        for child in own {
            let path = format!("{path} {}", child.get_name());
            leaves(child, path.trim(), into);
        }
    }

    #[test]
    fn every_command_has_a_schema() {
        let mut expected = BTreeSet::new();
        leaves(&described(), "", &mut expected);
        expected.retain(|name| !WITHOUT.contains(&name.as_str()));
        let all: Value = serde_json::from_str(SCHEMAS).expect("JSON");
        let found: BTreeSet<String> = all["commands"].as_object().expect("commands").keys().cloned().collect();
        assert_eq!(found, expected);
        assert!(of_command(&all, "dance").is_err_and(|error| error.to_string().contains("expected one of arm check")));
    }
}
