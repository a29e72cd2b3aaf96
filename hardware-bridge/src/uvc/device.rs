//! Open UVC devices: one thread per device takes its pictures, and cuts and keeps those that were requested.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use hand_model::robot::TactileFrame;
use linuxvideo::format::{PixFormat, PixelFormat};
use linuxvideo::stream::ReadStream;
use linuxvideo::{CapabilityFlags, Device, Fract};

use super::picture::Picture;
use crate::clock::Clock;
use crate::config::{UvcConfig, UvcFormat};
use crate::lock::lock;
use crate::tactile_link::counters::CameraCounters;
use crate::tactile_link::frame::digest;

/// Folder of the names of cameras, which survive replugging.
const BY_ID_FOLDER: &str = "/dev/v4l/by-id";
/// Polling interval for a picture.
const POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Silence after which a device is taken to be gone.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(2);
/// Frame rate that is requested, Hz.
const FRAME_RATE: u32 = 30;

/// Error of the UVC cameras.
#[derive(Debug, thiserror::Error)]
pub enum UvcError {
    /// No device, or several, have this name.
    #[error(
        "uvc device `{requested}`: found {found}, expected one: a path, a part of a name below {BY_ID_FOLDER} (it has the serial number), or the card's name"
    )]
    Which {
        /// Name in the configuration.
        requested: String,
        /// Devices found.
        found: String,
    },
    /// Error of the operating system.
    #[error("{device}: {source}")]
    Device { device: String, source: std::io::Error },
    /// The device offers another format than configured.
    #[error("{device}: found {found}, expected {expected}")]
    Format {
        device: String,
        /// Size and pixel format that it offers.
        found: String,
        /// Size and pixel format in the configuration.
        expected: String,
    },
}

#[derive(Default)]
struct ImageQueue {
    /// Counters of every camera of the hand.
    cameras: Vec<CameraCounters>,
    ready: Vec<TactileFrame>,
    failure: Option<String>,
}

/// Open UVC cameras.
pub struct UvcCameras {
    queue: Arc<Mutex<ImageQueue>>,
    /// Flag for each device, true if a picture of it is requested.
    requested: Vec<Arc<AtomicBool>>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl UvcCameras {
    /// Opens every device and starts streaming. Together the devices show all `cameras` cameras of the hand. Times are
    /// those of `clock`.
    ///
    /// # Errors
    /// A [`UvcError`] that names the first device that is not as configured.
    pub fn open(devices: &[UvcConfig], cameras: usize, clock: &Clock) -> Result<Self, UvcError> {
        let queue = Arc::new(Mutex::new(ImageQueue {
            cameras: vec![CameraCounters::default(); cameras],
            ..ImageQueue::default()
        }));
        let stop = Arc::new(AtomicBool::new(false));
        let mut cameras = Self { queue, requested: Vec::new(), stop, threads: Vec::new() };
        for config in devices {
            let name = config.device.clone();
            let failed = |source| UvcError::Device { device: name.clone(), source };
            let (stream, interval) = start(config)?;
            let requested = Arc::new(AtomicBool::new(false));
            let reader = DeviceReader {
                stream,
                interval,
                config: config.clone(),
                queue: cameras.queue.clone(),
                requested: requested.clone(),
                stop: cameras.stop.clone(),
                clock: clock.clone(),
            };
            let thread = std::thread::Builder::new().name("uvc camera".into()).spawn(move || reader.run());
            cameras.threads.push(thread.map_err(failed)?);
            cameras.requested.push(requested);
        }
        Ok(cameras)
    }

    /// Requests one image of every camera, from the next picture of each device.
    pub fn request_capture(&self) {
        self.requested.iter().for_each(|requested| requested.store(true, Ordering::Release));
    }

    /// Returns the images finished since the last call.
    pub fn take_images(&self) -> Vec<TactileFrame> {
        std::mem::take(&mut lock(&self.queue).ready)
    }

    /// Returns the counters of every camera. Lost images are estimated from the time between two pictures.
    pub fn camera_counters(&self) -> Vec<CameraCounters> {
        lock(&self.queue).cameras.clone()
    }

    /// Returns the device that stopped working, and the reason, if one did.
    pub fn failure(&self) -> Option<String> {
        lock(&self.queue).failure.clone()
    }
}

impl Drop for UvcCameras {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A thread that panicked has reported that itself.
            let _ = thread.join();
        }
    }
}

/// Opens the configured device for streaming; also returns the time between its pictures, s.
fn start(config: &UvcConfig) -> Result<(ReadStream, f64), UvcError> {
    let name = config.device.clone();
    let failed = |source| UvcError::Device { device: name.clone(), source };
    let device = Device::open(find(&name)?).map_err(failed)?;
    let pixels = match config.format {
        UvcFormat::Mjpeg => PixelFormat::MJPG,
        UvcFormat::Yuyv => PixelFormat::YUYV,
    };
    let [width, height] = config.size;
    let capture = device.video_capture(PixFormat::new(width, height, pixels)).map_err(failed)?;
    let shown = |width, height, pixels: PixelFormat| format!("{width} x {height} {pixels:?}");
    let (offered, expected) = (capture.format(), shown(width, height, pixels));
    let found = shown(offered.width(), offered.height(), offered.pixel_format());
    if found != expected {
        return Err(UvcError::Format { device: config.device.clone(), found, expected });
    }
    // Some drivers have only one rate and refuse the request.
    let interval = capture.set_frame_interval(Fract::new(1, FRAME_RATE)).unwrap_or(Fract::new(1, FRAME_RATE));
    let seconds = f64::from(interval.numerator()) / f64::from(interval.denominator().max(1));
    Ok((capture.into_stream().map_err(failed)?, seconds.max(1e-3)))
}

