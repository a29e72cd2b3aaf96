//! `ftac reference`: the reference pages of the book (`twin/guide/src/reference`), made from the command line, the
//! schemas of the `--json` output and the columns of the tables.

mod fields;
mod options;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context as _;
use clap::Command;
use ftac_platform::data::write_atomically;
use scenarios::record::TrialRecord;
use scenarios::summary::Summary;
use scenarios::tries::TryRecord;
use serde_json::Value;
use sweep::columns::{ColumnKind, TableKind};

use crate::cli::COMMAND_GROUPS;
use crate::json_schema::{self, OutputSchema, schema_of};
use crate::terminal::Outcome;

/// Page with an overview of all commands.
const OVERVIEW: &str = "commands.md";
/// Page with the fields of `summary.json`.
const SUMMARY: &str = "summary.md";

/// Writes the pages about `program` and the `outputs` of its commands into `folder`, which is created.
pub fn write(folder: &Path, program: Command, outputs: &[OutputSchema]) -> Outcome {
    std::fs::create_dir_all(folder).with_context(|| format!("--out: cannot create {}", folder.display()))?;
    for (name, text) in pages(program, outputs) {
        write_atomically(&folder.join(name), format!("{}\n", text.trim_end()).as_bytes()).context("--out")?;
    }
    Ok(None)
}

/// Returns the pages by their file names.
fn pages(mut program: Command, outputs: &[OutputSchema]) -> BTreeMap<String, String> {
    program.build();
    let fixed =
        [(OVERVIEW, overview(&program)), (SUMMARY, summary()), ("json.md", json(outputs)), ("tables.md", tables())];
    let fixed = fixed.into_iter().map(|(name, text)| (name.to_owned(), text));
    let groups = COMMAND_GROUPS.iter().map(|(title, names)| (file(title), group(&program, title, names)));
    fixed.chain(groups).collect()
}

/// Returns the file name of a group's page.
fn file(title: &str) -> String {
    format!("{}.md", title.to_lowercase().replace(' ', "-"))
}

fn overview(program: &Command) -> String {
    let mut text =
        "# Commands\n\nEvery command of `ftac`, by purpose. `ftac COMMAND --help` prints the same.\n".to_owned();
    for (title, names) in COMMAND_GROUPS {
        text += &format!("\n## {title}\n\n");
        for command in names.iter().filter_map(|name| program.find_subcommand(name)).filter(|found| is_shown(found)) {
            let name = format!("ftac {}", command.get_name());
            let target = format!("{}#{}", file(title), name.replace(' ', "-"));
            text += &format!("- [`{name}`]({target}): {}\n", options::about(command));
        }
    }
    text += "\n## Options of every command\n\n";
    text + &options::list(program.get_arguments().filter(|argument| argument.is_global_set()))
}

/// True for a command that the program's help shows.
fn is_shown(command: &Command) -> bool {
    !command.is_hide_set() && command.get_name() != "help"
}

fn group(program: &Command, title: &str, names: &[&str]) -> String {
    let mut text = format!(
        "# {title}\n\nOptions of every command, such as `--json` and `--seed`, are on the page [Commands]({OVERVIEW}).\n"
    );
    for command in names.iter().filter_map(|name| program.find_subcommand(name)).filter(|found| is_shown(found)) {
        describe(command, "ftac", 2, &mut text);
    }
    text
}

/// Appends a command with its usage, arguments and options, and then its own commands.
fn describe(command: &Command, path: &str, level: usize, text: &mut String) {
    let path = format!("{path} {}", command.get_name());
    let usage = command.clone().render_usage().to_string();
    let usage = usage.trim_start_matches("Usage:").split_whitespace().collect::<Vec<_>>().join(" ");
    *text += &format!("\n{} {path}\n\n{}\n\n```text\n{usage}\n```\n", "#".repeat(level), options::about(command));
    let own = options::list(command.get_arguments().filter(|argument| !argument.is_global_set()));
    if !own.is_empty() {
        *text += &format!("\n{own}");
    }
    for child in command.get_subcommands().filter(|child| is_shown(child)) {
        describe(child, &path, level + 1, text);
    }
}

/// Returns the schema of a `T` as JSON.
fn schema<T: schemars::JsonSchema>() -> Value {
    Value::from(schema_of::<T>())
}

fn summary() -> String {
    let fields = fields::table(&schema::<Summary>());
    format!(
        "# Fields of summary.json\n\n`ftac bench` writes `summary.json` into its result folder, and prints the same object with `--json`. \
         A number that could not be computed is `null`. `X` in a path stands for a name, `[]` for the elements of a list.\n\n{fields}"
    )
}

