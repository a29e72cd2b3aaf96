//! Text of third parties, made safe for a terminal: nothing in it can control the terminal.
//!
//! Names, reasons and answers come from files, sockets and devices of strangers. An escape sequence in one of them
//! could clear the screen, rewrite earlier lines or set the window's title. [`printable`] is the one place that makes
//! such text harmless. The macros of this crate ([`eprintln!`](crate::eprintln) and [`eprint!`](crate::eprint)) apply
//! it to everything that a crate writes to stderr, once its root contains `#[macro_use] extern crate progress;`.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{self, Write as _};

/// True if `letter` may be a control code of a terminal rather than text: control characters of ASCII and of Latin-1
/// (U+0080 to U+009F), and those that change the writing direction. Line feed and tab are allowed.
fn is_control_code(letter: char) -> bool {
    let turns =
        matches!(letter, '\u{061c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    turns || letter.is_control() && !matches!(letter, '\n' | '\t')
}

/// Returns `text` with every possible control code escaped as in `\u001b`. This is the escape of JSON, so JSON stays
/// JSON.
pub fn printable(text: &str) -> Cow<'_, str> {
    if !text.contains(is_control_code) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for letter in text.chars() {
        if is_control_code(letter) {
            // Writing to a string cannot fail.
            let _ = write!(shown, "\\u{:04x}", u32::from(letter));
        } else {
            shown.push(letter);
        }
    }
    Cow::Owned(shown)
}

/// Writes `text` to stderr in its [`printable`] form. If stderr has no reader any more (a closed pipe, a terminal that
/// hung up), nothing happens and the work continues.
pub fn write_to_stderr(text: std::fmt::Arguments) {
    let _ = io::stderr().write_all(printable(&text.to_string()).as_bytes());
}

/// [`std::eprint!`] through [`write_to_stderr`].
#[macro_export]
macro_rules! eprint {
    ($($text:tt)*) => { $crate::write_to_stderr(::std::format_args!($($text)*)) };
}

/// [`std::eprintln!`] through [`write_to_stderr`].
#[macro_export]
macro_rules! eprintln {
    () => { $crate::write_to_stderr(::std::format_args!("\n")) };
    ($($text:tt)*) => { $crate::write_to_stderr(::std::format_args!("{}\n", ::std::format_args!($($text)*))) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escape_sequences_of_strangers_reach_no_terminal() {
        for (text, shown) in [
            ("\u{1b}[2J\u{1b}]0;owned\u{7}", "\\u001b[2J\\u001b]0;owned\\u0007"),
            ("over\rwritten\u{8}", "over\\u000dwritten\\u0008"),
            ("\u{9b}31m", "\\u009b31m"),
            ("\u{202e}txet", "\\u202etxet"),
            ("del\u{7f}", "del\\u007f"),
        ] {
            assert_eq!(printable(text), shown);
        }
        let own = "a table\twith columns,\n2.1×10⁻¹⁷ µm, 手\n";
        assert!(matches!(printable(own), Cow::Borrowed(same) if same == own));
    }
}
