//! The annotation page: shows every grasp in turn, to be rotated and labelled with a broad type, then with one of the 19.
//!
//! Labels stay in the browser until they are exported as the JSON that [`study::labels`] reads. Nothing on the page says what the
//! rules think: that would make the agreement between people and rules worthless.

use report::html::escape;
use serde::Serialize;
use study::labels::VERSION;
use study::taxonomy::Taxonomy;

use super::html_page::{embedded, whole};
use super::scene::Scene;

const SCRIPT: &str = include_str!("../../data/study/annotate.js");
const EXAMPLES: &str = include_str!("../../data/study/examples.json");

#[derive(Serialize)]
struct Data<'a> {
    version: u32,
    title: &'a str,
    scene: &'a Scene,
    types: &'a [study::taxonomy::GraspType],
    examples: serde_json::Value,
}

/// The page for the grasps of `scene`. Labels are kept in the browser under `title`: pages of different repertoires need
/// different ones.
pub fn page(taxonomy: &Taxonomy, scene: &Scene, title: &str) -> Result<String, serde_json::Error> {
    let examples = serde_json::from_str(EXAMPLES)?;
    let data = embedded(&Data { version: VERSION, title, scene, types: &taxonomy.types, examples })?;
    let body = format!(
        "<main>\n<h1>Which grasp is it?</h1>\n<p class=\"soft\">{}: {} grasps. Drag to turn, wheel to zoom, double click to start \
         over. First the broad type, then one of its types. Labels stay in this browser until you export them.</p>\n\
         <div class=\"columns\"><div><canvas class=\"view\" id=\"view\" width=\"560\" height=\"560\"></canvas>\n\
         <div class=\"row\"><button id=\"hand\" class=\"on\"><kbd>h</kbd> hand</button><button id=\"object\" class=\"on\"><kbd>o</kbd> \
         object</button><button id=\"contacts\" class=\"on\"><kbd>c</kbd> contacts</button></div>\n\
         <div class=\"row\"><button id=\"back\"><kbd>←</kbd> back</button><button id=\"next\"><kbd>→</kbd> next</button>\
         <button id=\"open\"><kbd>u</kbd> next without label</button><span id=\"name\" class=\"soft\"></span></div>\n\
         <progress id=\"progress\" value=\"0\" max=\"1\"></progress><div class=\"soft\" id=\"count\"></div>\n\
         <div class=\"row\"><label>Your name <input id=\"annotator\" size=\"12\"></label><button id=\"export\">export JSON</button>\
         <button id=\"clear\"><kbd>x</kbd> remove this label</button></div></div>\n\
         <div><div class=\"row\" id=\"broad\"></div><p id=\"what\" class=\"soft\"></p><div class=\"types\" id=\"types\"></div></div></div>\n\
         </main>",
        escape(title),
        scene.grasps()
    );
    Ok(whole("Grasp annotation", &body, &data, SCRIPT))
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
        let text = page(&taxonomy, &Scene::new(&Hand::ftac(), Vec::new(), Vec::new()), "a test").expect("a page");
        for outside in ["http:", "https:", "src=", "@import", "fetch("] {
            assert!(!text.contains(outside), "{outside}");
        }
    }
}
