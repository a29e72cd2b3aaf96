//! Short recordings are read back with Rerun's own reader: entities, time lines, images and values. A failed write is
//! an error, and unchanged data are not repeated.

use std::collections::BTreeSet;
use std::path::Path;

use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::TactileImage;
use hand_model::{Arm, RobotModel};
use nalgebra::{Isometry3, Point3, Vector3};
use rerun::{
    Arrows3D, ChunkStore, ChunkStoreConfig, Clear, Component, ComponentDescriptor, EncodedImage, EntityPath, Scalars,
    StoreKind, TextLog, Transform3D, components,
};
use telemetry::{
    DrawnObject, LogLevel, PoseError, Recorder, RecorderSettings, RecordingTarget, SignalFrame, TelemetryError,
    TrialProperties,
};
use telemetry::{SIM_TIME, TICK, entities};

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

/// Reads the recording in a file, without its layout.
fn read_back(path: &Path) -> ChunkStore {
    let mut file = std::fs::File::open(path).expect("the recording exists");
    let stores = ChunkStore::from_rrd_reader(&ChunkStoreConfig::ALL_DISABLED, &mut file).expect("Rerun reads it");
    let mut recordings = stores.into_iter().filter(|(id, _)| id.kind() == StoreKind::Recording);
    let (_, recording) = recordings.next().expect("a recording");
    assert!(recordings.next().is_none(), "one recording a file");
    recording
}

/// Returns every row of a component at `path`, in order: time (s) and tick (`None` for static data), and the values.
fn rows<C: Component>(store: &ChunkStore, path: &str, component: ComponentDescriptor) -> Vec<Row<C>> {
    let mut rows = Vec::new();
    let here = store.iter_physical_chunks().filter(|chunk| chunk.entity_path() == &EntityPath::from(path));
    for chunk in here {
        let times = |name: &'static str| chunk.timelines().get(&name.into()).map(|column| column.times_raw().to_vec());
        let (seconds, ticks) = (times(SIM_TIME), times(TICK));
        for row in 0..chunk.num_rows() {
            let Some(values) = chunk.component_batch::<C>(component.component, row) else { continue };
            let values = values.expect("of its type");
            let time = seconds.as_ref().map(|nanos| nanos[row] as f64 * 1e-9);
            rows.push(Row { time, tick: ticks.as_ref().map(|ticks| ticks[row]), values });
        }
    }
    rows.sort_by_key(|row| row.tick);
    rows
}

struct Row<C> {
    time: Option<f64>,
    tick: Option<i64>,
    values: Vec<C>,
}

/// Records 200 ticks of 10 ms: a moving arm and object, an estimate that comes and goes, a force from tick 101 on.
fn record(path: &Path, robot: &RobotModel) {
    let RobotModel { hand, arm, .. } = robot;
    let mut recorder = Recorder::create(path, robot, &[tetrahedron()]).expect("opens");
    let properties =
        TrialProperties { combination: "tetrahedron".into(), condition: "touch".into(), ..Default::default() };
    recorder.log_properties(&properties).expect("logs");
    recorder.log_phase("approach").expect("logs");
    for tick in 0..200 {
        let t = f64::from(tick) * 0.01;
        recorder.set_time(t);
        let mut q = Arm::gen3().home;
        q[0] = 0.1 * t;
        let links = arm.tree.forward(&q);
        let palm = links[6] * arm.last_from_tool * hand.palm_from_flange.inverse();
        recorder.log_robot(&links, &palm, &hand.tree.forward(&[0.1 * t; 15])).expect("logs");
        let pose = Isometry3::translation(0.3, 0.0, 0.1 * t);
        recorder.log_object("tetrahedron", &pose).expect("logs");
        recorder.log_estimate("tetrahedron", (tick % 50 > 10).then_some(&pose)).expect("logs");
        let force = [Vector3::z()];
        recorder.log_contacts(&[Point3::origin()], if tick > 100 { &force } else { &[] }, &[]).expect("logs");
        let frame = SignalFrame {
            tensions: Some([t; 5].into()),
            pose_errors: vec![Some(PoseError { mm: t, deg: t })],
            ..Default::default()
        };
        recorder.log_scalars(&frame).expect("logs");
        if tick % 20 == 0 {
            recorder.log_tactile(3, &noise_image(tick as u32)).expect("logs");
        }
    }
    recorder.log_text(LogLevel::Warn, "nothing held").expect("logs");
    recorder.log_outcome("failure").expect("logs");
    assert!(
        matches!(recorder.log_object("cup", &Isometry3::identity()), Err(TelemetryError::Unknown(name)) if name == "cup")
    );
    assert!(matches!(recorder.log_tactile(18, &noise_image(1)), Err(TelemetryError::Unknown(_))));
    assert!(matches!(recorder.log_height(0, &[0.0; 5], 2, 2), Err(TelemetryError::Image { .. })));
    recorder.finish().expect("writes");
}

