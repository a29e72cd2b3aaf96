//! Picture with grasps shown in 3D. An element with `data-grasp` (and a caption in `data-text`) shows its grasp under
//! the mouse; a canvas with it shows the grasp permanently and can be rotated.

use maud::{Markup, html};
use serde::Serialize;

use super::html_page::{embedded, whole_page};
use super::scene::PageScene;

const SCRIPT: &str = include_str!("../../data/study/hover.js");

#[derive(Serialize)]
struct Data<'a> {
    scene: &'a PageScene,
}

/// Returns the page; `body` contains the picture.
pub fn page(title: &str, introduction: &str, body: &Markup, scene: &PageScene) -> Result<String, serde_json::Error> {
    let data = embedded(&Data { scene })?;
    let body = html! {
        main { h1 { (title) } p.soft { (introduction) } (body) }
        div.tip id="tip" { canvas width="246" height="246" {} div {} }
    };
    Ok(whole_page(title, &body, &data, SCRIPT))
}

/// Returns a row of grasps that can be rotated: (index in the scene, caption).
pub fn gallery(grasps: &[(usize, String)]) -> Markup {
    html! {
        div.row style="align-items:start" {
            @for (grasp, words) in grasps {
                figure style="margin:0;width:190px" {
                    canvas data-grasp=(grasp) width="190" height="190" {}
                    figcaption.soft { (words) }
                }
            }
        }
    }
}
