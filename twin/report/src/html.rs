//! Building blocks of pages: formatted numbers, tables, and the page around them. `maud` writes the markup and escapes
//! all text.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

use crate::style;

/// Formats `value` with `decimals` digits after the point; a dash if it is not a number.
pub fn format_number(value: f64, decimals: usize) -> String {
    match value {
        v if v.is_nan() => "–".to_string(),
        v if v.is_infinite() => if v > 0.0 { "∞" } else { "−∞" }.to_string(),
        v => {
            let text = format!("{v:.decimals$}");
            // -0.00 would look like a mistake
            let zero = text.trim_start_matches('-').chars().all(|c| matches!(c, '0' | '.'));
            if zero { text.trim_start_matches('-').to_string() } else { text.replace('-', "−") }
        }
    }
}

/// Formats a probability as in papers: `2.1×10⁻¹⁷`, or `0.032`.
pub fn format_probability(p: f64) -> String {
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

/// Returns the superscript of a digit or minus sign.
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

/// Formats a time in a readable unit.
pub fn format_duration(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() || s < 0.0 => "–".to_string(),
        s if s < 120.0 => format!("{s:.1} s"),
        s if s < 7200.0 => format!("{:.0} min {:.0} s", (s / 60.0).floor(), (s % 60.0).floor()),
        s => format!("{:.0} h {:.0} min", (s / 3600.0).floor(), ((s % 3600.0) / 60.0).floor()),
    }
}

/// Returns `count` and the noun, in the plural if needed.
pub fn count_with_noun(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// Alignment of a column of a [`HtmlTable`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnAlignment {
    /// Words, aligned left.
    Words,
    /// Numbers, aligned right in figures of equal width.
    Numbers,
}

impl ColumnAlignment {
    fn class(self) -> Option<&'static str> {
        (self == Self::Numbers).then_some("number")
    }
}

/// A table with a caption, a head row, and a head cell in every row.
pub struct HtmlTable {
    caption: String,
    head: Vec<(String, ColumnAlignment)>,
    rows: Vec<Vec<String>>,
}

impl HtmlTable {
    /// Creates a table without rows. `head` names its columns.
    pub fn new(caption: &str, head: &[(&str, ColumnAlignment)]) -> Self {
        let head = head.iter().map(|(name, column)| ((*name).to_owned(), *column)).collect();
        Self { caption: caption.to_owned(), head, rows: Vec::new() }
    }

    /// Adds a row. Its first cell is the row's head.
    pub fn row<S: AsRef<str>>(&mut self, cells: &[S]) {
        self.rows.push(cells.iter().map(|cell| cell.as_ref().to_owned()).collect());
    }
}

impl Render for HtmlTable {
    fn render(&self) -> Markup {
        html! {
            div.scroll { table {
                caption { (self.caption) }
                thead { tr { @for (name, column) in &self.head { th scope="col" class=[column.class()] { (name) } } } }
                tbody {
                    @for row in &self.rows {
                        tr {
                            @for (n, ((_, column), cell)) in self.head.iter().zip(row).enumerate() {
                                @if n == 0 { th scope="row" class=[column.class()] { (cell) } }
                                @else { td class=[column.class()] { (cell) } }
                            }
                        }
                    }
                }
            } }
        }
    }
}

/// Returns a whole page in the report's style, with `body` below its title.
pub fn whole_page(title: &str, body: &Markup) -> String {
    page(title, "", &html! { h1 { (title) } (body) }, "")
}

/// Returns a page in the report's style, with `more` style rules, and with `script` after `main`.
pub fn page(title: &str, more: &str, main: &Markup, script: &str) -> String {
    printable(html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(style::FIGURE_CSS)) (PreEscaped(style::PAGE_CSS)) (PreEscaped(more)) }
            }
            body { main { (main) } @if !script.is_empty() { script { (PreEscaped(script)) } } }
        }
    })
}

/// Converts markup to the text of a file. Control characters are replaced: XML 1.0 forbids them, and a browser would
/// refuse the whole figure.
pub fn printable(markup: Markup) -> String {
    markup.into_string().replace(|c: char| c.is_control() && !matches!(c, '\n' | '\t'), "\u{fffd}")
}

/// Encodes bytes as a data URI (RFC 2397).
pub fn data_uri(media_type: &str, bytes: &[u8]) -> String {
    format!("data:{media_type};base64,{}", BASE64_STANDARD.encode(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_browser_would_refuse_is_replaced() {
        let page = whole_page("<b> & \"c\"", &html! { p { "a\u{0}b\u{1b}[0m" } });
        assert!(
            page.contains("<title>&lt;b&gt; &amp; &quot;c&quot;</title>") && page.contains("a\u{fffd}b\u{fffd}[0m")
        );
    }

    #[test]
    fn numbers_read_as_in_print() {
        assert_eq!(format_number(0.4654, 3), "0.465");
        assert_eq!(format_number(-0.0001, 3), "0.000");
        assert_eq!(format_number(-1.25, 2), "−1.25");
        assert_eq!(format_number(f64::NAN, 3), "–");
        assert_eq!(format_probability(2.1e-17), "2.1×10⁻¹⁷");
        assert_eq!(format_probability(4.56e-8), "4.6×10⁻⁸");
        assert_eq!(format_probability(0.0321), "0.032");
        assert_eq!(format_probability(0.0), "< 10⁻³⁰⁰");
        assert_eq!(format_duration(3.25), "3.2 s");
        assert_eq!(format_duration(754.6), "12 min 34 s");
        assert_eq!(format_duration(7860.0), "2 h 11 min");
    }

    #[test]
    fn tables_have_scoped_heads_and_escaped_cells() {
        let mut table =
            HtmlTable::new("Rates & more", &[("what", ColumnAlignment::Words), ("rate", ColumnAlignment::Numbers)]);
        table.row(&["<cup>", "0.5"]);
        let html = table.render().into_string();
        assert!(html.contains("<th scope=\"col\" class=\"number\">rate</th>"));
        assert!(html.contains("<th scope=\"row\">&lt;cup&gt;</th><td class=\"number\">0.5</td>"));
        assert!(html.contains("<caption>Rates &amp; more</caption>"));
    }
}
