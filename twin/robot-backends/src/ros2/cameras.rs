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

/// The cameras' topics, received in a thread once the servo cycle runs.
pub struct Ros2Cameras {
    /// The topics, until the thread takes them.
    receiver: Option<Receiver>,
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
    /// Subscribes to the images of all cameras of a hand, and waits for one of each. Requested images, taken after the
    /// request, go to `images` once the thread runs.
    ///
    /// # Errors
    /// [`Ros2Error::Silent`] with the topic on which no image arrived within `timeout`, and [`Ros2Error::Message`] for one
    /// of another format or size.
    pub fn subscribe(
        node: &Ros2Node,
        topics: &CameraTopics,
        hand: &Hand,
        images: DeliveredImages,
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
        let cameras = subscribed.into_iter().map(|images| CameraTopic {
            images,
            stamps: StampClock::default(),
            requested_at: None,
        });
        let receiver = Some(Receiver { cameras: cameras.collect(), images });
        Ok(Self { receiver, failure: Arc::default(), stop: Arc::default(), thread: None })
    }

    /// Starts the thread, unless it runs. Times are those of `clock`, the bridge's.
    pub fn start(&mut self, clock: &Clock) {
        let Some(mut receiver) = self.receiver.take() else { return };
        let (failure, stop, clock) = (self.failure.clone(), self.stop.clone(), clock.clone());
        let run = move || {
            while !stop.load(Ordering::Relaxed) {
                if let Err(error) = receiver.receive(&clock) {
                    *lock(&failure) = Some(error);
                    return;
                }
                std::thread::sleep(POLL_INTERVAL);
            }
        };
        match std::thread::Builder::new().name("ROS 2 cameras".into()).spawn(run) {
            Ok(thread) => self.thread = Some(thread),
            Err(error) => *lock(&self.failure) = Some(format!("thread of the cameras: {error}")),
        }
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
}

impl Receiver {
    /// Takes the images that have arrived, and delivers those that were requested.
    fn receive(&mut self, clock: &Clock) -> Result<(), String> {
        if self.images.take_request() {
            let now = clock.now();
            self.cameras.iter_mut().for_each(|camera| camera.requested_at = Some(now));
        }
        for (n, camera) in self.cameras.iter_mut().enumerate() {
            let Some(image) = camera.images.take_newest().map_err(|error| error.to_string())? else { continue };
            let taken = camera.stamps.host_time(image.header.stamp.as_secs_f64(), clock.now());
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
