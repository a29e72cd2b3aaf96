//! Files of the grasps that one search found.
//!
//! The format is JSON lines: a header, then one [`HeldGrasp`] per line, so that an interrupted run leaves whole grasps.
//! The grasps are of our own hand, or of another hand that the header names. Poses of an object of the set are in the
//! set's frame, those of a mesh in the frame of its file.

use std::io::{BufRead, BufReader, Read as _, Write};
use std::path::{Path, PathBuf};

use serde::de::{DeserializeOwned, IgnoredAny};
use serde::{Deserialize, Serialize};

use super::held::HeldGrasp;

/// Version of the file format.
pub const VERSION: u32 = 1;

/// First line of a file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GraspFileHeader {
    /// Version of the file format, [`VERSION`].
    pub version: u32,
    /// Command that generated it.
    pub command: String,
    /// Seed of the search.
    pub seed: u64,
    /// The hand, if it is not our own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hand: Option<HandSource>,
    /// Mesh of the object, in m, if the object is not of the set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<SourceFile>,
}

impl GraspFileHeader {
    /// Creates a header for our own hand and an object of the set.
    pub fn new(command: String, seed: u64) -> Self {
        Self { version: VERSION, command, seed, hand: None, mesh: None }
    }
}

/// A source file with its digest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceFile {
    /// The file.
    pub path: PathBuf,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// A hand read from files.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandSource {
    /// Name of the URDF's robot.
    pub name: String,
    /// URDF of the hand.
    pub urdf: SourceFile,
    /// Pulls file: the actuators on its joints.
    pub pulls: SourceFile,
}

/// Errors of files of grasps.
#[derive(Debug, thiserror::Error)]
pub enum GraspFileError {
    /// File that cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Invalid line.
    #[error("{path}:{line}: {message}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// Description of the fault.
        message: String,
    },
}

/// Appends grasps to a file, one line each.
///
/// ```
/// use dexterous_grasping::synthesis::grasp_file::{self, GraspFileHeader, GraspWriter};
/// use dexterous_grasping::synthesis::held::HeldGrasp;
///
/// // A gripper with one joint holds a ball.
/// let grasp: HeldGrasp = serde_json::from_str(
///     r#"{"object": "ball", "chain": 7, "root_from_object": [0, 0, -0.05, 0, 0, 0, 1], "joints": [["turn", 0.5]],
///     "start": [0, 0, -0.05, 0, 0, 0, 1], "open_joints": [["turn", 0.1]], "tensions": [["close", 30]],
///     "contacts": [[0, [0, 0, 0], [0, 0, 1], 2]], "margin": 2, "penetration": 0}"#,
/// )?;
/// let path = std::env::temp_dir().join(format!("grasp-file-example-{}.jsonl", std::process::id()));
/// let header = GraspFileHeader::new("a search".into(), 1);
/// GraspWriter::create(&path, &header)?.add(&grasp)?;
///
/// // An interrupted search goes on after the last whole line.
/// let (mut writer, found) = GraspWriter::resume(&path, &header)?;
/// assert_eq!(found, [grasp.clone()]);
/// writer.add(&HeldGrasp { chain: 8, ..grasp })?;
/// assert_eq!(grasp_file::read(&path)?.1.len(), 2);
/// # std::fs::remove_file(&path)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct GraspWriter {
    path: PathBuf,
    file: std::fs::File,
}

impl GraspWriter {
    /// Starts a file, replacing an existing one.
    ///
    /// # Errors
    /// [`GraspFileError::Io`].
    pub fn create(path: &Path, header: &GraspFileHeader) -> Result<Self, GraspFileError> {
        let io = |source| GraspFileError::Io { path: path.into(), source };
        let file = std::fs::File::create(path).map_err(io)?;
        let mut writer = Self { path: path.into(), file };
        writer.line(header)?;
        Ok(writer)
    }

    /// Continues the file of an interrupted run with the same header, and returns its grasps. An incomplete last line is
    /// removed.
    ///
    /// # Errors
    /// [`GraspFileError::Line`] for a file with another header or a faulty line, [`GraspFileError::Io`].
    pub fn resume(path: &Path, header: &GraspFileHeader) -> Result<(Self, Vec<HeldGrasp>), GraspFileError> {
        let io = |source| GraspFileError::Io { path: path.into(), source };
        let mut text = std::fs::read_to_string(path).map_err(io)?;
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        if whole == 0 {
            return Ok((Self::create(path, header)?, Vec::new()));
        }
        text.truncate(whole);
        let (found, grasps) = parse(&text, path)?;
        if found != *header {
            let message = format!("command: found `{}`, expected `{}`", found.command, header.command);
            return Err(GraspFileError::Line { path: path.into(), line: 1, message });
        }
        let file = std::fs::OpenOptions::new().append(true).open(path).map_err(io)?;
        file.set_len(whole as u64).map_err(io)?;
        Ok((Self { path: path.into(), file }, grasps))
    }

