//! Validation of JSON output against the schemas that `ftac schema` prints.

use std::sync::OnceLock;

use serde_json::{Map, Value};

/// Returns all schemas, as the program prints them.
fn schemas() -> &'static Value {
    static SCHEMAS: OnceLock<Value> = OnceLock::new();
    SCHEMAS.get_or_init(|| {
        let output = crate::ftac(&["schema"]).output().expect("ftac starts");
        serde_json::from_slice(&output.stdout).expect("ftac schema prints JSON")
    })
}

/// Validates each line of `stdout` against the schema of the command in `arguments`.
///
/// # Panics
/// If a line is not JSON, if the command has no schema, or if the line does not match it; the message names the place.
pub(crate) fn check(arguments: &[&str], stdout: &[u8]) {
    let words: Vec<&str> = arguments.iter().copied().filter(|word| !word.starts_with('-')).collect();
    let commands = schemas()["commands"].as_object().expect("commands");
    let command = (1..=2).rev().find_map(|count| commands.get_key_value(&words.get(..count)?.join(" ")));
    let Some((name, schema)) = command else { panic!("ftac schema: none for {arguments:?}") };
    for line in stdout.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()) {
        let found: Value = serde_json::from_slice(line).unwrap_or_else(|error| panic!("{name}: {error}"));
        if fault(&schemas()["error"], &found, "").is_none() {
            continue;
        }
        if let Some(fault) = fault(schema, &found, "") {
            panic!("{name} --json is not as `ftac schema {name}` says: {fault}");
        }
    }
}

/// Describes the first place in `found` that does not match `schema`. It knows only the keywords of JSON Schema that
/// are used here.
fn fault(schema: &Value, found: &Value, at: &str) -> Option<String> {
    let schema = schema.as_object().expect("a schema is an object");
    const VALIDATED_KEYWORDS: &str = "additionalProperties anyOf const enum items maxItems maxLength maximum minItems minLength minimum oneOf \
                           prefixItems properties required type";
    const ANNOTATION_KEYWORDS: [&str; 3] = ["$schema", "description", "format"];
    let known = |key: &str| {
        ANNOTATION_KEYWORDS.contains(&key) || VALIDATED_KEYWORDS.split_whitespace().any(|checked| checked == key)
    };
    let unknown: Vec<&String> = schema.keys().filter(|key| !known(key)).collect();
    assert!(unknown.is_empty(), "{at}: keywords that are not checked: {unknown:?}");
    if let Some(Value::Array(either)) = schema.get("anyOf").or(schema.get("oneOf")) {
        // If none matches, the fault against the first one tells most.
        let faults: Vec<String> = either.iter().map_while(|schema| fault(schema, found, at)).collect();
        return (faults.len() == either.len()).then(|| faults.into_iter().next()).flatten();
    }
    if let Some(expected) = schema.get("type")
        && !types(expected).any(|name| is(found, name))
    {
        return Some(format!("{at}: found {found}, expected {expected}"));
    }
    let wanted = schema.get("enum").and_then(Value::as_array).map_or_else(Vec::new, |either| either.iter().collect());
    let wanted: Vec<&Value> = wanted.into_iter().chain(schema.get("const")).collect();
    if !wanted.is_empty() && !wanted.contains(&found) {
        return Some(format!("{at}: found {found}, expected one of {wanted:?}"));
    }
    match found {
        Value::Array(items) => items_fault(schema, items, at),
        Value::String(text) => count_fault(schema, ("minLength", "maxLength"), text.chars().count(), at),
        Value::Object(fields) => fields_fault(schema, fields, at),
        Value::Number(number) => {
            let bound = |name: &str, or: f64| schema.get(name).and_then(Value::as_f64).unwrap_or(or);
            let range = bound("minimum", f64::NEG_INFINITY)..=bound("maximum", f64::INFINITY);
            let inside = number.as_f64().is_some_and(|number| range.contains(&number));
            (!inside).then(|| format!("{at}: found {number}, expected {range:?}"))
        }
        _ => None,
    }
}

