//! A picture with grasps shown in 3D: an element with `data-grasp` (and a caption in `data-text`) shows its grasp under
//! the mouse; a canvas with it shows the grasp permanently and can be rotated.

use report::html::escape;
use serde::Serialize;

use super::html_page::{embedded, whole};
use super::scene::Scene;

const SCRIPT: &str = include_str!("../../data/study/hover.js");

#[derive(Serialize)]
struct Data<'a> {
    scene: &'a Scene,
}

/// The page: `body` is HTML with the picture in it.
pub fn page(title: &str, introduction: &str, body: &str, scene: &Scene) -> Result<String, serde_json::Error> {
    let data = embedded(&Data { scene })?;
    let body = format!(
        "<main>\n<h1>{}</h1>\n<p class=\"soft\">{}</p>\n{body}\n</main>\n<div class=\"tip\" id=\"tip\"><canvas width=\"246\" \
         height=\"246\"></canvas><div></div></div>",
        escape(title),
        escape(introduction)
    );
    Ok(whole(title, &body, &data, SCRIPT))
}

/// A row of grasps that can be rotated: (index in the scene, caption).
pub fn gallery(grasps: &[(usize, String)]) -> String {
    let one = |(grasp, words): &(usize, String)| {
        format!(
            "<figure style=\"margin:0;width:190px\"><canvas data-grasp=\"{grasp}\" width=\"190\" height=\"190\"></canvas>\
             <figcaption class=\"soft\">{}</figcaption></figure>\n",
            escape(words)
        )
    };
    format!("<div class=\"row\" style=\"align-items:start\">{}</div>\n", grasps.iter().map(one).collect::<String>())
}
