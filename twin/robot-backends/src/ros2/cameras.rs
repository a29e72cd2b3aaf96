//! The tactile images of a robot on ROS 2 topics, received in a thread of its own.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use hand_model::Hand;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use hardware_bridge::clock::Clock;
use hardware_bridge::delivered_images::DeliveredImages;
use robot_ros2::messages::{CdrError, Image};
use robot_ros2::{QosProfile, Ros2Error, Ros2Node, Subscription};

use super::config::CameraTopics;
use super::stamps::StampClock;

/// Pause between two looks for images.
const POLL_INTERVAL: Duration = Duration::from_millis(2);

/// Thread that receives the images, and its failure.
pub struct Ros2Cameras {
    failure: Arc<Mutex<Option<String>>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

/// A camera's topic.
struct CameraTopic {
    images: Subscription<Image>,
    stamps: StampClock,
    /// Time from which on an image is requested, s on the bridge's clock.
    requested_at: Option<f64>,
}

impl Ros2Cameras {
    /// Subscribes to the images of all cameras, waits for one of each, and starts the thread. A requested image, taken
    /// after the request, goes to `images` with its time on `clock`.
    ///
    /// # Errors
    /// [`Ros2Error::Silent`] with the topic on which no image arrived within `timeout`, and [`Ros2Error::Message`] for one
    /// of another format or size.
    pub fn start(
        node: &Ros2Node,
        topics: &CameraTopics,
        hand: &Hand,
        images: DeliveredImages,
        clock: &Clock,
        timeout: Duration,
    ) -> Result<Self, Ros2Error> {
        let subscribe = |topic: String| node.subscribe::<Image>(&topic, QosProfile::BestEffort);
        let subscribed: Vec<Subscription<Image>> =
            hand.cameras.iter().map(|camera| subscribe(topics.topic(&camera.name))).collect::<Result<_, _>>()?;
        for topic in &subscribed {
            // The first image has to be one that can be used.
            let first = topic.wait(timeout)?;
            rgb(first).map_err(|source| Ros2Error::Message {
                topic: topic.topic().to_owned(),
                domain: node.domain(),
                source,
            })?;
        }
        let (failure, stop) = (Arc::new(Mutex::new(None)), Arc::new(AtomicBool::new(false)));
        let mut receiver = Receiver {
            cameras: subscribed
                .into_iter()
                .map(|images| CameraTopic { images, stamps: StampClock::default(), requested_at: None })
                .collect(),
            images,
            clock: clock.clone(),
        };
        let (noted, stopped) = (failure.clone(), stop.clone());
        let run = move || {
            while !stopped.load(Ordering::Relaxed) {
                if let Err(error) = receiver.receive() {
                    *lock(&noted) = Some(error);
                    return;
                }
                std::thread::sleep(POLL_INTERVAL);
            }
        };
        let failed = |error: std::io::Error| Ros2Error::Dds {
            item: "thread of the cameras".to_owned(),
            domain: node.domain(),
            reason: error.to_string(),
        };
        let thread = std::thread::Builder::new().name("ROS 2 cameras".into()).spawn(run).map_err(failed)?;
        Ok(Self { failure, stop, thread: Some(thread) })
    }

    /// Returns the reason why no more images are received, if there is one.
    pub fn failure(&self) -> Option<String> {
        lock(&self.failure).clone()
    }
}

impl Drop for Ros2Cameras {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has reported that itself.
            let _ = thread.join();
        }
    }
}

struct Receiver {
    cameras: Vec<CameraTopic>,
    images: DeliveredImages,
    clock: Clock,
}

impl Receiver {
    /// Takes the images that have arrived, and delivers those that were requested.
    fn receive(&mut self) -> Result<(), String> {
        if self.images.take_request() {
            let now = self.clock.now();
            self.cameras.iter_mut().for_each(|camera| camera.requested_at = Some(now));
        }
        for (n, camera) in self.cameras.iter_mut().enumerate() {
            let Some(image) = camera.images.take_newest().map_err(|error| error.to_string())? else { continue };
            let taken = camera.stamps.host_time(image.header.stamp.as_secs_f64(), self.clock.now());
            if camera.requested_at.is_none_or(|requested| taken < requested) {
                continue;
            }
            let rgb = rgb(image).map_err(|error| format!("{}: {error}", camera.images.topic()))?;
            camera.requested_at = None;
            self.images.deliver(n, taken, TactileImage { rgb });
        }
        Ok(())
    }
}

/// Returns the pixels of a tactile image.
fn rgb(image: Image) -> Result<Vec<u8>, CdrError> {
    let side = IMAGE_SIZE as u32;
    if (image.width, image.height) != (side, side) {
        let (found, expected) = (format!("{} x {} pixels", image.width, image.height), format!("{side} x {side}"));
        return Err(CdrError::Field { field: "width and height", found, expected });
    }
    image.into_rgb()
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic of another holder has been reported already.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
