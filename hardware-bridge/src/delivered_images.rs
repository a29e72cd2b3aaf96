//! Tactile images that the robot's own driver delivers with its measurements.

use std::sync::{Arc, Mutex};

use hand_model::robot::{TactileFrame, TactileImage};

use crate::lock::lock;

/// Images on their way from a [`crate::robot_link::RobotLink`] to the controller. Clones share them.
#[derive(Debug, Clone, Default)]
pub struct DeliveredImages(Arc<Mutex<Queue>>);

#[derive(Debug, Default)]
struct Queue {
    requested: bool,
    frames: Vec<TactileFrame>,
    /// Images of each camera so far.
    counts: Vec<u64>,
}

impl DeliveredImages {
    /// Requests one image of every camera.
    pub fn request(&self) {
        lock(&self.0).requested = true;
    }

    /// Returns true if images were requested since the last call.
    pub fn take_request(&self) -> bool {
        std::mem::take(&mut lock(&self.0).requested)
    }

    /// Adds an image of a camera, taken at `time` (s on the bridge's clock).
    pub fn deliver(&self, camera: usize, time: f64, image: TactileImage) {
        let mut queue = lock(&self.0);
        if queue.counts.len() <= camera {
            queue.counts.resize(camera + 1, 0);
        }
        queue.counts[camera] += 1;
        let sequence = queue.counts[camera];
        queue.frames.push(TactileFrame { camera, time, sequence, image: Arc::new(image) });
    }

    /// Returns the images delivered since the last call.
    pub fn take(&self) -> Vec<TactileFrame> {
        std::mem::take(&mut lock(&self.0).frames)
    }
}
