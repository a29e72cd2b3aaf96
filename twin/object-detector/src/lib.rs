//! Object poses from a vision system, over a socket with one JSON line per measurement.
//!
//! ```json
//! {"object": "pear", "time": 1764000000.25, "frame": "table", "position": [0.62, -0.14, 0.03], "quaternion": [0, 0, 0, 1],
//!  "covariance": [1e-5, 0, 0, 0, 0, 0,  0, 1e-5, ...]}
//! ```
//!
//! [`measurement`] defines the fields and refuses invalid values. [`VisionLink`] requests a detection and waits for it.
//! [`camera`] replaces a vision system on emulated robots.
//!
//! Each request is one line `{"look": NAME}`. A system that measures on request answers it; one that measures
//! continuously need not read it. Only measurements made after the request count. The [`connection`] is read between
//! requests too, however long the operator takes. A lost connection is re-established at the next request.

// Printed text may come from third parties: this `eprintln!` escapes its control characters.
#[macro_use]
extern crate progress;

pub mod camera;
mod connection;
pub mod measurement;
mod stream;

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use control::detection::PoseDetection;
use nalgebra::Isometry3;

use self::connection::{Connection, ConnectionEnd};
use self::measurement::{MeasurementChecks, RefusedLine, parse_line};

pub use self::stream::Address;

/// Time limit for a measurement.
const MEASUREMENT_TIMEOUT: Duration = Duration::from_secs(3);
/// Interval between checks for a stop, and between attempts to reconnect.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Tolerance of a measurement's age relative to the request, s: the clocks of two computers differ.
const MAX_CLOCK_SKEW: f64 = 0.05;
/// Longest line, bytes.
const MAX_LINE_LENGTH: usize = 1 << 16;

/// Reason for which a detection failed.
#[derive(Debug, thiserror::Error)]
pub enum VisionError {
    #[error("--detector {address}: {source}")]
    Io { address: String, source: std::io::Error },
    /// The connection is lost each time it is established.
    #[error(
        "--detector {address}: the connection was lost during the detection of {object}, and again after each reconnection: {why}"
    )]
    Lost { address: String, object: String, why: ConnectionEnd },
    #[error("--detector {address}: {}", ConnectionEnd::LineTooLong)]
    LineTooLong { address: String },
    /// No usable measurement came in time.
    #[error("--detector {address}: {object}: found {}, expected a measurement of it within {:.0} s", describe_refusal(.refused), MEASUREMENT_TIMEOUT.as_secs_f64())]
    NoMeasurement {
        address: String,
        object: String,
        /// The last line that came instead.
        refused: Option<RefusedLine>,
    },
    #[error("the operator stopped it during the detection of {0}")]
    Stopped(String),
}

fn describe_refusal(refused: &Option<RefusedLine>) -> String {
    refused.as_ref().map_or("nothing".to_owned(), ToString::to_string)
}

/// Connection to a vision system.
pub struct VisionLink {
    address: Address,
    connection: Connection,
    checks: MeasurementChecks,
}

impl VisionLink {
    /// Connects to the system at `address`.
    pub fn connect(address: &Address, checks: MeasurementChecks) -> Result<Self, VisionError> {
        let connection =
            Connection::open(address).map_err(|source| VisionError::Io { address: address.to_string(), source })?;
        Ok(Self { address: address.clone(), connection, checks })
    }

    /// Returns the present pose of `object`, or `None` if the system reports it as hidden. `stop` ends the wait.
    pub fn detect(&mut self, object: &str, stop: impl Fn() -> bool) -> Result<Option<PoseDetection>, VisionError> {
        let (begun, address) = (Instant::now(), self.address.to_string());
        let (mut refused, mut lost) = (None, self.connection.end_reason());
        let mut asked = None;
        while begun.elapsed() < MEASUREMENT_TIMEOUT {
            if stop() {
                return Err(VisionError::Stopped(object.to_owned()));
            }
            if let Some(why) = &lost {
                self.reconnect(why)?;
                (lost, asked) = (None, None);
            }
            let since = match asked {
                Some(since) => since,
                None => match self.send_question(object) {
                    Ok(since) => *asked.insert(since),
                    Err(why) => {
                        lost = Some(why);
                        std::thread::sleep(POLL_INTERVAL);
                        continue;
                    }
                },
            };
            let (number, line) = match self.connection.next_line(POLL_INTERVAL) {
                Ok(Some(line)) => line,
                Ok(None) => continue,
                Err(ConnectionEnd::LineTooLong) => return Err(VisionError::LineTooLong { address }),
                Err(why) => {
                    lost = Some(why);
                    std::thread::sleep(POLL_INTERVAL);
                    continue;
                }
            };
            match parse_line(&line, number, &self.checks, unix_time()) {
                Ok(seen) if seen.object != object => {}
                Ok(seen) if seen.time < since - MAX_CLOCK_SKEW => {
                    refused = Some(RefusedLine {
                        line: number,
                        what: format!(
                            "a measurement of {object} that is {:.2} s old (taken before the request)",
                            unix_time() - seen.time
                        ),
                    });
                }
                Ok(seen) => return Ok(seen.detection),
                Err(error) => refused = Some(error),
            }
        }
        let object = object.to_owned();
        match lost {
            Some(why) => Err(VisionError::Lost { address, object, why }),
            None => Err(VisionError::NoMeasurement { address, object, refused }),
        }
    }

