//! Short recordings: they exist, stay small, say when they cannot be written, and do not repeat what does not change.

use std::path::Path;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use hand_model::{Arm, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use stream::{DrawnObject, Level, PoseError, Recorder, Settings, SignalFrame, StreamError, Target, TrialProperties};

fn tetrahedron() -> DrawnObject {
    let points =
        [Point3::origin(), Point3::new(0.05, 0.0, 0.0), Point3::new(0.0, 0.05, 0.0), Point3::new(0.0, 0.0, 0.05)];
    DrawnObject::from_mesh("tetrahedron", &points, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], [200, 80, 40])
}

fn noise_image(seed: u32) -> TactileImage {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(1);
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 24) as u8
    };
    TactileImage { rgb: (0..IMAGE_SIZE * IMAGE_SIZE * 3).map(|_| next()).collect() }
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).expect("the recording exists").len()
}

#[test]
fn a_short_run_is_small_and_complete() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("new/run.rrd");
    let (hand, arm) = (Hand::ftac(), Arm::gen3());
    let mut recorder = Recorder::create(&path, &hand, &arm, &[tetrahedron()]).expect("opens");
    let properties =
        TrialProperties { combination: "tetrahedron".into(), condition: "touch".into(), ..Default::default() };
    recorder.log_properties(&properties).expect("logs");
    recorder.log_phase("approach").expect("logs");
    for tick in 0..200 {
        let t = f64::from(tick) * 0.01;
        recorder.set_time(t);
        let mut q = Arm::home();
        q[0] = 0.1 * t;
        let links = arm.tree.forward(&q);
        let palm = links[6] * arm.last_from_tool * hand.palm_from_flange.inverse();
        recorder.log_robot(&links, &palm, &hand.tree.forward(&[0.1 * t; 15])).expect("logs");
        let pose = Isometry3::translation(0.3, 0.0, 0.1 * t);
        recorder.log_object("tetrahedron", &pose).expect("logs");
        recorder.log_estimate("tetrahedron", (tick % 50 > 10).then_some(&pose)).expect("logs");
        let force = [Vector3::z()];
        recorder.log_contacts(&[Point3::origin()], if tick > 100 { &force } else { &[] }).expect("logs");
        let frame = SignalFrame {
            tensions: Some([t; 5]),
            pose_errors: vec![Some(PoseError { mm: t, deg: t })],
            ..Default::default()
        };
        recorder.log_scalars(&frame).expect("logs");
    }
    recorder.log_text(Level::Warn, "nothing held").expect("logs");
    recorder.log_outcome("failure").expect("logs");
    assert!(
        matches!(recorder.log_object("cup", &Isometry3::identity()), Err(StreamError::Unknown(name)) if name == "cup")
    );
    assert!(matches!(recorder.log_tactile(18, &noise_image(1)), Err(StreamError::Unknown(_))));
    assert!(matches!(recorder.log_height(0, &[0.0; 5], 2, 2), Err(StreamError::Image { .. })));
    recorder.finish().expect("writes");
    let size = size(&path);
    assert!((20_000..900_000).contains(&size), "{size} bytes");
}

#[test]
fn an_unwritable_path_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("file");
    std::fs::write(&file, b"").expect("writes");
    for path in [folder.path().to_owned(), file.join("below.rrd")] {
        match Recorder::create(&path, &Hand::ftac(), &Arm::gen3(), &[]) {
            Err(StreamError::Unwritable { path: named, .. }) => assert_eq!(named, path),
            other => panic!("{:?}", other.map(|_| "a recorder")),
        }
    }
    let address = Target::Connect("not an address".into());
    let result = Recorder::open(&[address], Settings::default(), &Hand::ftac(), &Arm::gen3(), &[]);
    assert!(matches!(result, Err(StreamError::Address(_))));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error() {
    let result = Recorder::create("/dev/full", &Hand::ftac(), &Arm::gen3(), &[]);
    assert!(matches!(result, Err(StreamError::Unwritable { .. })));
}

/// Records `count` images (one every 0.2 s) and as many height maps of a camera; returns the file's size.
fn recorded(count: u32, changing: bool) -> u64 {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("pads.rrd");
    let mut recorder = Recorder::create(&path, &Hand::ftac(), &Arm::gen3(), &[]).expect("opens");
    for i in 0..count {
        recorder.set_time(f64::from(i) * 0.2);
        recorder.log_tactile(3, &noise_image(if changing { i } else { 0 })).expect("logs");
        recorder.log_height(3, &vec![if changing { 1e-3 } else { 1e-6 }; 400], 20, 20).expect("logs");
    }
    recorder.finish().expect("writes");
    size(&path)
}

#[test]
fn an_idle_pad_is_logged_once() {
    let (once, idle, busy) = (recorded(1, false), recorded(50, false), recorded(50, true));
    assert!(idle.abs_diff(once) < 2_000, "1 image: {once}, 50 alike: {idle} bytes");
    assert!(busy > once + 49 * 2_000, "50 different ones: {busy} bytes");
}

#[test]
fn nothing_is_needed_to_record_nowhere() {
    let mut recorder = Recorder::open(&[], Settings::default(), &Hand::ftac(), &Arm::gen3(), &[]).expect("opens");
    recorder.set_time(1.0);
    recorder.log_phase("approach").expect("drops");
    recorder.finish().expect("nothing to write");
}
