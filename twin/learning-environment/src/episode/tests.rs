//! Episodes repeat by seed, refuse invalid actions, and are judged.

use hand_model::RobotModel;
use std::sync::LazyLock;

use control::Twist;
use scenarios::Scenario;

use super::*;
use bench::builtin::make_scene_bench;
use control::action::{Action, ActionError, ArmAction, HandAction};

static BENCH: LazyLock<Bench> =
    LazyLock::new(|| make_scene_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 3, EPISODE_SEED, true).unwrap());

fn options(task: EpisodeTask) -> EpisodeOptions {
    EpisodeOptions { task, images: None, combination: None, objects: Vec::new() }
}

fn action(twist: [f64; 6], tension: f64) -> Action {
    let hand = HandAction::Tensions { tensions: [tension; 5].into(), opposition: 0.4 };
    Action { arm: ArmAction::Twist(Twist::from(twist)), hand }
}

/// Returns the bits of all measurements and object poses after some steps.
fn finished(task: EpisodeTask, images: Option<usize>, seed: u64) -> (Vec<u64>, Vec<u8>) {
    let mut episode = Episode::begin(&BENCH, EpisodeOptions { images, ..options(task) }, seed).unwrap();
    for n in 0..8 {
        let sign = if n % 2 == 0 { 1.0 } else { -1.0 };
        episode.scene.step(&action([0.1 * sign, 0.2, -0.1, 0.0, 0.3 * sign, 0.0], f64::from(n))).unwrap();
    }
    let scene = &episode.scene;
    let mut bits: Vec<u64> = scene.servos().iter().map(|servo| servo.position.to_bits()).collect();
    bits.extend(scene.arm().position.iter().map(|angle| angle.to_bits()));
    bits.extend(
        scene
            .truth()
            .objects
            .iter()
            .flat_map(|pose| pose.translation.vector.iter().map(|v| v.to_bits()).collect::<Vec<_>>()),
    );
    (bits, scene.images().map(|images| images.rgb().to_vec()).unwrap_or_default())
}

#[test]
fn a_seed_gives_the_same_bits_and_another_one_others() {
    let one = finished(EpisodeTask::PickOne, Some(32), 5);
    assert_eq!(one, finished(EpisodeTask::PickOne, Some(32), 5));
    let other = finished(EpisodeTask::PickOne, Some(32), 6);
    assert!(one.0 != other.0 && one.1 != other.1);
    assert_eq!(one.0, finished(EpisodeTask::PickOne, None, 5).0, "images change nothing else");
}

#[test]
fn the_palm_moves_as_told_and_nothing_is_held_by_an_open_hand() {
    let mut episode = Episode::begin(&BENCH, options(EpisodeTask::PickTwo), 1).unwrap();
    assert_eq!((episode.detections().len(), episode.objects().count()), (2, 2));
    let before = episode.scene.palm();
    for _ in 0..20 {
        episode.scene.step(&action([0.0, 0.0, 0.05, 0.0, 0.0, 0.0], 0.0)).unwrap();
    }
    let rise = episode.scene.palm().translation.z - before.translation.z;
    assert!((rise - 0.05).abs() < 0.01, "{rise}");
    let judgement = episode.judge();
    assert_eq!((judgement.held, judgement.success, judgement.lost), (vec![false; 2], false, false));
    assert!((episode.scene.time() - 1.0).abs() < 1e-9);
}

#[test]
fn what_is_no_action_is_refused_and_changes_nothing() {
    let mut episode = Episode::begin(&BENCH, options(EpisodeTask::PickOne), 2).unwrap();
    let refused = |episode: &mut Episode, action: &Action| match episode.scene.step(action) {
        Err(error @ ActionError::Range { .. }) => error.to_string(),
        other => panic!("{other:?}"),
    };
    let nan = action([0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0], 0.0);
    assert_eq!(refused(&mut episode, &nan), "palm velocity[1]: found NaN, expected -0.5 to 0.5 m/s");
    assert!(refused(&mut episode, &action([0.0; 6], -1.0)).starts_with("tensions[0]: found -1, expected 0 to "));
    let joints = Action { arm: ArmAction::Joints([f64::INFINITY; 7].into()), ..action([0.0; 6], 0.0) };
    assert_eq!(refused(&mut episode, &joints), "arm joints[0]: found inf, expected -100 to 100 rad");
    assert_eq!(episode.scene.time(), 0.0);
}

#[test]
fn the_second_pick_begins_with_the_first_object_in_the_hand() {
    let mut episode = Episode::begin(&BENCH, options(EpisodeTask::PickSecond), 3).unwrap();
    let judgement = episode.judge();
    assert_eq!(judgement.held, [true, false]);
    assert!(judgement.progress.touch > 0.3 && judgement.progress.lift > 0.3, "{judgement:?}");
}

/// Objects are drawn from the given names by the seed, and every one of them turns up.
#[test]
fn objects_can_be_chosen() {
    let names = ["lemon", "golf_ball", "can_66"].map(str::to_owned).to_vec();
    let of = |task, seed| {
        let asked = EpisodeOptions { objects: names.clone(), ..options(task) };
        Episode::begin(&BENCH, asked, seed).map(|episode| episode.objects().map(str::to_owned).collect::<Vec<_>>())
    };
    let drawn: Vec<_> = (0..12).map(|seed| of(EpisodeTask::PickOne, seed).unwrap()).collect();
    assert!(names.iter().all(|name| drawn.iter().any(|drawn| drawn[..] == [name.clone()])), "{drawn:?}");
    let two = of(EpisodeTask::PickTwo, 3).unwrap();
    assert!(two.len() == 2 && two[0] != two[1], "{two:?}");
    let error = of(EpisodeTask::PickSecond, 3).unwrap_err().to_string();
    assert_eq!(error, "objects: found 3 names, expected none for a task that begins with a planned grasp");
    let asked = EpisodeOptions { objects: vec!["lemmon".to_owned()], ..options(EpisodeTask::PickOne) };
    let error = Episode::begin(&BENCH, asked, 1).map(|_| ()).unwrap_err().to_string();
    assert!(error.starts_with("object: found `lemmon`, expected one of "), "{error}");
}

/// Progress rises while the palm approaches the object, from the first step on.
#[test]
fn progress_rises_on_the_way() {
    let mut episode = Episode::begin(&BENCH, options(EpisodeTask::PickOne), 4).unwrap();
    let mut before = episode.judge().progress;
    for _ in 0..10 {
        let target = episode.detections()[0].pose().translation.vector;
        let way = (target - episode.scene.palm().translation.vector).normalize() * 0.2;
        episode.scene.step(&action([way.x, way.y, way.z, 0.0, 0.0, 0.0], 0.0)).unwrap();
        let now = episode.judge().progress;
        assert!(now.reach > before.reach && now.near >= before.near, "{before:?} {now:?}");
        before = now;
    }
}

#[test]
fn another_combination_than_there_are_is_refused() {
    let asked = EpisodeOptions { combination: Some(3), ..options(EpisodeTask::PickOne) };
    let error = Episode::begin(&BENCH, asked, 1).map(|_| ()).unwrap_err().to_string();
    assert_eq!(error, "combination: found 3, expected 0 to 2");
}
