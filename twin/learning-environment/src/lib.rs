//! Learning environment: the simulated robot at the benchmark's table, stepped by a learner with twenty actions per
//! second.
//!
//! [`control::action`] defines and checks actions, and [`control::pad_images`] resizes the cameras' frames to one size.
//! [`scene`] carries actions out and observes, [`episode`] begins a task and judges it, and [`picture`] renders a scene
//! for people.
//!
//! A scene observes only a robot's measurements. Ground truth leaves it only through [`scene::TactileScene::truth`].
//! An [`episode::Judgement`] is made from ground truth, like a referee's verdict.

pub mod episode;
pub mod picture;
pub mod scene;

pub use control::pad_images::{ImageSizeError, PadImages};
pub use episode::{Episode, EpisodeError, EpisodeOptions, EpisodeTask, Judgement, Progress};
pub use picture::PictureSizeError;
pub use scene::{SceneError, SceneObject, SceneOptions, TactileScene};