#[test]
fn a_recording_is_read_back() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("new/run.rrd");
    let robot = RobotModel::ftac_gen3();
    let hand = &robot.hand;
    record(&path, &robot);
    let store = read_back(&path);
    let logged: BTreeSet<String> = store.iter_physical_chunks().map(|chunk| chunk.entity_path().to_string()).collect();
    let camera = entities::tactile(&hand.cameras[3].name);
    let object = entities::object("tetrahedron");
    let expected = [
        entities::HAND,
        &entities::arm_link(0),
        &entities::hand_link(&hand.tree.joints[0].name),
        &object,
        &entities::estimate("tetrahedron"),
        entities::CONTACTS,
        entities::TENSIONS,
        entities::POSE_ERROR_MM,
        entities::PHASE,
        entities::LOG,
        entities::OUTCOME,
        &camera,
    ];
    for path in expected {
        assert!(logged.contains(&format!("/{path}")), "{path} is not in {logged:?}");
    }
    // The object rises at 0.1 m/s.
    let poses = rows::<components::Translation3D>(&store, &object, Transform3D::descriptor_translation());
    assert!(poses.len() > 40, "{} poses in 2 s at 30 Hz", poses.len());
    for Row { time, tick, values } in poses.iter().filter(|row| row.tick.is_some()) {
        let (time, tick) = (time.expect("a time"), tick.expect("a tick"));
        let [x, y, z] = values[0].0.0;
        assert!(
            (x - 0.3).abs() < 1e-6 && y == 0.0 && (f64::from(z) - 0.1 * time).abs() < 1e-6,
            "{x} {y} {z} at {time}"
        );
        assert!((time - 0.01 * (tick - first_tick(&poses)) as f64).abs() < 1e-9, "tick {tick} at {time} s");
    }
    for Row { time, values, .. } in
        rows::<components::Scalar>(&store, entities::TENSIONS, Scalars::descriptor_scalars())
    {
        let time = time.expect("a time");
        assert!(values.len() == 5 && values.iter().all(|tension| (tension.0.0 - time).abs() < 1e-3), "at {time}");
    }
    // Forces begin at tick 101, and a camera gives an image every 0.2 s.
    let arrows = rows::<components::Vector3D>(&store, entities::CONTACTS, Arrows3D::descriptor_vectors());
    let first = arrows.iter().find(|row| !row.values.is_empty()).and_then(|row| row.time).expect("a force");
    assert!((1.01..1.05).contains(&first), "the first force is at {first} s");
    let images = rows::<components::Blob>(&store, &camera, EncodedImage::descriptor_blob());
    assert_eq!(images.len(), 10);
    for image in &images {
        let picture = image::load_from_memory(&image.values[0].0).expect("a JPEG");
        let side = RecorderSettings::default().image_side as u32;
        assert_eq!((picture.width(), picture.height()), (side, side));
    }
    let texts = rows::<components::Text>(&store, entities::LOG, TextLog::descriptor_text());
    let said: Vec<&str> = texts.iter().map(|row| row.values[0].0.as_str()).collect();
    assert_eq!(said, ["phase: approach", "nothing held", "outcome: failure"]);
}

/// Returns the tick at time 0.
fn first_tick(poses: &[Row<components::Translation3D>]) -> i64 {
    poses.iter().find(|row| row.time == Some(0.0)).and_then(|row| row.tick).expect("the first pose")
}

#[test]
fn an_unwritable_path_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().expect("folder");
    let file = folder.path().join("file");
    std::fs::write(&file, b"").expect("writes");
    for path in [folder.path().to_owned(), file.join("below.rrd")] {
        match Recorder::create(&path, &RobotModel::ftac_gen3(), &[]) {
            Err(TelemetryError::Unwritable { path: named, .. }) => assert_eq!(named, path),
            other => panic!("{:?}", other.map(|_| "a recorder")),
        }
    }
    let address = RecordingTarget::Connect("not an address".into());
    let result = Recorder::open(&[address], RecorderSettings::default(), &RobotModel::ftac_gen3(), &[]);
    assert!(matches!(result, Err(TelemetryError::Address(_))));
}