fn items_fault(schema: &Map<String, Value>, items: &[Value], at: &str) -> Option<String> {
    let count = count_fault(schema, ("minItems", "maxItems"), items.len(), at);
    let places = schema.get("prefixItems").and_then(Value::as_array);
    count.or_else(|| {
        items.iter().enumerate().find_map(|(n, item)| {
            let schema = places.and_then(|places| places.get(n)).or(schema.get("items"))?;
            fault(schema, item, &format!("{at}/{n}"))
        })
    })
}

fn count_fault(schema: &Map<String, Value>, bounds: (&str, &str), found: usize, at: &str) -> Option<String> {
    let bound = |name: &str, or: usize| schema.get(name).and_then(Value::as_u64).map_or(or, |count| count as usize);
    let range = bound(bounds.0, 0)..=bound(bounds.1, usize::MAX);
    (!range.contains(&found)).then(|| format!("{at}: found a length of {found}, expected {range:?}"))
}

fn fields_fault(schema: &Map<String, Value>, fields: &Map<String, Value>, at: &str) -> Option<String> {
    let required = schema.get("required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str);
    let missing = required.into_iter().find(|name| !fields.contains_key(*name));
    if let Some(name) = missing {
        return Some(format!("{at}: found no `{name}`"));
    }
    fields.iter().find_map(|(name, value)| {
        let place = format!("{at}/{name}");
        let own = schema.get("properties").and_then(|properties| properties.get(name));
        match own.or(schema.get("additionalProperties")) {
            Some(Value::Bool(false)) => Some(format!("{place}: no such field in the schema")),
            None | Some(Value::Bool(true)) => None,
            Some(schema) => fault(schema, value, &place),
        }
    })
}

fn types(expected: &Value) -> impl Iterator<Item = &str> {
    let many = expected.as_array().into_iter().flatten();
    many.chain(expected.is_string().then_some(expected)).filter_map(Value::as_str)
}

fn is(found: &Value, name: &str) -> bool {
    match name {
        "null" => found.is_null(),
        "boolean" => found.is_boolean(),
        "integer" => found.is_u64() || found.is_i64(),
        "number" => found.is_number(),
        "string" => found.is_string(),
        "array" => found.is_array(),
        "object" => found.is_object(),
        _ => panic!("type: found {name}"),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::fault;

    #[test]
    fn faults_name_their_place() {
        let schema = json!({
            "type": "object", "required": ["rows"], "additionalProperties": false,
            "properties": {"rows": {"type": "array", "maxItems": 2, "items": {"type": ["number", "null"], "minimum": 0}},
                           "verdict": {"oneOf": [{"const": "good"}, {"enum": ["short", "open"]}]},
                           "rates": {"type": "object", "additionalProperties": {"type": "integer"}}},
        });
        let of = |found| fault(&schema, &found, "");
        assert_eq!(of(json!({"rows": [1.5, null], "rates": {"ball": 3}})), None);
        assert_eq!(
            of(json!({"rows": [1, "two"]})).as_deref(),
            Some("/rows/1: found \"two\", expected [\"number\",\"null\"]")
        );
        assert_eq!(of(json!({"rows": [-1]})).as_deref(), Some("/rows/0: found -1, expected 0.0..=inf"));
        assert_eq!(of(json!({"rows": [1, 2, 3]})).as_deref(), Some("/rows: found a length of 3, expected 0..=2"));
        assert_eq!(of(json!({"rows": [], "verdict": "open"})), None);
        assert!(
            of(json!({"rows": [], "verdict": "bad"})).is_some_and(|fault| fault.starts_with("/verdict: found \"bad\""))
        );
        assert_eq!(of(json!({"rates": {}})).as_deref(), Some(": found no `rows`"));
        assert_eq!(
            of(json!({"rows": [], "rates": {"ball": 0.5}})).as_deref(),
            Some("/rates/ball: found 0.5, expected \"integer\"")
        );
        assert_eq!(of(json!({"rows": [], "lines": 1})).as_deref(), Some("/lines: no such field in the schema"));
    }
}
