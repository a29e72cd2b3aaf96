//! Parser of the table of figures.

use std::collections::BTreeMap;
use std::path::Path;

use super::error::FieldError;
use super::figure::{DecimalNumber, LabBookFigure, MachineIdle};

/// Names of the columns, in this order.
pub const COLUMNS: [&str; 17] = [
    "id",
    "value",
    "unit",
    "low",
    "high",
    "n",
    "seed",
    "commit",
    "machine",
    "idle",
    "command",
    "supersedes",
    "group",
    "figure",
    "paper",
    "goal",
    "note",
];

/// Parses the figures in `text`, the contents of `file`. Returns an error for other columns, for invalid fields, for an
/// interval that does not contain the value, and for a duplicate id.
pub fn parse(file: &Path, text: &str) -> Result<Vec<LabBookFigure>, FieldError> {
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(text.as_bytes());
    let broken =
        |line: u64, error: &csv::Error| FieldError::new((file, line), "row", error.to_string(), "comma-separated text");
    let header = reader.headers().map_err(|error| broken(1, &error))?;
    if header != COLUMNS.as_slice() {
        let found = header.iter().collect::<Vec<_>>().join(",");
        return Err(FieldError::new((file, 1), "row", format!("`{found}`"), format!("`{}`", COLUMNS.join(","))));
    }
    let mut figures = Vec::new();
    let mut lines = BTreeMap::new();
    for record in reader.records() {
        let last = figures.last().map_or(1, |figure: &LabBookFigure| figure.line);
        let record = record.map_err(|error| broken(last + 1, &error))?;
        let line = record.position().map_or(last + 1, csv::Position::line);
        let figure = Row { file, line, record: &record }.figure()?;
        if let Some(first) = lines.insert(figure.id.clone(), line) {
            let found = format!("`{}`, which is in line {first} already", figure.id);
            return Err(FieldError::new((file, line), "id", found, "a unique id"));
        }
        figures.push(figure);
    }
    Ok(figures)
}

/// A record with its location.
struct Row<'a> {
    file: &'a Path,
    line: u64,
    record: &'a csv::StringRecord,
}

impl Row<'_> {
    fn figure(&self) -> Result<LabBookFigure, FieldError> {
        if self.record.len() != COLUMNS.len() {
            let found = format!("{} fields", self.record.len());
            return Err(self.error("row", found, format!("{} fields", COLUMNS.len())));
        }
        let value = self.number("value")?;
        Ok(LabBookFigure {
            line: self.line,
            id: self.id()?,
            interval: self.interval(&value)?,
            value,
            unit: self.text("unit").to_owned(),
            n: self.optional("n", |text| text.parse().ok(), "a whole number or nothing")?,
            seed: self.optional("seed", seeds, "a whole number, first-last or nothing")?,
            commit: self
                .optional("commit", |text| is_commit(text).then(|| text.to_owned()), "a commit's hash or nothing")?
                .unwrap_or_default(),
            machine: self.filled("machine")?,
            idle: self.idle()?,
            command: self.filled("command")?,
            supersedes: self
                .optional("supersedes", |text| supersedes(text).then(|| text.to_owned()), "id@commit or nothing")?
                .unwrap_or_default(),
            group: self.filled("group")?,
            label: self.filled("figure")?,
            paper: self.text("paper").to_owned(),
            goal: self.text("goal").to_owned(),
            note: self.text("note").to_owned(),
        })
    }

    fn text(&self, field: &'static str) -> &str {
        let column = COLUMNS.iter().position(|column| *column == field);
        column.and_then(|column| self.record.get(column)).unwrap_or_default()
    }

    fn error(&self, field: &'static str, found: impl Into<String>, expected: impl Into<String>) -> FieldError {
        FieldError::new((self.file, self.line), field, found, expected)
    }

    fn filled(&self, field: &'static str) -> Result<String, FieldError> {
        match self.text(field) {
            "" => Err(self.error(field, "nothing", "text")),
            text => Ok(text.to_owned()),
        }
    }

    /// Parses a field with `read`; an empty field is `None`.
    fn optional<T>(
        &self,
        field: &'static str,
        read: impl Fn(&str) -> Option<T>,
        expected: &str,
    ) -> Result<Option<T>, FieldError> {
        match self.text(field) {
            "" => Ok(None),
            text => read(text).map(Some).ok_or_else(|| self.error(field, format!("`{text}`"), expected)),
        }
    }

    fn number(&self, field: &'static str) -> Result<DecimalNumber, FieldError> {
        self.text(field).parse().map_err(|found: String| self.error(field, found, "a number"))
    }

    fn id(&self) -> Result<String, FieldError> {
        let id = self.text("id");
        if is_id(id) {
            Ok(id.to_owned())
        } else {
            Err(self.error("id", format!("`{id}`"), "small letters, digits and _ in parts separated by dots"))
        }
    }

    fn interval(&self, value: &DecimalNumber) -> Result<Option<(DecimalNumber, DecimalNumber)>, FieldError> {
        match (self.text("low"), self.text("high")) {
            ("", "") => Ok(None),
            ("", _) => Err(self.error("low", "nothing", "a number, since there is a high")),
            (_, "") => Err(self.error("high", "nothing", "a number, since there is a low")),
            _ => {
                let (low, high) = (self.number("low")?, self.number("high")?);
                if low.value() > value.value() {
                    return Err(self.error("low", format!("`{low}`"), format!("at most the value, {value}")));
                }
                if high.value() < value.value() {
                    return Err(self.error("high", format!("`{high}`"), format!("at least the value, {value}")));
                }
                Ok(Some((low, high)))
            }
        }
    }

    fn idle(&self) -> Result<MachineIdle, FieldError> {
        match self.text("idle") {
            "yes" => Ok(MachineIdle::Yes),
            "no" => Ok(MachineIdle::No),
            "unknown" => Ok(MachineIdle::Unknown),
            other => Err(self.error("idle", format!("`{other}`"), "yes, no or unknown")),
        }
    }
}

