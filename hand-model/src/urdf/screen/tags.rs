//! The tags of an XML text in order, without a tree: comments, instructions and character data are skipped.

use std::path::Path;

use ftac_platform::data::DataError;

/// Largest number of attributes of an element; a URDF's own have eight at most.
const MAX_ATTRIBUTES: usize = 64;

/// A start tag.
pub(crate) struct StartTag<'a> {
    pub name: &'a str,
    pub attributes: Vec<(&'a str, &'a str)>,
    /// Line, from 1.
    pub line: usize,
    /// Byte offsets behind the last attribute (or the name), and behind the tag.
    pub attributes_end: usize,
    pub end: usize,
    /// True for a self-closing tag.
    pub self_closing: bool,
}

impl<'a> StartTag<'a> {
    pub(crate) fn attribute(&self, name: &str) -> Option<&'a str> {
        self.attributes.iter().find(|(own, _)| *own == name).map(|(_, value)| *value)
    }

    /// Returns the namespace prefixes that it declares.
    pub(crate) fn prefixes(&self) -> impl Iterator<Item = &'a str> {
        self.attributes.iter().filter_map(|(name, _)| name.strip_prefix("xmlns:"))
    }
}

/// A tag.
pub(crate) enum Tag<'a> {
    Open(StartTag<'a>),
    /// The end of an element: its name, its line, and its byte offset.
    Close {
        name: &'a str,
        line: usize,
        at: usize,
    },
}

/// Iterator over the tags of a text; ends after the first error.
pub(crate) struct Tags<'a> {
    text: &'a str,
    path: &'a Path,
    at: usize,
    /// Line number at offset `counted`, from 1.
    line: usize,
    counted: usize,
}

impl<'a> Tags<'a> {
    /// Creates the iterator over `text`; `path` is used in errors only.
    pub(crate) fn new(text: &'a str, path: &'a Path) -> Self {
        Self { text, path, at: 0, line: 1, counted: 0 }
    }

    fn line(&mut self) -> usize {
        self.line += self.text[self.counted..self.at].matches('\n').count();
        self.counted = self.at;
        self.line
    }

    fn fault(&mut self, found: &str, expected: &str) -> DataError {
        let line = self.line();
        self.at = self.text.len();
        DataError::Line { path: self.path.into(), line, found: found.into(), expected: expected.into() }
    }

    /// Moves behind the next `end`.
    fn skip(&mut self, what: &str, end: &str) -> Result<(), DataError> {
        match self.text[self.at..].find(end) {
            Some(found) => {
                self.at += found + end.len();
                Ok(())
            }
            None => Err(self.fault(&format!("{what} that does not end"), &format!("`{end}` behind it"))),
        }
    }

    fn start(&mut self) -> Result<StartTag<'a>, DataError> {
        let line = self.line();
        let text = self.text;
        let space = |c: char| c.is_ascii_whitespace();
        let name_end = |from: usize| {
            text[from..]
                .find(|c: char| space(c) || matches!(c, '/' | '>' | '=' | '<' | '"' | '\''))
                .map_or(text.len(), |n| from + n)
        };
        let mut at = name_end(self.at + 1);
        let name = &text[self.at + 1..at];
        if name.is_empty() {
            return Err(self.fault("`<` without a name", "an element, or `&lt;`"));
        }
        let mut attributes = Vec::new();
        let mut attributes_end = at;
        loop {
            at += text[at..].len() - text[at..].trim_start().len();
            let rest = &text[at..];
            if rest.starts_with("/>") {
                return Ok(StartTag { name, attributes, line, attributes_end, end: at + 2, self_closing: true });
            }
            if rest.starts_with('>') {
                return Ok(StartTag { name, attributes, line, attributes_end, end: at + 1, self_closing: false });
            }
            let end = name_end(at);
            let attribute = &text[at..end];
            let after = text[end..].trim_start();
            let value = after.strip_prefix('=').map(str::trim_start);
            let quote = value.and_then(|value| value.chars().next()).filter(|c| matches!(c, '"' | '\''));
            let (Some(value), Some(quote), false) = (value, quote, attribute.is_empty()) else {
                let expected = "attributes as name=\"value\", and `>` behind the last";
                return Err(self.fault(&format!("<{name}> with something else than attributes in it"), expected));
            };
            let Some(length) = value[1..].find(quote) else {
                return Err(self.fault(
                    &format!("<{name}>, whose attribute `{attribute}` does not end"),
                    "a quote behind its value",
                ));
            };
            if attributes.iter().any(|(known, _)| *known == attribute) {
                return Err(self.fault(&format!("<{name}> with `{attribute}` twice"), "each attribute once"));
            }
            attributes.push((attribute, &value[1..=length]));
            if attributes.len() > MAX_ATTRIBUTES {
                let found = format!("<{name}> with more than {MAX_ATTRIBUTES} attributes");
                return Err(self.fault(&found, &format!("at most {MAX_ATTRIBUTES}")));
            }
            at = text.len() - value.len() + length + 2;
            attributes_end = at;
        }
    }

    fn tag(&mut self) -> Result<Option<Tag<'a>>, DataError> {
        loop {
            let Some(found) = self.text[self.at..].find('<') else { return Ok(None) };
            self.at += found;
            let rest = &self.text[self.at..];
            if rest.starts_with("<!--") {
                self.skip("a comment", "-->")?;
            } else if rest.starts_with("<![CDATA[") {
                self.skip("character data", "]]>")?;
            } else if rest.starts_with("<?") {
                self.skip("an instruction", "?>")?;
            } else if rest.starts_with("<!") {
                if rest.split('>').next().is_some_and(|declaration| declaration.contains('[')) {
                    return Err(
                        self.fault("a document type with declarations of its own", "none: a URDF needs no entities")
                    );
                }
                self.skip("a document type", ">")?;
            } else if let Some(name) = rest.strip_prefix("</") {
                let (line, at) = (self.line(), self.at);
                let Some(length) = name.find('>') else {
                    return Err(self.fault("an end of an element without `>`", "`>` behind its name"));
                };
                self.at += 2 + length + 1;
                return Ok(Some(Tag::Close { name: name[..length].trim_end(), line, at }));
            } else {
                let start = self.start()?;
                self.at = start.end;
                return Ok(Some(Tag::Open(start)));
            }
        }
    }
}

impl<'a> Iterator for Tags<'a> {
    type Item = Result<Tag<'a>, DataError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.tag().transpose()
    }
}
