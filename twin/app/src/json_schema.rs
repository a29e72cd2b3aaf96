//! JSON Schema of the commands' `--json` output, derived from the printed types.

use std::collections::BTreeMap;

use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use schemars::{JsonSchema, Schema};
use serde::Serialize;
use serde_json::{Value, json};

/// A command, and the schema of its output. A command with several kinds of output has one entry for each.
pub type OutputSchema = (&'static str, fn() -> Schema);

/// JSON output of every command that fails.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FailureOutput {
    /// Error message: file, field, value found and value expected.
    pub error: String,
    /// Exit code: 1 ran and falls short, 2 bad usage or bad input, 130 interrupted.
    pub code: u8,
}

/// Returns the schema of a `T` as printed.
pub fn schema_of<T: JsonSchema>() -> Schema {
    let settings = SchemaSettings::draft2020_12().for_serialize().with(|settings| {
        settings.inline_subschemas = true;
        settings.meta_schema = None;
    });
    let generator = settings.with_transform(RecursiveTransform(as_printed)).into_generator();
    let mut schema = generator.into_root_schema_for::<T>();
    schema.remove("title");
    schema
}

/// Adapts a schema to the printed form: no additional fields, and numbers that are not finite become null.
fn as_printed(schema: &mut Schema) {
    schema.remove("default");
    if schema.get("properties").is_some() && schema.get("additionalProperties").is_none() {
        schema.insert("additionalProperties".to_owned(), false.into());
    }
    if schema.get("type").is_some_and(|kind| kind == "number") {
        schema.insert("type".to_owned(), json!(["number", "null"]));
    }
}

/// Returns the schemas of all `outputs` by command, and that of the output of a failed command.
pub fn all_schemas(outputs: impl IntoIterator<Item = OutputSchema>) -> Value {
    let mut by_command: BTreeMap<&str, Vec<Schema>> = BTreeMap::new();
    for (command, schema) in outputs {
        by_command.entry(command).or_default().push(schema());
    }
    let either = |mut schemas: Vec<Schema>| match schemas.len() {
        1 => Value::from(schemas.remove(0)),
        _ => json!({ "anyOf": schemas }),
    };
    let commands: BTreeMap<&str, Value> =
        by_command.into_iter().map(|(name, schemas)| (name, either(schemas))).collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "commands": commands,
        "error": schema_of::<FailureOutput>(),
    })
}
