//! Self-contained web pages: style, program and data in one file, without server or network.
//!
//! [`scene`] is the data of hand, objects and grasps; `data/page/viewer.js` draws it with its own depth buffer, so that
//! it looks the same in every browser and needs no GPU. [`annotation`] is the page on which people label grasps;
//! [`hover`] shows grasps for the elements of a picture, such as a [`tree`] or a [`map`].

pub mod annotation;
pub mod hover;
pub mod map;
pub mod scene;
pub mod tree;

use serde::Serialize;

const STYLE: &str = include_str!("../data/page/style.css");
const VIEWER: &str = include_str!("../data/page/viewer.js");

/// JSON that is safe inside a script element.
fn embedded(value: &impl Serialize) -> Result<String, serde_json::Error> {
    Ok(serde_json::to_string(value)?
        .replace("</", "<\\/")
        .replace('\u{2028}', "\\u2028")
        .replace('\u{2029}', "\\u2029"))
}

/// Escapes HTML's special characters.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A whole page with `body`, then `data`, the viewer, and `script`.
fn whole(title: &str, body: &str, data: &str, script: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n\
         {body}\n<script>const DATA = {data};</script>\n<script>{VIEWER}</script>\n<script>{script}</script>\n</body>\n</html>\n",
        escape(title)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_cannot_leave_its_script() {
        let text = embedded(&["</script><b>"]).expect("JSON");
        assert!(!text.contains("</script") && text.contains("<\\/script"));
        let page = whole("a < b", "", "{}", "");
        assert!(page.contains("<title>a &lt; b</title>") && !page.contains("http"));
    }
}
