//! Fields of a JSON Schema as a Markdown table: path, type and meaning.

use serde_json::{Map, Value};

use super::options::escaped;

/// A row of the table.
struct Field {
    path: String,
    kind: String,
    meaning: String,
}

/// Returns the description of a schema.
pub(super) fn meaning(schema: &Value) -> Option<String> {
    schema.get("description").and_then(Value::as_str).map(escaped)
}

/// Returns a table of all fields of `schema`, nested ones by their paths.
pub(super) fn table(schema: &Value) -> String {
    let mut fields = Vec::new();
    add(schema, "", &mut fields);
    let mut text = "| field | type | meaning |\n|---|---|---|\n".to_owned();
    for Field { path, kind, meaning } in fields {
        text += &format!("| `{path}` | {kind} | {meaning} |\n");
    }
    text
}

/// Appends the fields below `path`.
fn add(schema: &Value, path: &str, into: &mut Vec<Field>) {
    for alternative in alternatives(schema) {
        add(alternative, path, into);
    }
    if let Some(properties) = schema.get("properties").and_then(Value::as_object) {
        for name in in_order(schema, properties) {
            let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            let own = &properties[name];
            // Alternatives may share a field.
            if into.iter().all(|field| field.path != path) {
                into.push(Field { path: path.clone(), kind: kind(own), meaning: meaning(own).unwrap_or_default() });
            }
            add(own, &path, into);
        }
    }
    if let Some(each) = schema.get("additionalProperties").filter(|each| each.is_object()) {
        let path = if path.is_empty() { "X".to_owned() } else { format!("{path}.X") };
        if into.iter().all(|field| field.path != path) {
            into.push(Field { path: path.clone(), kind: kind(each), meaning: meaning(each).unwrap_or_default() });
        }
        add(each, &path, into);
    }
    if let Some(items) = schema.get("items").filter(|items| items.is_object()) {
        add(items, &format!("{path}[]"), into);
    }
}

/// Returns the schemas of which a value matches one, without null.
fn alternatives(schema: &Value) -> impl Iterator<Item = &Value> {
    let either = ["anyOf", "oneOf"].into_iter().filter_map(move |name| schema.get(name)?.as_array()).flatten();
    either.filter(|one| one.get("type").is_none_or(|kind| kind != "null"))
}

/// Returns the names of `properties` in the order of their declaration: first those that are always there.
fn in_order<'a>(schema: &'a Value, properties: &'a Map<String, Value>) -> Vec<&'a String> {
    let required: Vec<&str> =
        schema.get("required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str).collect();
    let always = required.iter().filter_map(|name| properties.get_key_value(*name).map(|(name, _)| name));
    always.chain(properties.keys().filter(|name| !required.contains(&name.as_str()))).collect()
}

/// Returns the type of a value in words.
fn kind(schema: &Value) -> String {
    let values = schema.get("enum").and_then(Value::as_array).into_iter().flatten().chain(schema.get("const"));
    let values: Vec<String> = values.map(|value| format!("`{value}`")).collect();
    if !values.is_empty() {
        return values.join(", ");
    }
    if let Some(found) = schema.get("type") {
        let names: Vec<&str> = found
            .as_str()
            .into_iter()
            .chain(found.as_array().into_iter().flatten().filter_map(Value::as_str))
            .collect();
        return names.into_iter().map(|name| named(name, schema)).collect::<Vec<_>>().join(" or ");
    }
    let mut kinds: Vec<String> = Vec::new();
    for kind in ["anyOf", "oneOf"].into_iter().filter_map(|name| schema.get(name)?.as_array()).flatten().map(kind) {
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    let values = kinds.iter().all(|kind| kind.starts_with('`'));
    kinds.join(if values { ", " } else { " or " })
}

fn named(name: &str, schema: &Value) -> String {
    match (name, schema.get("items"), schema.get("prefixItems").and_then(Value::as_array)) {
        ("array", Some(items), None) => format!("list of {}", kind(items)),
        ("array", _, Some(places)) => {
            format!("list of {}: {}", places.len(), places.iter().map(kind).collect::<Vec<_>>().join(", "))
        }
        ("array", None, None) => "list".to_owned(),
        ("boolean", ..) => "true or false".to_owned(),
        ("integer", ..) => "whole number".to_owned(),
        ("string", ..) => "text".to_owned(),
        (other, ..) => other.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn nested_fields_have_their_paths() {
        let schema = json!({
            "type": "object",
            "required": ["rate", "rows"],
            "properties": {
                "note": { "type": "string" },
                "rate": { "type": ["number", "null"], "description": "Rate of\nholds." },
                "rows": { "type": "array", "items": { "type": "object", "properties": { "ok": { "type": "boolean" } } } },
                "kind": { "anyOf": [{ "oneOf": [{ "const": "a" }, { "enum": ["b", "c"] }] }, { "type": "null" }] },
                "by": { "type": "object", "additionalProperties": { "type": "integer" } },
            },
        });
        let expected = "| field | type | meaning |\n|---|---|---|\n\
            | `rate` | number or null | Rate of holds. |\n\
            | `rows` | list of object |  |\n\
            | `rows[].ok` | true or false |  |\n\
            | `by` | object |  |\n\
            | `by.X` | whole number |  |\n\
            | `kind` | `\"a\"`, `\"b\"`, `\"c\"` or null |  |\n\
            | `note` | text |  |\n";
        assert_eq!(table(&schema), expected);
    }
}
