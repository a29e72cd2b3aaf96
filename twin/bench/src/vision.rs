//! Objects' places from a vision system: a socket that sends one JSON line a measurement.
//!
//! ```json
//! {"object": "pear", "time": 1764000000.25, "frame": "table", "position": [0.62, -0.14, 0.03], "quaternion": [0, 0, 0, 1],
//!  "covariance": [1e-5, 0, 0, 0, 0, 0,  0, 1e-5, ...]}
//! ```
//!
//! [`measurement`] says what the fields are and refuses what cannot be; [`VisionLink`] asks and waits for a look; [`camera`] is what
//! stands for a vision system on emulated robots.
//!
//! Each look writes one line `{"look": NAME}`. A system that measures when asked answers it; one that measures all the time need not
//! read it. Only what was measured after the question counts.

pub mod camera;
pub mod measurement;
mod stream;

use std::io::{Read as _, Write as _};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use control::percept::Sighted;
use nalgebra::Isometry3;

use self::measurement::{Checks, Refused, read};
use self::stream::Stream;

pub use self::stream::Address;

/// Longest wait for a measurement.
const PATIENCE: Duration = Duration::from_secs(3);
/// Between two looks at whether somebody wants to stop.
const LOOK: Duration = Duration::from_millis(50);
/// A measurement may be so much older than the question, s: clocks of two computers differ.
const SKEW: f64 = 0.05;
/// The longest line, bytes.
const LINE: usize = 1 << 16;

/// Why there is no look.
#[derive(Debug, thiserror::Error)]
pub enum VisionError {
    #[error("--eyes {address}: {source}")]
    Io { address: String, source: std::io::Error },
    #[error("--eyes {address}: the other side closed the connection while {object} was looked for")]
    Closed { address: String, object: String },
    #[error("--eyes {address}: found a line of more than {LINE} bytes, expected one JSON object a line")]
    Line { address: String },
    /// Nothing usable came in time.
    #[error("--eyes {address}: {object}: found {}, expected a measurement of it within {:.0} s", said(.refused), PATIENCE.as_secs_f64())]
    Nothing {
        address: String,
        object: String,
        /// What came instead, the latest.
        refused: Option<Refused>,
    },
    #[error("the operator stopped it while {0} was looked for")]
    Stopped(String),
}

fn said(refused: &Option<Refused>) -> String {
    refused.as_ref().map_or("nothing".to_owned(), ToString::to_string)
}

/// The connection to a vision system.
pub struct VisionLink {
    address: String,
    stream: Stream,
    checks: Checks,
    /// What has arrived of a line.
    pending: Vec<u8>,
    lines: u64,
}

impl VisionLink {
    /// To the system at `address`.
    pub fn connect(address: &Address, checks: Checks) -> Result<Self, VisionError> {
        let shown = address.to_string();
        let failed = |source| VisionError::Io { address: shown.clone(), source };
        let stream = Stream::connect(address).and_then(|stream| stream.waits(LOOK).map(|()| stream)).map_err(failed)?;
        Ok(Self { address: shown, stream, checks, pending: Vec::new(), lines: 0 })
    }

    /// Where `object` is now; `None` where the system says that it does not see it. `stop` ends the wait.
    pub fn look(&mut self, object: &str, stop: impl Fn() -> bool) -> Result<Option<Sighted>, VisionError> {
        let asked = now();
        let question = serde_json::json!({"look": object}).to_string() + "\n";
        self.stream.write_all(question.as_bytes()).map_err(|source| self.failed(source))?;
        let begun = Instant::now();
        let mut refused = None;
        while begun.elapsed() < PATIENCE {
            if stop() {
                return Err(VisionError::Stopped(object.to_owned()));
            }
            let Some(line) = self.line(object)? else { continue };
            match read(&line, self.lines, &self.checks, now()) {
                Ok(seen) if seen.object != object => {}
                Ok(seen) if seen.time < asked - SKEW => {
                    refused = Some(Refused {
                        line: self.lines,
                        what: format!(
                            "a measurement of {object} that is {:.2} s old (taken before it was asked for)",
                            now() - seen.time
                        ),
                    });
                }
                Ok(seen) => return Ok(seen.sighted),
                Err(error) => refused = Some(error),
            }
        }
        Err(VisionError::Nothing { address: self.address.clone(), object: object.to_owned(), refused })
    }

