//! The frame of a page that needs nothing else: style, program and data in one file, no server, no network.

use report::html::escape;
use serde::Serialize;

const STYLE: &str = include_str!("../../data/study/style.css");
const VIEWER: &str = include_str!("../../data/study/viewer.js");

/// JSON that may stand inside a script element.
pub fn embedded(value: &impl Serialize) -> Result<String, serde_json::Error> {
    Ok(serde_json::to_string(value)?
        .replace("</", "<\\/")
        .replace('\u{2028}', "\\u2028")
        .replace('\u{2029}', "\\u2029"))
}

/// A whole page: `body` in it, then the viewer, then `script`.
pub fn whole(title: &str, body: &str, data: &str, script: &str) -> String {
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
