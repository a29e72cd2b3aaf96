//! Small pieces of HTML: escaping, numbers in words and figures, tables, and the page around them.

use std::fmt::Write as _;

use crate::style;

/// `text` with the five characters that mean something to HTML, XML and quoted attributes replaced.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            // not allowed in XML 1.0, so a browser would refuse the whole figure
            c if c.is_control() && !matches!(c, '\n' | '\t') => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

/// `value` with `decimals` digits after the point; a dash where there is no number.
pub fn number(value: f64, decimals: usize) -> String {
    match value {
        v if v.is_nan() => "–".to_string(),
        v if v.is_infinite() => if v > 0.0 { "∞" } else { "−∞" }.to_string(),
        v => {
            let text = format!("{v:.decimals$}");
            // -0.00 reads as a mistake
            let zero = text.trim_start_matches('-').chars().all(|c| matches!(c, '0' | '.'));
            if zero { text.trim_start_matches('-').to_string() } else { text.replace('-', "−") }
        }
    }
}

/// A probability as papers print it: `2.1×10⁻¹⁷`, or `0.032`.
pub fn probability(p: f64) -> String {
    if !p.is_finite() {
        return "–".to_string();
    }
    if p == 0.0 {
        return "< 10⁻³⁰⁰".to_string();
    }
    if p >= 0.001 {
        return format!("{p:.3}");
    }
    let text = format!("{p:.1e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let raised: String = exponent.chars().map(superscript).collect();
    format!("{mantissa}×10{raised}")
}

/// The raised form of a digit or minus sign.
fn superscript(character: char) -> char {
    match character {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '0' => '⁰',
        c @ '4'..='9' => char::from_u32('⁴' as u32 + (c as u32 - '4' as u32)).unwrap_or(c),
        c => c,
    }
}

/// A time in the unit a reader would choose.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() || s < 0.0 => "–".to_string(),
        s if s < 120.0 => format!("{s:.1} s"),
        s if s < 7200.0 => format!("{:.0} min {:.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
        s => format!("{:.0} h {:.0} min", (s / 3600.0).floor(), ((s % 3600.0) / 60.0).floor()),
    }
}

/// `count` and the noun, in the plural where needed.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// How a column of a [`Table`] is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    /// Words: to the left.
    Words,
    /// Numbers: to the right, in figures of equal width.
    Numbers,
}

/// A table with a caption, a head row, and a head cell in every row. All text given to it is escaped by it.
pub struct Table {
    html: String,
    columns: Vec<Column>,
}

impl Table {
    /// Opens a table; `head` names its columns.
    pub fn new(caption: &str, head: &[(&str, Column)]) -> Self {
        let mut html = format!("<div class=\"scroll\"><table>\n<caption>{}</caption>\n<thead><tr>", escape(caption));
        for (name, column) in head {
            let _ = write!(html, "<th scope=\"col\"{}>{}</th>", class(*column), escape(name));
        }
        html += "</tr></thead>\n<tbody>\n";
        Self { html, columns: head.iter().map(|(_, column)| *column).collect() }
    }

    /// Adds a row; its first cell heads it.
    pub fn row<S: AsRef<str>>(&mut self, cells: &[S]) {
        self.html += "<tr>";
        for (index, cell) in cells.iter().enumerate() {
            let class = class(self.columns.get(index).copied().unwrap_or(Column::Words));
            let text = escape(cell.as_ref());
            let _ = match index {
                0 => write!(self.html, "<th scope=\"row\"{class}>{text}</th>"),
                _ => write!(self.html, "<td{class}>{text}</td>"),
            };
        }
        self.html += "</tr>\n";
    }

    /// Closes the table.
    pub fn finish(mut self) -> String {
        self.html += "</tbody>\n</table></div>\n";
        self.html
    }
}

fn class(column: Column) -> &'static str {
    match column {
        Column::Words => "",
        Column::Numbers => " class=\"number\"",
    }
}

/// A whole page in the report's style, `body` below its title.
pub fn whole_page(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{0}</title>\n<style>{1}{2}</style>\n\
         </head>\n<body>\n<main>\n<h1>{0}</h1>\n{body}</main>\n</body>\n</html>\n",
        escape(title),
        style::FIGURE,
        style::PAGE
    )
}

/// Bytes as an address that holds them (RFC 2397).
pub fn data_uri(media_type: &str, bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = format!("data:{media_type};base64,");
    for chunk in bytes.chunks(3) {
        let word = chunk.iter().fold(0u32, |word, byte| word << 8 | u32::from(*byte)) << (8 * (3 - chunk.len()));
        for place in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * place) & 63) as usize];
            text.push(if place <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vectors of RFC 4648.
    #[test]
    fn base_64() {
        for (bytes, text) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(data_uri("x/y", bytes.as_bytes()), format!("data:x/y;base64,{text}"));
        }
    }

    #[test]
    fn what_html_reads_as_markup_is_escaped() {
        assert_eq!(escape("<b> & \"c\" 'd'"), "&lt;b&gt; &amp; &quot;c&quot; &#39;d&#39;");
        assert_eq!(escape("a\u{0}b\u{1b}[0m"), "a\u{fffd}b\u{fffd}[0m");
    }

    #[test]
    fn numbers_read_as_in_print() {
        assert_eq!(number(0.4654, 3), "0.465");
        assert_eq!(number(-0.0001, 3), "0.000");
        assert_eq!(number(-1.25, 2), "−1.25");
        assert_eq!(number(f64::NAN, 3), "–");
        assert_eq!(probability(2.1e-17), "2.1×10⁻¹⁷");
        assert_eq!(probability(4.56e-8), "4.6×10⁻⁸");
        assert_eq!(probability(0.0321), "0.032");
        assert_eq!(probability(0.0), "< 10⁻³⁰⁰");
        assert_eq!(duration(3.25), "3.2 s");
        assert_eq!(duration(754.6), "12 min 34 s");
        assert_eq!(duration(7860.0), "2 h 11 min");
    }

    #[test]
    fn tables_have_scoped_heads_and_escaped_cells() {
        let mut table = Table::new("Rates & more", &[("what", Column::Words), ("rate", Column::Numbers)]);
        table.row(&["<cup>", "0.5"]);
        let html = table.finish();
        assert!(html.contains("<th scope=\"col\" class=\"number\">rate</th>"));
        assert!(html.contains("<th scope=\"row\">&lt;cup&gt;</th><td class=\"number\">0.5</td>"));
        assert!(html.contains("<caption>Rates &amp; more</caption>"));
    }
}