    /// Requests a detection of `object`. Returns the time of the request (Unix time, s).
    fn send_question(&mut self, object: &str) -> Result<f64, ConnectionEnd> {
        let asked = unix_time();
        let question = serde_json::json!({"look": object}).to_string() + "\n";
        self.connection.write(&question).map_err(|error| ConnectionEnd::Failed(error.to_string()))?;
        Ok(asked)
    }

    /// Reconnects after the connection was lost.
    fn reconnect(&mut self, why: &ConnectionEnd) -> Result<(), VisionError> {
        let failed = |error: std::io::Error| {
            let words = format!("the connection was lost ({why}) and cannot be re-established: {error}");
            let source = std::io::Error::new(error.kind(), words);
            VisionError::Io { address: self.address.to_string(), source }
        };
        self.connection = Connection::open(&self.address).map_err(failed)?;
        eprintln!("--detector {}: the connection was lost ({why}) and was re-established", self.address);
        Ok(())
    }
}

/// True if the error means only that nothing has arrived yet.
fn is_pending(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

/// Returns the Unix time, s.
pub(crate) fn unix_time() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// Vision of a trial: source and checks of its measurements.
#[derive(Debug, Clone)]
pub struct VisionSetup {
    pub source: VisionSource,
    pub checks: MeasurementChecks,
}

/// Source of detections.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VisionSource {
    /// A vision system.
    System(Address),
    /// The vision system of the emulated robot.
    Emulated,
}

impl std::str::FromStr for VisionSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "emulated" { Ok(Self::Emulated) } else { text.parse().map(Self::System) }
    }
}