fn json(outputs: &[OutputSchema]) -> String {
    let all = json_schema::all_schemas(outputs.iter().copied());
    let whole = schema::<Summary>();
    let mut text = "# JSON output of the commands\n\nWith `--json` a command prints one JSON object on stdout, and everything else on stderr. \
                    `ftac schema COMMAND` prints the JSON Schema from which this page is made. A command with several kinds of output \
                    has a table for each. `X` in a path stands for a name, `[]` for the elements of a list.\n"
        .to_owned();
    text += &format!("\n## A command that fails\n\n{}", fields::table(&all["error"]));
    for (name, schema) in all["commands"].as_object().into_iter().flatten() {
        text += &format!("\n## ftac {name}\n");
        let kinds = match schema.get("anyOf").and_then(Value::as_array) {
            Some(kinds) if schema.get("properties").is_none() => kinds.as_slice(),
            _ => std::slice::from_ref(schema),
        };
        for kind in kinds {
            if *kind == whole {
                text += &format!("\nThe [fields of `summary.json`]({SUMMARY}).\n");
                continue;
            }
            if let Some(meaning) = fields::meaning(kind) {
                text += &format!("\n{meaning}\n");
            }
            text += &format!("\n{}", fields::table(kind));
        }
    }
    text
}

/// Returns the table of the columns that a row `T` of a CSV file has.
fn columns<T: schemars::JsonSchema>() -> String {
    fields::table(&schema::<T>()).replacen("| field |", "| column |", 1)
}

fn tables() -> String {
    let mut text =
        "# Columns of the tables\n\nTables are CSV files with a header. A value that does not exist is empty.\n"
            .to_owned();
    text += &format!(
        "\n## trials.csv\n\nOne row per trial and condition. The first column, `ablation`, names the ablation of `touch`; it is empty for a row without one.\n\n{}",
        columns::<TrialRecord>()
    );
    text += &format!("\n## tries.csv\n\nOne row per try at an object.\n\n{}", columns::<TryRecord>());
    for which in TableKind::ALL {
        let name = which.name();
        text += &format!(
            "\n## {name}/*.parquet of a sweep\n\nSchema version {}. One more column, `axis_...`, for each axis of the sweep follows `seed`.\n\n| column | type | meaning |\n|---|---|---|\n",
            sweep::columns::VERSION
        );
        for column in which.columns(&[]) {
            let kind = match column.kind {
                ColumnKind::Whole => "whole number",
                ColumnKind::Number => "number",
                ColumnKind::Flag => "true or false",
                ColumnKind::Text => "text",
            };
            text += &format!("| `{}` | {kind} | {} |\n", column.name, options::escaped(column.description));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::command_definition;
    use crate::commands::schema::OUTPUTS;

    /// Every command has its heading on one page, with its usage, and every option its line.
    #[test]
    fn every_command_is_on_a_page() {
        let pages = pages(command_definition(), OUTPUTS);
        let all: String = COMMAND_GROUPS.iter().map(|(title, _)| pages[&file(title)].as_str()).collect();
        for name in ["ftac bench", "ftac grasps generate", "ftac bridge stop", "ftac schema"] {
            assert_eq!(all.matches(&format!("# {name}\n")).count(), 1, "{name}");
            assert!(all.contains(&format!("```text\n{name}")), "{name}");
        }
        assert!(all.contains("- `--noise-scale") && !all.contains("- `--json`") && !all.contains("ftac reference"));
        assert!(pages[OVERVIEW].contains("- `--json`") && pages[OVERVIEW].contains("(run-trials.md#ftac-bench)"));
    }

    #[test]
    fn every_output_and_table_is_described() {
        let pages = pages(command_definition(), OUTPUTS);
        assert!(pages[SUMMARY].contains("| `trials_per_combo` |"), "{}", pages[SUMMARY]);
        assert!(pages["json.md"].contains("\n## ftac trial\n") && pages["json.md"].contains("| `code` |"));
        for column in scenarios::record::COLUMNS {
            assert!(pages["tables.md"].contains(&format!("| `{column}` |")), "{column}");
        }
        let rows = pages.values().flat_map(|text| text.lines()).filter(|line| line.starts_with("| `"));
        for row in rows {
            assert_eq!(row.replace("\\|", "").matches('|').count(), 4, "{row}");
        }
    }
}