    /// Appends a grasp.
    ///
    /// # Errors
    /// [`GraspFileError::Io`].
    pub fn add(&mut self, grasp: &HeldGrasp) -> Result<(), GraspFileError> {
        self.line(grasp)
    }

    fn line(&mut self, value: &impl Serialize) -> Result<(), GraspFileError> {
        let io = |source| GraspFileError::Io { path: self.path.clone(), source };
        let mut text = serde_json::to_string(value).map_err(|error| io(error.into()))?;
        text.push('\n');
        self.file.write_all(text.as_bytes()).map_err(io)
    }
}

/// Reads a file.
///
/// # Errors
/// [`GraspFileError::Line`] for a faulty line, also an incomplete last one; [`GraspFileError::Io`].
pub fn read(path: &Path) -> Result<(GraspFileHeader, Vec<HeldGrasp>), GraspFileError> {
    let text =
        ftac_platform::file::read_text(path).map_err(|source| GraspFileError::Io { path: path.into(), source })?;
    parse(&text, path)
}

/// Longest header, bytes.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Reads the header alone.
///
/// # Errors
/// [`GraspFileError::Line`] for a file of another format; [`GraspFileError::Io`].
pub fn read_header(path: &Path) -> Result<GraspFileHeader, GraspFileError> {
    let io = |source| GraspFileError::Io { path: path.into(), source };
    let mut first = String::new();
    let file = ftac_platform::file::open_regular(path, u64::MAX).map_err(io)?;
    BufReader::new(file.take(MAX_HEADER_BYTES)).read_line(&mut first).map_err(io)?;
    Ok(parse::<IgnoredAny>(&first, path)?.0)
}

fn parse<G: DeserializeOwned>(text: &str, path: &Path) -> Result<(GraspFileHeader, Vec<G>), GraspFileError> {
    let fault = |line: usize, message: String| GraspFileError::Line { path: path.into(), line, message };
    let mut lines = text.lines().enumerate();
    let (_, first) = lines.next().ok_or_else(|| fault(1, "found nothing, expected a header".into()))?;
    let header: GraspFileHeader = serde_json::from_str(first).map_err(|error| fault(1, error.to_string()))?;
    if header.version != VERSION {
        return Err(fault(1, format!("version: found {}, expected {VERSION}", header.version)));
    }
    let grasps = lines
        .map(|(n, line)| serde_json::from_str(line).map_err(|error| fault(n + 1, error.to_string())))
        .collect::<Result<_, _>>()?;
    Ok((header, grasps))
}

#[cfg(test)]
mod tests {
    use super::super::held::tests::grasp;
    use super::*;

    #[test]
    fn written_is_read() {
        let path = std::env::temp_dir().join(format!("held-{}.jsonl", std::process::id()));
        let header = GraspFileHeader::new("test".into(), 5);
        let mut writer = GraspWriter::create(&path, &header).expect("created");
        let grasp = grasp().at_file_precision();
        writer.add(&grasp).expect("written");
        let (found, grasps) = read(&path).expect("read");
        assert_eq!((found, grasps), (header, vec![grasp]));
        std::fs::write(&path, "{\"version\":9,\"command\":\"\",\"seed\":1}\n").expect("written");
        let error = read(&path).expect_err("another version").to_string();
        assert!(error.ends_with(":1: version: found 9, expected 1"), "{error}");
        std::fs::remove_file(&path).expect("removed");
    }

    /// A run killed in the middle of a line continues after the last whole one. Another command's file is not changed.
    #[test]
    fn an_interrupted_file_goes_on() {
        let path = std::env::temp_dir().join(format!("resumed-{}.jsonl", std::process::id()));
        let header = GraspFileHeader::new("test".into(), 5);
        let (first, second) = (grasp().at_file_precision(), HeldGrasp { chain: 9, ..grasp() }.at_file_precision());
        let mut writer = GraspWriter::create(&path, &header).expect("created");
        writer.add(&first).expect("written");
        let whole = std::fs::read_to_string(&path).expect("read");
        std::fs::write(&path, format!("{whole}{{\"object\":\"ba")).expect("written");
        let (mut writer, kept) = GraspWriter::resume(&path, &header).expect("resumed");
        assert_eq!(kept, std::slice::from_ref(&first));
        writer.add(&second).expect("written");
        assert_eq!(read(&path).expect("read").1, [first, second]);
        let other = GraspFileHeader { seed: 6, command: "another".into(), ..header };
        let error = GraspWriter::resume(&path, &other).expect_err("another run").to_string();
        assert!(error.ends_with(":1: command: found `test`, expected `another`"), "{error}");
        std::fs::remove_file(&path).expect("removed");
    }
}