/// An earlier recording stays until the new one is complete.
#[test]
fn a_recording_gets_its_name_when_it_is_closed() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("trial.rrd");
    let names = || -> Vec<_> {
        let files = std::fs::read_dir(folder.path()).expect("folder");
        files.map(|file| file.expect("file").file_name()).collect()
    };
    std::fs::write(&path, "an earlier recording").expect("writes");
    let open = || Recorder::create(&path, &RobotModel::ftac_gen3(), &[]).expect("opens");
    let recorder = open();
    assert_eq!(names().len(), 2, "{:?}", names());
    recorder.discard().expect("removes");
    drop(open());
    assert_eq!(std::fs::read(&path).expect("reads"), b"an earlier recording");
    open().finish().expect("writes");
    assert_eq!(names(), ["trial.rrd"]);
    read_back(&path);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error() {
    let result = Recorder::create("/dev/full", &RobotModel::ftac_gen3(), &[]);
    assert!(matches!(result, Err(TelemetryError::Unwritable { .. })));
}

/// Records `count` images (one every 0.2 s) and as many height maps of a camera. Returns how many of each are in the
/// file.
fn recorded(count: u32, changing: bool) -> [usize; 2] {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("pads.rrd");
    let robot = RobotModel::ftac_gen3();
    let mut recorder = Recorder::create(&path, &robot, &[]).expect("opens");
    for i in 0..count {
        recorder.set_time(f64::from(i) * 0.2);
        recorder.log_tactile(3, &noise_image(if changing { i } else { 0 })).expect("logs");
        recorder.log_height(3, &vec![if changing { 1e-3 } else { 1e-6 }; 400], 20, 20).expect("logs");
    }
    recorder.finish().expect("writes");
    let store = read_back(&path);
    let name = &robot.hand.cameras[3].name;
    [entities::tactile(name), entities::height(name)]
        .map(|path| rows::<components::Blob>(&store, &path, EncodedImage::descriptor_blob()).len())
}

#[test]
fn an_idle_pad_is_logged_once() {
    assert_eq!(recorded(50, false), [1, 1]);
    assert_eq!(recorded(50, true), [50, 50]);
}

#[test]
fn nothing_is_needed_to_record_nowhere() {
    let mut recorder = Recorder::open(&[], RecorderSettings::default(), &RobotModel::ftac_gen3(), &[]).expect("opens");
    recorder.set_time(1.0);
    recorder.log_phase("approach").expect("drops");
    recorder.finish().expect("nothing to write");
}

/// Height maps and estimates are removed once when they become invalid, and appear again later.
#[test]
fn what_is_gone_is_taken_off() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("gone.rrd");
    let robot = RobotModel::ftac_gen3();
    let mut recorder = Recorder::create(&path, &robot, &[tetrahedron()]).expect("opens");
    for round in 0..2 {
        let time = f64::from(round);
        recorder.set_time(time);
        recorder.log_height(3, &[1e-3; 400], 20, 20).expect("logs");
        recorder.log_estimate("tetrahedron", Some(&Isometry3::translation(0.1, 0.0, time))).expect("logs");
        recorder.log_touch_covariance("tetrahedron", &(nalgebra::Matrix3::identity() * 1e-6)).expect("logs");
        for later in [0.4, 0.5] {
            recorder.set_time(time + later);
            recorder.clear_heights().expect("logs");
            recorder.log_estimate("tetrahedron", None).expect("logs");
        }
    }
    recorder.finish().expect("writes");
    let store = read_back(&path);
    for entity in [entities::height(&robot.hand.cameras[3].name), entities::estimate("tetrahedron")] {
        let cleared = rows::<components::ClearIsRecursive>(&store, &entity, Clear::descriptor_is_recursive());
        assert_eq!(cleared.len(), 2, "{entity}");
        assert!(cleared.iter().all(|row| row.time.is_some_and(|time| (time % 1.0 - 0.4).abs() < 1e-6)), "{entity}");
    }
}

/// Without ground truth no object and no force is recorded, whatever is handed over.
#[test]
fn truth_is_recorded_only_where_it_is_shown() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("believed.rrd");
    let settings = RecorderSettings { truth: false, ..RecorderSettings::default() };
    let targets = [RecordingTarget::File(path.clone())];
    let mut recorder = Recorder::open(&targets, settings, &RobotModel::ftac_gen3(), &[tetrahedron()]).expect("opens");
    recorder.set_time(0.1);
    recorder.log_object("tetrahedron", &Isometry3::translation(0.1, 0.0, 0.0)).expect("dropped");
    recorder.log_contacts(&[Point3::origin()], &[Vector3::z()], &[]).expect("dropped");
    recorder.finish().expect("writes");
    let store = read_back(&path);
    let moved = rows::<components::Translation3D>(
        &store,
        &entities::object("tetrahedron"),
        Transform3D::descriptor_translation(),
    );
    assert!(moved.is_empty());
    assert!(rows::<components::Vector3D>(&store, entities::CONTACTS, Arrows3D::descriptor_vectors()).is_empty());
}