/// Returns the device file with this name.
fn find(name: &str) -> Result<PathBuf, UvcError> {
    if name.starts_with('/') {
        return Ok(PathBuf::from(name));
    }
    let not_one = |found: String| UvcError::Which { requested: name.to_owned(), found };
    let named = match std::fs::read_dir(BY_ID_FOLDER) {
        Ok(entries) => entries
            .flatten()
            .map(|entry| entry.path())
            // A camera has further indices for data other than pictures.
            .filter(|path| name_of(path).contains(name) && name_of(path).ends_with("index0"))
            .collect(),
        Err(_) => Vec::new(),
    };
    let found = if named.is_empty() { of_card(name) } else { named };
    match &found[..] {
        [one] => Ok(one.clone()),
        [] => Err(not_one("none".to_owned())),
        several => Err(not_one(several.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", "))),
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Returns the devices whose card has this name, except those that cannot be queried.
fn of_card(name: &str) -> Vec<PathBuf> {
    let Ok(devices) = linuxvideo::list() else { return Vec::new() };
    let is_it = |device: &Device| {
        device.capabilities().is_ok_and(|found| {
            found.card() == name && found.device_capabilities().contains(CapabilityFlags::VIDEO_CAPTURE)
        })
    };
    devices.flatten().filter(is_it).filter_map(|device| device.path().ok()).collect()
}

/// State of a device's thread.
struct DeviceReader {
    stream: ReadStream,
    interval: f64,
    config: UvcConfig,
    queue: Arc<Mutex<ImageQueue>>,
    requested: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    clock: Clock,
}

impl DeviceReader {
    fn run(mut self) {
        if let Err(error) = self.read_pictures() {
            lock(&self.queue).failure = Some(format!("{}: {error}", self.config.device));
        }
    }

    fn read_pictures(&mut self) -> std::io::Result<()> {
        let (mut last, mut sequence) = (Instant::now(), 0_u32);
        while !self.stop.load(Ordering::Relaxed) {
            if self.stream.will_block()? {
                if last.elapsed() > SILENCE_TIMEOUT {
                    return Err(std::io::ErrorKind::TimedOut.into());
                }
                std::thread::sleep(POLL_INTERVAL);
                continue;
            }
            // The flag is read before the picture is taken out: a request that comes in between gets the next picture.
            let requested = self.requested.load(Ordering::Acquire);
            let (data, damaged) = self.stream.dequeue(|view| Ok((view.to_vec(), view.is_error())))?;
            let now = self.clock.now();
            let passed = (std::mem::replace(&mut last, Instant::now()).elapsed().as_secs_f64() / self.interval).round();
            sequence = sequence.wrapping_add((passed as u32).max(1));
            self.note(&data, damaged, sequence);
            if requested && !damaged && self.deliver(&data, sequence, now) {
                self.requested.store(false, Ordering::Release);
            }
        }
        Ok(())
    }

    fn note(&self, data: &[u8], damaged: bool, sequence: u32) {
        let (mut queue, digest) = (lock(&self.queue), digest(data));
        for square in &self.config.squares {
            let camera = &mut queue.cameras[square.camera];
            camera.note_arrival(sequence, digest);
            camera.faults += u64::from(damaged);
        }
    }

    /// Cuts the picture into images; returns true if all its squares became images.
    fn deliver(&self, data: &[u8], sequence: u32, now: f64) -> bool {
        let size = (self.config.size[0], self.config.size[1]);
        let picture = match self.config.format {
            UvcFormat::Mjpeg => Picture::from_mjpeg(data, size),
            UvcFormat::Yuyv => Picture::from_yuyv(data, size),
        };
        let mut queue = lock(&self.queue);
        let mut whole = true;
        for square in &self.config.squares {
            match picture.as_ref().map(|picture| picture.square((square.x, square.y))) {
                Ok(Ok(image)) => {
                    queue.cameras[square.camera].note_decoded(now);
                    let (camera, sequence) = (square.camera, u64::from(sequence));
                    queue.ready.push(TactileFrame { camera, time: now, sequence, image: Arc::new(image) });
                }
                _ => {
                    queue.cameras[square.camera].undecodable += 1;
                    whole = false;
                }
            }
        }
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::UvcSquare;

    /// On a machine without such a device, the error names the device that was looked for.
    #[test]
    fn no_such_device() {
        let squares = vec![UvcSquare { camera: 0, x: 0, y: 0 }];
        let open = |device: &str| {
            let config = UvcConfig {
                device: device.into(),
                size: [640, 480],
                format: UvcFormat::Mjpeg,
                squares: squares.clone(),
            };
            UvcCameras::open(&[config], 1, &Clock::wall()).err().map(|error| error.to_string()).expect("no such device")
        };
        assert!(open("/dev/no-such-video").contains("/dev/no-such-video"));
        let message = open("no such serial");
        assert!(message.contains("no such serial") && message.contains("found none, expected one"), "{message}");
        // A file that is not a camera.
        let file = tempfile::NamedTempFile::new().expect("a file");
        let path = file.path().to_str().expect("UTF-8");
        assert!(open(path).contains(path));
    }
}
