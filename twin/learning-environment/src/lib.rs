//! Scenes that a learner steps through: the simulated robot at the benchmark's table, twenty actions a second.
//!
//! [`control::action`] says what an action is and checks it, [`control::pad_images`] brings the cameras' frames to one size, [`scene`] carries
//! actions out and observes, [`episode`] begins a task and judges it, and [`picture`] shows a scene to people.
//!
//! What a scene observes is what a robot measures. The truth leaves by [`scene::Scene::truth`] alone; [`episode::Judgement`] is made from it, as
//! a referee's verdict is.

pub mod episode;
pub mod picture;
pub mod scene;

pub use control::pad_images::{ImageSizeError, PadImages};
pub use episode::{Episode, EpisodeError, Judgement, Options, Task};
pub use picture::PictureSizeError;
pub use scene::{Placed, Scene, SceneError, SceneOptions};
