//! The open link: one thread reads frames, another decodes images; the control thread only takes finished images.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, SyncSender, TrySendError};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use dynamixel_bus::exclusive;
use hand_model::robot::TactileFrame;
use robot_session_log::{Direction, LinkTap};
use serial2::SerialPort;

use super::clock::BoardClock;
use super::counters::CameraCounters;
use super::deframer::Deframer;
use super::message::{LinkImage, LinkMessage, VERSION};
use super::{frame, image_data};
use crate::clock::Clock;
use crate::lock::lock;

/// Baud rate. A USB serial device ignores it; a real line at this rate carries two images a second.
const BAUD: u32 = 3_000_000;
/// Time-out of the board's first answer.
const HELLO_TIMEOUT: Duration = Duration::from_millis(1000);
/// Interval between requests for the board's time.
const CLOCK_PERIOD: Duration = Duration::from_millis(1000);
/// Images per camera that may wait for decoding.
const QUEUE_CAPACITY: usize = 2;

/// Error of the link to the cameras.
#[derive(Debug, thiserror::Error)]
pub enum TactileLinkError {
    /// The port cannot be opened, read or written.
    #[error("{port}: {source}")]
    Port {
        /// Device path.
        port: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// No board answered in this protocol.
    #[error("{port}: no camera board answered within 1 s")]
    Silent {
        /// Device path.
        port: PathBuf,
    },
    /// The board's firmware has another protocol version.
    #[error("{port}: camera board speaks version {found}, expected {VERSION}")]
    Version {
        /// Device path.
        port: PathBuf,
        /// The board's protocol version.
        found: u16,
    },
    /// The board has another number of cameras.
    #[error("{port}: found {found} cameras, expected {expected}")]
    Cameras {
        /// Device path.
        port: PathBuf,
        /// Cameras that answer.
        found: u8,
        /// Cameras of the hand.
        expected: usize,
    },
}

/// Identity of the board, as it reported it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BoardIdentity {
    /// Serial number.
    pub serial: u32,
    /// Cameras that answer.
    pub cameras: u8,
}

/// Counters of the line, for all cameras together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LineCounters {
    /// Good frames.
    pub frames: u64,
    /// Damaged frames.
    pub damaged: u64,
    /// Images that name a camera the hand does not have.
    pub unknown_cameras: u64,
}

#[derive(Default)]
struct ImageQueue {
    clock: BoardClock,
    /// Counters of every camera of the hand.
    cameras: Vec<CameraCounters>,
    line: LineCounters,
    ready: Vec<TactileFrame>,
    port_error: Option<String>,
    tap: Option<LinkTap>,
}

/// An open link to the camera board.
pub struct TactileLink {
    port: SerialPort,
    path: PathBuf,
    board: BoardIdentity,
    queue: Arc<Mutex<ImageQueue>>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
    clock: Clock,
}

impl TactileLink {
    /// Opens the port and greets the board, which must have `cameras` cameras. Times are those of `clock`.
    pub fn open(path: &Path, cameras: usize, clock: Clock) -> Result<Self, TactileLinkError> {
        let failed = |source| TactileLinkError::Port { port: path.to_owned(), source };
        let mut port = exclusive::open(path, BAUD).map_err(failed)?;
        port.set_read_timeout(Duration::from_millis(5)).map_err(failed)?;
        port.discard_input_buffer().map_err(failed)?;
        let board = greet(&port, path, cameras)?;
        let books = Arc::new(Mutex::new(ImageQueue {
            cameras: vec![CameraCounters::default(); cameras],
            ..ImageQueue::default()
        }));
        let stop = Arc::new(AtomicBool::new(false));
        let (images, queue) = mpsc::sync_channel(QUEUE_CAPACITY * cameras);
        let reader =
            Reader { port: port.try_clone().map_err(failed)?, queue: books.clone(), images, clock: clock.clone() };
        let for_decoder = books.clone();
        let stopped = stop.clone();
        let spawn = |name: &str, work: Box<dyn FnOnce() + Send>| {
            std::thread::Builder::new().name(name.into()).spawn(work).map_err(failed)
        };
        let threads = vec![
            spawn("tactile link", Box::new(move || reader.run(&stopped)))?,
            spawn("image decoder", Box::new(move || decode_images(&queue, &for_decoder)))?,
        ];
        Ok(Self { port, path: path.to_owned(), board, queue: books, stop, threads, clock })
    }

    /// Copies every byte that crosses the link from now on to `tap`.
    pub fn tap(&self, tap: LinkTap) {
        lock(&self.queue).tap = Some(tap);
    }

    /// Returns the board's identity, as it reported it.
    pub fn board(&self) -> BoardIdentity {
        self.board
    }

    /// Requests one image of every camera.
    pub fn request_capture(&self) -> Result<(), TactileLinkError> {
        let wire = frame::encode(&LinkMessage::Capture);
        if let Some(tap) = &lock(&self.queue).tap {
            tap.copy_packet(Direction::Sent, &wire);
        }
        self.port.write_all(&wire).map_err(|source| TactileLinkError::Port { port: self.path.clone(), source })
    }

    /// Returns the images finished since the last call.
    pub fn take_images(&self) -> Vec<TactileFrame> {
        std::mem::take(&mut lock(&self.queue).ready)
    }

    /// Returns the counters of every camera.
    pub fn camera_counters(&self) -> Vec<CameraCounters> {
        lock(&self.queue).cameras.clone()
    }

    /// Returns the counters of the line.
    pub fn line_counters(&self) -> LineCounters {
        lock(&self.queue).line
    }

