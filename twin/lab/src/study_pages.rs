//! Pages and figures of the grasp study.
//!
//! [`overview`] is the page of the whole study, the paper beside this project; its rows are in [`comparison`].
//! [`classify_types`] draws the types by object, [`map`] the map of grasps, [`landscape`] the basins as a [`tree`], and
//! [`hands`] several hands on the same objects.
//!
//! Some pages show grasps that can be rotated in 3D. [`scene`] holds their data on hand, objects and grasps, and
//! `data/study/viewer.js` draws it with its own depth buffer, so that it looks the same in every browser and needs no
//! graphics adapter. [`annotation`] is the page on which people label grasps; [`hover`] shows grasps on the parts of a
//! picture.

pub mod annotation;
pub mod comparison;
pub mod hands;
pub mod hover;
mod html_page;
pub mod landscape;
pub mod map;
pub mod overview;
pub mod scene;
pub mod tree;
pub mod types;
