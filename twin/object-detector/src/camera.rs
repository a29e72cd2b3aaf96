//! Emulated vision system for emulated robots: it detects the simulated objects with drawn errors and sends their poses
//! over a socket.

use std::io::{Read as _, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use scenarios::generator::trial_rng;

use super::measurement::format_line;
use super::stream::{DetectorStream, Listener};
use super::{Address, MAX_LINE_LENGTH, is_pending, unix_time};

/// Interval between polls of clients and requests.
const POLL_INTERVAL: Duration = Duration::from_millis(5);
/// Time limit of a client: one that reads nothing for this long is dropped.
const WRITE_TIMEOUT: Duration = Duration::from_millis(5);

/// Settings of the measurements.
#[derive(Debug, Clone, Copy)]
pub struct EmulatedDetectorSettings {
    /// Standard deviations of x, y and z, m, and of the rotation about the vertical, rad, drawn anew for each
    /// measurement.
    pub sigma: (f64, f64),
    pub seed: u64,
    /// Interval between measurements of every object. Without it, measurements are made on request only, so that
    /// the same requests get the same answers on any machine.
    pub period: Option<Duration>,
}

/// Returns the visible objects with their names and poses, `world_from_object`.
pub type VisibleObjects = Box<dyn Fn() -> Vec<(String, Isometry3<f64>)> + Send>;

/// A running emulated vision system; it ends when dropped.
pub struct EmulatedDetector {
    address: Address,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl EmulatedDetector {
    /// Starts the vision system at `address`; port 0 selects any free one.
    pub fn start(
        address: &Address,
        settings: EmulatedDetectorSettings,
        sight: VisibleObjects,
    ) -> std::io::Result<Self> {
        let listener = Listener::bind(address)?;
        let (address, stop) = (listener.address()?, Arc::new(AtomicBool::new(false)));
        let stopped = stop.clone();
        let run = move || serve(&listener, settings, &sight, &stopped);
        let thread = std::thread::Builder::new().name("camera".into()).spawn(run)?;
        Ok(Self { address, stop, thread: Some(thread) })
    }

    /// Returns the address of the vision system.
    pub fn address(&self) -> &Address {
        &self.address
    }
}

impl Drop for EmulatedDetector {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic is reported by the thread's own panic message.
            let _ = thread.join();
        }
    }
}

struct Client {
    stream: DetectorStream,
    /// Bytes of an unfinished request.
    pending: Vec<u8>,
}

fn serve(listener: &Listener, settings: EmulatedDetectorSettings, sight: &VisibleObjects, stop: &AtomicBool) {
    let mut rng: ChaCha8Rng = trial_rng(settings.seed, usize::MAX, 1);
    let mut clients: Vec<Client> = Vec::new();
    let mut next = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        if let Ok(stream) = listener.accept()
            && stream.set_timeouts(WRITE_TIMEOUT).is_ok()
        {
            clients.push(Client { stream, pending: Vec::new() });
        }
        let due = settings.period.filter(|_| Instant::now() >= next);
        if let Some(period) = due {
            next = Instant::now() + period;
            for (name, pose) in sight() {
                let text =
                    format_line(&name, unix_time(), &with_errors(&pose, settings.sigma, &mut rng), settings.sigma);
                clients.retain_mut(|client| client.stream.write_all(text.as_bytes()).is_ok());
            }
        }
        clients.retain_mut(|client| {
            let Some(questions) = client.questions() else { return false };
            let answers = questions.iter().filter(|_| settings.period.is_none()).filter_map(|name| {
                let (name, pose) = sight().into_iter().find(|(other, _)| other == name)?;
                Some(format_line(&name, unix_time(), &with_errors(&pose, settings.sigma, &mut rng), settings.sigma))
            });
            let text: String = answers.collect();
            client.stream.write_all(text.as_bytes()).is_ok()
        });
        if clients.is_empty() || settings.period.is_some() {
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

impl Client {
    /// Returns the new requests, or `None` if the client is gone.
    fn questions(&mut self) -> Option<Vec<String>> {
        let mut buffer = [0; 1024];
        match self.stream.read(&mut buffer) {
            Ok(0) => return None,
            Ok(count) => self.pending.extend(&buffer[..count]),
            Err(error) if is_pending(&error) => {}
            Err(_) => return None,
        }
        if self.pending.len() > MAX_LINE_LENGTH {
            // No valid request is this long.
            return None;
        }
        let mut questions = Vec::new();
        while let Some(end) = self.pending.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.pending.drain(..=end).collect();
            let asked = serde_json::from_slice::<serde_json::Value>(&line).ok();
            questions.extend(asked.and_then(|asked| asked["look"].as_str().map(str::to_owned)));
        }
        Some(questions)
    }
}

/// Returns `pose` with drawn errors.
fn with_errors(pose: &Isometry3<f64>, (place, turn): (f64, f64), rng: &mut ChaCha8Rng) -> Isometry3<f64> {
    let mut draw = |sigma: f64| Normal::new(0.0, sigma).map_or(0.0, |normal| normal.sample(rng));
    let off = Vector3::new(draw(place), draw(place), draw(place));
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), draw(turn));
    Isometry3::from_parts(Translation3::from(pose.translation.vector + off), turn * pose.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VisionLink;
    use crate::measurement::MeasurementChecks;

    fn look(seed: u64, address: &str, period: Option<Duration>) -> Vec<Isometry3<f64>> {
        let settings = EmulatedDetectorSettings { sigma: (0.003, 0.02), seed, period };
        let place = Isometry3::translation(0.6, 0.1, 0.03);
        let sight: VisibleObjects = Box::new(move || vec![("ball".to_owned(), place), ("pear".to_owned(), place)]);
        let camera = EmulatedDetector::start(&address.parse().expect("an address"), settings, sight).expect("starts");
        let checks = MeasurementChecks::new(vec!["pear".to_owned(), "ball".to_owned()], Isometry3::identity());
        let mut link = VisionLink::connect(camera.address(), checks).expect("connects");
        let seen = (0..20).map(|_| link.detect("pear", || false).expect("a detection").expect("visible"));
        let seen: Vec<_> = seen.map(|seen| seen.pose).collect();
        for pose in &seen {
            assert!((1e-6..0.02).contains(&(pose.translation.vector - place.translation.vector).norm()));
        }
        seen
    }

    /// The same seed gives the same measurements and another one different ones, over either kind of socket.
    #[test]
    fn answers_are_drawn_from_the_seed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("detector");
        let unix = format!("unix:{}", path.display());
        let one = look(1, "127.0.0.1:0", None);
        assert_eq!(look(1, &unix, None), one);
        assert!(!path.exists(), "its socket is removed with it");
        assert_ne!(look(2, "127.0.0.1:0", None), one);
    }

    #[test]
    fn it_also_measures_by_itself() {
        look(1, "127.0.0.1:0", Some(Duration::from_millis(10)));
    }
}