/// Formats a position as text.
pub fn format_position(place: &Isometry3<f64>) -> String {
    let t = place.translation.vector;
    format!("x {:.3}, y {:.3}, z {:.3} m", t.x, t.y, t.z)
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead as _, BufReader, Write as _};
    use std::net::TcpListener;

    use super::*;

    fn checks() -> MeasurementChecks {
        MeasurementChecks::new(["pear", "ball"].map(str::to_owned).to_vec(), Isometry3::identity())
    }

    /// Starts a system that answers each request with these lines, with `TIME` replaced by the time.
    fn system(lines: &'static [&'static str]) -> Address {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address").to_string().parse().expect("an address");
        std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().expect("a client");
            let mut questions = BufReader::new(stream.try_clone().expect("cloned")).lines().map_while(Result::ok);
            while questions.next().is_some() {
                for line in lines {
                    let line = line.replace("TIME", &format!("{:.4}", unix_time()));
                    let _ = writeln!(stream, "{line}");
                }
            }
        });
        address
    }

    const POSE: &str = r#""position": [0.6, 0.1, 0.03], "quaternion": [0, 0, 0, 1]"#;

    fn good(object: &str) -> String {
        let diagonal: Vec<&str> = (0..36).map(|n| if n % 7 == 0 { "4e-6" } else { "0" }).collect();
        format!(r#"{{"object": "{object}", "time": TIME, {POSE}, "covariance": [{}]}}"#, diagonal.join(","))
    }

    #[test]
    fn what_was_measured_after_the_question_is_seen() {
        let lines = [
            // A stale line, one of another object, and the right one.
            good("pear").replace("TIME", "1000.0"),
            good("ball"),
            good("pear"),
        ];
        let lines: &'static [String] = Box::leak(Box::new(lines));
        let lines: Vec<&'static str> = lines.iter().map(String::as_str).collect();
        let mut link = VisionLink::connect(&system(Box::leak(lines.into_boxed_slice())), checks()).expect("connects");
        for _ in 0..3 {
            let seen = link.detect("pear", || false).expect("a detection").expect("visible");
            assert!((seen.sigma.expect("stated") - 0.002).abs() < 1e-12);
            assert_eq!(seen.pose.translation.vector.as_slice(), [0.6, 0.1, 0.03]);
        }
    }

    #[test]
    fn what_is_hidden_is_not_seen() {
        let address = system(&[r#"{"object": "pear", "time": TIME, "hidden": true}"#]);
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        assert_eq!(link.detect("pear", || false).expect("an answer"), None);
    }

    #[test]
    fn what_is_wrong_is_told_with_the_last_line_that_was_refused() {
        let address = system(&["{\"object\": \"plum\", \"time\": TIME, \"hidden\": true}"]);
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        let error = link.detect("pear", || false).expect_err("nothing usable").to_string();
        for words in ["pear", "line 1: object: found plum", "pear, ball", "within 3 s"] {
            assert!(error.contains(words), "{error}");
        }
        assert!(matches!(link.detect("pear", || true), Err(VisionError::Stopped(_))));
    }

    #[test]
    fn a_system_that_goes_away_is_noticed() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address: Address = listener.local_addr().expect("its address").to_string().parse().expect("an address");
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        drop(listener.accept().expect("a client"));
        drop(listener);
        let error = link.detect("pear", || false).expect_err("gone").to_string();
        assert!(error.starts_with("--detector 127.0.0.1:") && error.contains("cannot be re-established"), "{error}");
        let error = VisionLink::connect(&address, checks()).err().expect("no system there").to_string();
        assert!(error.starts_with("--detector 127.0.0.1:"), "{error}");
    }

    /// The lines of a system that keeps sending while the operator waits are read. Its socket is never full, and the
    /// next detection has the newest measurement.
    #[test]
    fn an_operator_who_takes_long_finds_the_detector_connected() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address: Address = listener.local_addr().expect("its address").to_string().parse().expect("an address");
        let (sender, sent) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().expect("a client");
            // As strict as the emulated system: a client that reads nothing is dropped.
            stream.set_write_timeout(Some(Duration::from_millis(500))).expect("set");
            let line = good("pear");
            // More than sockets hold: the lines of at least 40 s of measuring, at once.
            for n in 0..40_000 {
                if writeln!(stream, "{}", line.replace("TIME", &format!("{:.4}", unix_time()))).is_err() {
                    let _ = sender.send(n);
                    return;
                }
            }
            let _ = sender.send(40_000);
            while writeln!(stream, "{}", line.replace("TIME", &format!("{:.4}", unix_time()))).is_ok() {
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        // The operator waits until all of it was sent or refused.
        assert_eq!(sent.recv().expect("sends"), 40_000, "lines read");
        link.detect("pear", || false).expect("a detection").expect("visible");
    }

    /// Each request reconnects to a system that closes its connection after every answer, or that was restarted in
    /// between.
    #[test]
    fn a_connection_that_was_lost_is_made_anew() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address: Address = listener.local_addr().expect("its address").to_string().parse().expect("an address");
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let mut question = String::new();
                let _ = BufReader::new(&stream).read_line(&mut question);
                let _ = writeln!(&stream, "{}", good("pear").replace("TIME", &format!("{:.4}", unix_time())));
            }
        });
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        for _ in 0..3 {
            link.detect("pear", || false).expect("a detection").expect("visible");
        }
    }

    /// An address that swallows every packet is reported within seconds, not after the minutes of the operating system.
    #[test]
    fn an_address_that_says_nothing_is_told_soon() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let there = listener.local_addr().expect("its address");
        // No connection is accepted: once the queue is full, no other client is answered.
        let connect = |_| std::net::TcpStream::connect_timeout(&there, Duration::from_millis(200)).ok();
        let _waiting: Vec<_> = (0..10_000).map_while(connect).collect();
        let address: Address = there.to_string().parse().expect("an address");
        let error = VisionLink::connect(&address, checks()).err().expect("no answer").to_string();
        assert!(error.contains(&address.to_string()) && error.contains("no answer within 3 s"), "{error}");
    }

    /// Text from the network that would clear a terminal is shown in escaped form.
    #[test]
    fn escape_sequences_from_the_detector_are_printed_in_words() {
        let address = system(&[r#"{"object": "\u001b[2Jpear", "time": TIME, "hidden": true}"#, "\u{1b}]0;owned\u{7}"]);
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        let error = link.detect("pear", || false).expect_err("nothing usable").to_string();
        let shown = progress::printable(&error);
        assert!(!shown.contains(|letter: char| letter.is_control()), "{shown:?}");
    }
}
