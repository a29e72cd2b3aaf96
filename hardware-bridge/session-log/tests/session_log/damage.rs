//! Files that were cut or damaged, and foreign files.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use robot_session_log::{RobotSizes, SessionLogError, SessionReader, SessionWriter};

use crate::support::*;

/// Writes a new file each time: truncating and closing an existing one would flush it to the disk, thousands of times.
fn rewrite(path: &Path, bytes: &[u8]) {
    drop(std::fs::remove_file(path));
    std::fs::write(path, bytes).expect("written");
}

fn with_recording(ticks: usize, check: impl FnOnce(&Path, Vec<u8>)) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("session.mcap");
    record(&path, ticks);
    let bytes = std::fs::read(&path).expect("readable");
    check(&folder.path().join("changed.mcap"), bytes);
}

/// A file cut anywhere returns every event that is whole, and reports that it was not finished.
#[test]
fn cut_anywhere_it_is_a_shorter_session() {
    with_recording(4, |path, bytes| {
        let mut longest = 0;
        let mut whole = 0;
        for end in 0..=bytes.len() {
            rewrite(path, &bytes[..end]);
            let (events, ended) = read(path);
            match ended {
                Ok(finished) => {
                    assert!(events.len() >= longest, "cut at {end}: {} events after {longest}", events.len());
                    longest = events.len();
                    assert!(longest == 16 || !finished, "cut at {end}: finished after {longest} events");
                    whole += usize::from(finished);
                }
                // The head is not complete: no session yet.
                Err(error) => assert!(longest == 0 && events.is_empty(), "cut at {end}: {error}"),
            }
        }
        assert_eq!(longest, 16);
        // Behind the data is only the summary, without which a file is finished too.
        assert_eq!(whole, summary_length(path, &bytes) + 1);
    });
}

/// One changed bit anywhere in a finished file's data is noticed by the time it has been read.
#[test]
fn any_changed_bit_is_noticed() {
    with_recording(3, |path, bytes| {
        let data_end = bytes.len() - summary_length(path, &bytes);
        for place in 0..data_end {
            let mut changed = bytes.clone();
            changed[place] ^= 1 << (place % 8);
            rewrite(path, &changed);
            let (_, ended) = read(path);
            // If a length has grown past the end of the file, the file looks cut short.
            assert!(!matches!(ended, Ok(true)), "byte {place} changed unnoticed");
        }
    });
}

/// Twenty thousand files with arbitrary damage, drawn with a seed: none panics, and one that claims to be whole holds
/// what was written.
#[test]
fn fuzzed_files() {
    with_recording(2, |path, bytes| {
        rewrite(path, &bytes);
        let written = format!("{:?}", read(path).0);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let (mut whole, mut opened) = (0, 0);
        for n in 0..20_000 {
            let mut changed = bytes.clone();
            for _ in 0..rng.random_range(1..4) {
                let place = rng.random_range(0..changed.len());
                let end = (place + rng.random_range(1..40)).min(changed.len());
                match rng.random_range(0..4) {
                    0 => changed[place] ^= rng.random_range(1..=255_u8),
                    1 => changed[place..end].iter_mut().for_each(|byte| *byte = rng.random()),
                    2 => drop(changed.drain(place..end)),
                    _ => {
                        let piece = changed[place..end].to_vec();
                        changed.splice(place..place, piece);
                    }
                }
                if changed.is_empty() {
                    break;
                }
            }
            rewrite(path, &changed);
            let (events, ended) = read(path);
            opened += usize::from(!events.is_empty());
            if matches!(ended, Ok(true)) {
                whole += 1;
                assert_eq!(format!("{events:?}"), written, "file {n} is damaged and calls itself whole");
            }
        }
        assert!(opened > 1000 && whole > 10, "{opened} read at all, {whole} whole");
    });
}

/// Returns the number of bytes after the end of the data: the shortest file that is whole ends there.
fn summary_length(path: &Path, bytes: &[u8]) -> usize {
    let end = (0..=bytes.len()).find(|end| {
        rewrite(path, &bytes[..*end]);
        matches!(read(path).1, Ok(true))
    });
    bytes.len() - end.expect("the whole file is whole")
}

#[test]
fn other_files_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("other.mcap");
    assert!(matches!(SessionReader::open(&path, RobotSizes::Any), Err(SessionLogError::Io { .. })));
    assert!(std::process::Command::new("mkfifo").arg(&path).status().expect("mkfifo runs").success());
    let error = SessionReader::open(&path, RobotSizes::Any).err().expect("refused").to_string();
    assert!(error.ends_with("other.mcap: found a pipe, expected a regular file"), "{error}");
    std::fs::remove_file(&path).expect("removed");
    std::fs::write(&path, "a session of another kind").expect("written");
    assert!(matches!(SessionReader::open(&path, RobotSizes::Any), Err(SessionLogError::Mcap { .. })));
    std::fs::remove_file(&path).expect("removed");
    // An MCAP file, but of another program.
    let file = std::fs::File::create(&path).expect("created");
    let mut other = mcap::Writer::new(file).expect("writes");
    other.finish().expect("finishes");
    let error = SessionReader::open(&path, RobotSizes::Any).err().expect("refused");
    assert!(error.to_string().contains("beginning is cut short"), "{error}");
}

/// A session of the former format, without compression, is read; one of a format still to come is refused by name.
#[test]
fn the_former_format_is_read() {
    with_recording(20, |path, bytes| {
        rewrite(path, &bytes);
        let written = read(path).0;
        let summary = mcap::Summary::read(&bytes).expect("a summary").expect("finished");
        let index = &summary.metadata_indexes[0];
        let session = mcap::read::metadata(&bytes, index).expect("the session's description");
        for (format, expected) in [("3", Ok(())), ("5", Err("format is 5 (written by test 1.0), expected 3 or 4"))] {
            drop(std::fs::remove_file(path));
            let options = mcap::WriteOptions::new().compression(None);
            let mut former = options.create(std::fs::File::create(path).expect("created")).expect("writes");
            let mut description = session.clone();
            description.metadata.insert("format".to_owned(), format.to_owned());
            former.write_metadata(&description).expect("written");
            for message in mcap::MessageStream::new(&bytes).expect("messages") {
                former.write(&message.expect("a message")).expect("written");
            }
            former.finish().expect("finished");
            let (events, ended) = read(path);
            match expected {
                Ok(()) => assert_eq!((format!("{events:?}"), ended.expect("whole")), (format!("{written:?}"), true)),
                Err(why) => {
                    let error = ended.expect_err("refused").to_string();
                    assert!(error.ends_with(why), "{error}");
                }
            }
        }
    });
}

/// An empty session is valid.
#[test]
fn a_session_without_a_tick() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("empty.mcap");
    SessionWriter::create(&path, &session()).expect("created").finish().expect("finished");
    let (events, ended) = read(&path);
    assert!(events.is_empty() && matches!(ended, Ok(true)));
    assert_eq!(
        SessionReader::open(&path, RobotSizes::Any).expect("opens").session().configuration,
        session().configuration
    );
}
