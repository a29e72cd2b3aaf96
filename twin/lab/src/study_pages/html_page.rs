//! Frame of a self-contained page: style, program and data in one file, no server, no network.

use maud::{DOCTYPE, Markup, PreEscaped, html};
use report::html::printable;
use serde::Serialize;

const STYLE: &str = include_str!("../../data/study/style.css");
const VIEWER: &str = include_str!("../../data/study/viewer.js");

/// Serializes to JSON that is safe inside a script element.
pub fn embedded(value: &impl Serialize) -> Result<String, serde_json::Error> {
    Ok(serde_json::to_string(value)?
        .replace("</", "<\\/")
        .replace('\u{2028}', "\\u2028")
        .replace('\u{2029}', "\\u2029"))
}

/// Returns a whole page with `body`, followed by the viewer and `script`.
pub fn whole_page(title: &str, body: &Markup, data: &str, script: &str) -> String {
    printable(html! {
        (DOCTYPE)
        html lang="en" {
            head { meta charset="utf-8"; meta name="viewport" content="width=device-width"; title { (title) } style { (PreEscaped(STYLE)) } }
            body {
                (body)
                script { "const DATA = " (PreEscaped(data)) ";" }
                script { (PreEscaped(VIEWER)) }
                script { (PreEscaped(script)) }
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_cannot_leave_its_script() {
        let text = embedded(&["</script><b>"]).expect("JSON");
        assert!(!text.contains("</script") && text.contains("<\\/script"));
        let page = whole_page("a < b", &html! {}, "{}", "");
        assert!(page.contains("<title>a &lt; b</title>") && !page.contains("http"));
    }
}