fn is_id(text: &str) -> bool {
    let part =
        |part: &str| !part.is_empty() && part.bytes().all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'_'));
    text.split('.').all(part)
}

fn is_commit(text: &str) -> bool {
    (7..=40).contains(&text.len()) && text.bytes().all(|byte| matches!(byte, b'a'..=b'f' | b'0'..=b'9'))
}

fn supersedes(text: &str) -> bool {
    text.split_once('@').is_some_and(|(id, commit)| is_id(id) && is_commit(commit))
}

fn seeds(text: &str) -> Option<(u64, u64)> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let (first, last) = (first.parse().ok()?, last.parse().ok()?);
    (first <= last).then_some((first, last))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROW: [&str; 17] = [
        "bench.touch.success.mean",
        "0.982",
        "share",
        "0.97",
        "0.99",
        "600",
        "1",
        "97cfb79",
        "2 cores",
        "yes",
        "ftac bench",
        "bench.touch.success.mean@2033d18",
        "Benchmark",
        "success rate, touch",
        "1.000",
        "",
        "",
    ];

    fn with(changes: &[(&str, &str)]) -> [&'static str; 17] {
        let mut row = ROW;
        for (field, text) in changes {
            let column = COLUMNS.iter().position(|column| column == field).unwrap();
            row[column] = Box::leak((*text).to_owned().into_boxed_str());
        }
        row
    }

    fn read(rows: &[[&str; 17]]) -> Result<Vec<LabBookFigure>, FieldError> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(COLUMNS).unwrap();
        rows.iter().for_each(|row| writer.write_record(row).unwrap());
        parse(Path::new("figures.csv"), &String::from_utf8(writer.into_inner().unwrap()).unwrap())
    }

    #[test]
    fn a_number_keeps_the_digits_it_was_written_with() {
        let figures = read(&[with(&[("value", "1.000"), ("low", ""), ("high", "")])]).unwrap();
        assert_eq!(figures[0].value.to_string(), "1.000");
        assert_eq!(figures[0].value.value(), 1.0);
        assert_eq!((figures[0].n, figures[0].seed, figures[0].idle), (Some(600), Some((1, 1)), MachineIdle::Yes));
        assert_eq!(figures[0].interval, None);
    }

    #[test]
    fn several_seeds_are_first_and_last() {
        assert_eq!(read(&[with(&[("seed", "1-3")])]).unwrap()[0].seed, Some((1, 3)));
        assert_eq!(read(&[with(&[("seed", "")])]).unwrap()[0].seed, None);
    }

    #[test]
    fn a_field_that_is_not_what_its_column_holds_is_named() {
        for (field, text) in [
            ("id", ""),
            ("id", "Bench touch"),
            ("id", "bench..touch"),
            ("value", "many"),
            ("value", "NaN"),
            ("value", ""),
            ("low", "0.99"),
            ("low", ""),
            ("high", "0.97"),
            ("high", ""),
            ("high", "inf"),
            ("n", "1.5"),
            ("n", "-1"),
            ("seed", "3-1"),
            ("seed", "one"),
            ("commit", "main"),
            ("machine", ""),
            ("idle", "maybe"),
            ("command", ""),
            ("supersedes", "bench.touch.success.mean"),
            ("group", ""),
            ("figure", ""),
        ] {
            let error = read(&[ROW, with(&[("id", "another"), (field, text)])]).unwrap_err();
            assert_eq!((error.line, error.field), (3, field), "{error}");
        }
    }

    #[test]
    fn an_id_stands_once() {
        let error = read(&[ROW, with(&[("value", "0.98")])]).unwrap_err();
        assert_eq!((error.line, error.field), (3, "id"));
        assert_eq!(
            error.to_string(),
            "figures.csv:3: id: found `bench.touch.success.mean`, which is in line 2 already, expected a unique id"
        );
    }

    #[test]
    fn a_row_with_too_few_fields_and_a_foreign_header_are_refused() {
        let file = Path::new("figures.csv");
        let short = format!("{}\nbench.wall,440,s\n", COLUMNS.join(","));
        let error = parse(file, &short).unwrap_err();
        assert_eq!((error.line, error.found.as_str()), (2, "3 fields"));
        assert_eq!(parse(file, "id,value\n").unwrap_err().line, 1);
    }
}