    /// Returns the uncertainty of capture times, s; `None` before the board's first answer.
    pub fn clock_uncertainty(&self) -> Option<f64> {
        lock(&self.queue).clock.uncertainty()
    }

    /// Returns the reason why the port stopped working, if it did.
    pub fn port_error(&self) -> Option<String> {
        lock(&self.queue).port_error.clone()
    }

    /// Returns the present time on the clock of capture times, s.
    pub fn now(&self) -> f64 {
        self.clock.now()
    }
}

impl Drop for TactileLink {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A thread that panicked has reported that itself.
            let _ = thread.join();
        }
    }
}

fn greet(port: &SerialPort, path: &Path, expected: usize) -> Result<BoardIdentity, TactileLinkError> {
    let failed = |source| TactileLinkError::Port { port: path.to_owned(), source };
    // A leading delimiter ends an unfinished frame of an earlier host.
    let hello = [vec![frame::DELIMITER], frame::encode(&LinkMessage::Hello)].concat();
    port.write_all(&hello).map_err(failed)?;
    let deadline = Instant::now() + HELLO_TIMEOUT;
    let mut deframer = Deframer::default();
    let mut buffer = [0; 4096];
    while Instant::now() < deadline {
        let Some(count) = read_some(port, &mut buffer).map_err(failed)? else { continue };
        for message in deframer.push(&buffer[..count]).into_iter().flatten() {
            if let LinkMessage::Welcome { version, serial, cameras } = message {
                if version != VERSION {
                    return Err(TactileLinkError::Version { port: path.to_owned(), found: version });
                }
                if usize::from(cameras) != expected {
                    return Err(TactileLinkError::Cameras { port: path.to_owned(), found: cameras, expected });
                }
                return Ok(BoardIdentity { serial, cameras });
            }
        }
    }
    Err(TactileLinkError::Silent { port: path.to_owned() })
}

/// Reads the bytes that come within the port's time-out, if any.
fn read_some(port: &SerialPort, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
    match port.read(buffer) {
        Ok(0) => Err(std::io::ErrorKind::UnexpectedEof.into()),
        Ok(count) => Ok(Some(count)),
        Err(error) if error.kind() == std::io::ErrorKind::TimedOut => Ok(None),
        Err(error) => Err(error),
    }
}

struct Reader {
    port: SerialPort,
    queue: Arc<Mutex<ImageQueue>>,
    images: SyncSender<(LinkImage, f64)>,
    clock: Clock,
}

impl Reader {
    fn run(self, stop: &AtomicBool) {
        if let Err(error) = self.read_until(stop) {
            lock(&self.queue).port_error = Some(error.to_string());
        }
    }

    fn read_until(&self, stop: &AtomicBool) -> std::io::Result<()> {
        let mut deframer = Deframer::default();
        let mut buffer = vec![0; 65_536];
        let mut next_question = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            if Instant::now() >= next_question {
                next_question = Instant::now() + CLOCK_PERIOD;
                self.port.write_all(&frame::encode(&LinkMessage::WhatTime { host_us: self.now_us() }))?;
            }
            let Some(count) = read_some(&self.port, &mut buffer)? else { continue };
            if let Some(tap) = &lock(&self.queue).tap {
                tap.copy_packet(Direction::Received, &buffer[..count]);
            }
            for message in deframer.push(&buffer[..count]) {
                self.handle_message(message);
            }
        }
        Ok(())
    }

    fn now_us(&self) -> u64 {
        (self.clock.now() * 1e6) as u64
    }

    fn handle_message(&self, message: Result<LinkMessage, frame::FrameError>) {
        let mut books = lock(&self.queue);
        let Ok(message) = message else {
            books.line.damaged += 1;
            return;
        };
        books.line.frames += 1;
        match message {
            LinkMessage::Time { host_us, board_us } => {
                books.clock.add_sample(host_us as f64 * 1e-6, self.now_us() as f64 * 1e-6, board_us as f64 * 1e-6);
            }
            LinkMessage::CameraFault { camera, .. } => match books.cameras.get_mut(usize::from(camera)) {
                Some(camera) => camera.faults += 1,
                None => books.line.unknown_cameras += 1,
            },
            LinkMessage::Image(image) => {
                // Images are requested only after the first clock exchange.
                let captured = books.clock.host_time(image.captured_us as f64 * 1e-6);
                let camera = usize::from(image.camera);
                let (Some(captured), true) = (captured, camera < books.cameras.len()) else {
                    books.line.unknown_cameras += 1;
                    return;
                };
                books.cameras[camera].note_arrival(image.sequence, frame::digest(&image.data));
                if let Err(TrySendError::Full(_)) = self.images.try_send((image, captured)) {
                    books.cameras[camera].overrun += 1;
                }
            }
            LinkMessage::Hello | LinkMessage::Welcome { .. } | LinkMessage::WhatTime { .. } | LinkMessage::Capture => {}
        }
    }
}

fn decode_images(queue: &Receiver<(LinkImage, f64)>, books: &Mutex<ImageQueue>) {
    // Ends when the reader, which holds the other end, does.
    while let Ok((image, captured)) = queue.recv() {
        let camera = usize::from(image.camera);
        let decoded = image_data::decode(&image);
        let mut books = lock(books);
        match decoded {
            Ok(pixels) => {
                books.cameras[camera].note_decoded(captured);
                let sequence = u64::from(image.sequence);
                books.ready.push(TactileFrame { camera, time: captured, sequence, image: Arc::new(pixels) });
            }
            Err(_) => books.cameras[camera].undecodable += 1,
        }
    }
}
