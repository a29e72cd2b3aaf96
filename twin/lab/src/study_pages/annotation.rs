//! Annotation page: shows every grasp in turn, to be rotated and labelled first with a broad type, then with one of the
//! 19.
//!
//! Labels stay in the browser until they are exported as the JSON that [`grasp_analysis::read_labels`] reads. Nothing
//! on the page reveals the result of the rules, so that the agreement between people and rules stays meaningful.

use dexterous_grasping::taxonomy::Taxonomy;
use grasp_analysis::labels::VERSION;
use maud::html;
use serde::Serialize;

use super::html_page::{embedded, whole_page};
use super::scene::PageScene;

const SCRIPT: &str = include_str!("../../data/study/annotate.js");
const EXAMPLES: &str = include_str!("../../data/study/examples.json");

#[derive(Serialize)]
struct Data<'a> {
    version: u32,
    title: &'a str,
    scene: &'a PageScene,
    types: &'a [dexterous_grasping::taxonomy::GraspType],
    examples: serde_json::Value,
}

/// Returns the page for the grasps of `scene`. Labels are kept in the browser under `title`; pages of different
/// repertoires need different titles.
pub fn page(taxonomy: &Taxonomy, scene: &PageScene, title: &str) -> Result<String, serde_json::Error> {
    let examples = serde_json::from_str(EXAMPLES)?;
    let data = embedded(&Data { version: VERSION, title, scene, types: &taxonomy.types, examples })?;
    let button = |id: &str, key: &str, words: &str| html! { button id=(id) { kbd { (key) } " " (words) } };
    let shown = |id: &str, key: &str| html! { button.on id=(id) { kbd { (key) } " " (id) } };
    let body = html! { main {
        h1 { "Annotation of grasps" }
        p.soft {
            (title) ": " (scene.grasp_count()) " grasps. Drag to turn, wheel to zoom, double click to start over. First the broad type, then one of its \
            types. Labels stay in this browser until you export them."
        }
        div.columns {
            div {
                canvas.view id="view" width="560" height="560" {}
                div.row { (shown("hand", "h")) (shown("object", "o")) (shown("contacts", "c")) }
                div.row {
                    (button("back", "←", "back")) (button("next", "→", "next")) (button("open", "u", "next without label"))
                    span.soft id="name" {}
                }
                progress id="progress" value="0" max="1" {}
                div.soft id="count" {}
                div.row {
                    label { "Your name " input id="annotator" size="12"; }
                    button id="export" { "export JSON" }
                    (button("clear", "x", "remove this label"))
                }
            }
            div { div.row id="broad" {} p.soft id="what" {} div.types id="types" {} }
        }
    } };
    Ok(whole_page("Grasp annotation", &body, &data, SCRIPT))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::Hand;

    /// Every type has an example posture, and the page loads nothing from outside.
    #[test]
    fn every_type_has_a_picture() {
        let taxonomy = Taxonomy::paper();
        let examples: serde_json::Value = serde_json::from_str(EXAMPLES).expect("JSON");
        for kind in &taxonomy.types {
            let bends = examples[&kind.name]["bends"].as_array().map(Vec::len);
            assert_eq!(bends, Some(5), "{}", kind.name);
        }
        let text = page(&taxonomy, &PageScene::new(&Hand::ftac(), Vec::new(), Vec::new()), "a test").expect("a page");
        for outside in ["http:", "https:", "src=", "@import", "fetch("] {
            assert!(!text.contains(outside), "{outside}");
        }
    }
}