    /// The next line, if it has arrived.
    fn line(&mut self, object: &str) -> Result<Option<Vec<u8>>, VisionError> {
        loop {
            if let Some(end) = self.pending.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.pending.drain(..=end).collect();
                self.lines += 1;
                return Ok(Some(line));
            }
            if self.pending.len() > LINE {
                return Err(VisionError::Line { address: self.address.clone() });
            }
            let mut buffer = [0; 4096];
            match self.stream.read(&mut buffer) {
                Ok(0) => {
                    return Err(VisionError::Closed { address: self.address.clone(), object: object.to_owned() });
                }
                Ok(count) => self.pending.extend(&buffer[..count]),
                Err(error) if is_early(&error) => return Ok(None),
                Err(error) => return Err(self.failed(error)),
            }
        }
    }

    fn failed(&self, source: std::io::Error) -> VisionError {
        VisionError::Io { address: self.address.clone(), source }
    }
}

/// Whether nothing has arrived yet.
fn is_early(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

/// Unix time, s.
pub(crate) fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// What the eyes of a trial need: where they are and what is believed of them.
#[derive(Debug, Clone)]
pub struct Vision {
    pub source: VisionSource,
    pub checks: Checks,
}

/// Where looks come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VisionSource {
    /// A vision system.
    At(Address),
    /// A camera that comes with the emulated robot.
    Emulated,
}

impl std::str::FromStr for VisionSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "emulated" { Ok(Self::Emulated) } else { text.parse().map(Self::At) }
    }
}

/// A place in words.
pub(crate) fn shown(place: &Isometry3<f64>) -> String {
    let t = place.translation.vector;
    format!("x {:.3}, y {:.3}, z {:.3} m", t.x, t.y, t.z)
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead as _, BufReader};
    use std::net::TcpListener;

    use super::*;

    fn checks() -> Checks {
        Checks::new(["pear", "ball"].map(str::to_owned).to_vec(), Isometry3::identity())
    }

    /// A system that answers each question with these lines, `TIME` replaced by the time.
    fn system(lines: &'static [&'static str]) -> Address {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address").to_string().parse().expect("an address");
        std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().expect("a client");
            let mut questions = BufReader::new(stream.try_clone().expect("cloned")).lines().map_while(Result::ok);
            while questions.next().is_some() {
                for line in lines {
                    let line = line.replace("TIME", &format!("{:.4}", now()));
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
            // A stale one, another object, and the one.
            good("pear").replace("TIME", "1000.0"),
            good("ball"),
            good("pear"),
        ];
        let lines: &'static [String] = Box::leak(Box::new(lines));
        let lines: Vec<&'static str> = lines.iter().map(String::as_str).collect();
        let mut link = VisionLink::connect(&system(Box::leak(lines.into_boxed_slice())), checks()).expect("connects");
        for _ in 0..3 {
            let seen = link.look("pear", || false).expect("a look").expect("seen");
            assert!((seen.sigma.expect("stated") - 0.002).abs() < 1e-12);
            assert_eq!(seen.pose.translation.vector.as_slice(), [0.6, 0.1, 0.03]);
        }
    }

    #[test]
    fn what_is_hidden_is_not_seen() {
        let address = system(&[r#"{"object": "pear", "time": TIME, "hidden": true}"#]);
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        assert_eq!(link.look("pear", || false).expect("a look"), None);
    }

    #[test]
    fn what_is_wrong_is_told_with_the_last_line_that_was_refused() {
        let address = system(&["{\"object\": \"plum\", \"time\": TIME, \"hidden\": true}"]);
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        let error = link.look("pear", || false).expect_err("nothing usable").to_string();
        for words in ["pear", "line 1: object: found plum", "pear, ball", "within 3 s"] {
            assert!(error.contains(words), "{error}");
        }
        assert!(matches!(link.look("pear", || true), Err(VisionError::Stopped(_))));
    }

    #[test]
    fn a_system_that_goes_away_is_noticed() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address: Address = listener.local_addr().expect("its address").to_string().parse().expect("an address");
        let mut link = VisionLink::connect(&address, checks()).expect("connects");
        drop(listener.accept().expect("a client"));
        assert!(link.look("pear", || false).is_err());
        drop(listener);
        let error = VisionLink::connect(&address, checks()).err().expect("nobody there").to_string();
        assert!(error.starts_with("--eyes 127.0.0.1:"), "{error}");
    }
}
