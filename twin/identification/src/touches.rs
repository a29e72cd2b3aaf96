//! Images of pads pressed on the ball, from a session, and the ball positions measured in them.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use control::inverse_kinematics::Joints;
use hand_model::Hand;
use hand_model::robot::{
    Observation, Readings, RobotBackend, RobotCommand, RobotError, TactileFrame, TactileImage, Tick,
};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use tactile_perception::ball_press::{BallEstimate, BallPress, locate};
use tactile_perception::colour_change::find_change;
use tactile_perception::{PhotometricCalibration, StereoOptions};

use crate::kinematic_calibration::BallTouch;

/// Pause between images after which the next press starts, s. The next images are of untouched pads.
pub const PRESS_PAUSE: f64 = 0.6;

/// Pause between images after which the next snapshot starts, s.
const SNAPSHOT_PAUSE: f64 = 0.1;

/// Image of a pressed pad.
#[derive(Debug, Clone, PartialEq)]
pub struct PressImage {
    /// Number of the press, in the order of the session.
    pub press: usize,
    /// Index of the snapshot; the arm stands still during a snapshot.
    pub snapshot: usize,
    pub camera: usize,
    /// Joint angles measured by the arm's encoders, rad.
    pub arm: Joints,
    /// Angle of the opposition servo, rad.
    pub opposition: f64,
    pub image: Arc<TactileImage>,
    /// Background: the image of the pad before the press.
    pub background: Arc<TactileImage>,
}

/// Backgrounds of a press: the first image of each camera after a pause, with the pads untouched.
#[derive(Debug, Clone)]
struct Backgrounds {
    /// Time of the newest images, s.
    last: f64,
    images: BTreeMap<usize, Arc<TactileImage>>,
}

impl Default for Backgrounds {
    fn default() -> Self {
        Self { last: f64::NEG_INFINITY, images: BTreeMap::new() }
    }
}

impl Backgrounds {
    /// Notes images at `time` (s). Returns true if they came after a pause.
    fn note_images(&mut self, time: f64) -> bool {
        let paused = time > self.last + PRESS_PAUSE;
        if paused {
            self.images.clear();
        }
        self.last = time;
        paused
    }

    /// Compares a frame with its background.
    fn compare(&mut self, frame: &TactileFrame) -> BackgroundComparison<'_> {
        let background = match self.images.entry(frame.camera) {
            Entry::Vacant(place) => {
                place.insert(frame.image.clone());
                return BackgroundComparison::First;
            }
            Entry::Occupied(known) => known.into_mut(),
        };
        let changed = find_change(&frame.image, background, &StereoOptions::default()).is_some();
        if changed { BackgroundComparison::Changed(background) } else { BackgroundComparison::Same }
    }
}

/// Result of the comparison of a frame with the untouched pad.
enum BackgroundComparison<'a> {
    /// The frame is the first one: the untouched pad itself.
    First,
    /// The frame snapshots like the untouched pad.
    Same,
    /// The frame differs from this background.
    Changed(&'a Arc<TactileImage>),
}

/// Snapshot: times of images that belong together, with the arm at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SnapshotTimes {
    /// Number of the press, in the order of the session.
    pub press: usize,
    /// Times of its first and its last image, s.
    pub times: [f64; 2],
}

/// Images of a session that show a contact, press by press.
#[derive(Debug, Clone, Default)]
pub struct PressImages {
    press: usize,
    backgrounds: Backgrounds,
    images: Vec<PressImage>,
    snapshots: Vec<SnapshotTimes>,
}

impl PressImages {
    /// Takes an observation of the robot. The arm stands still while images are taken.
    pub fn add_observation(&mut self, observation: &Observation) {
        if observation.tactile.is_empty() {
            return;
        }
        let begins = observation.time > self.backgrounds.last + SNAPSHOT_PAUSE;
        self.press += usize::from(self.backgrounds.note_images(observation.time));
        match self.snapshots.last_mut() {
            Some(look) if !begins => look.times[1] = observation.time,
            _ => self.snapshots.push(SnapshotTimes { press: self.press, times: [observation.time; 2] }),
        }
        for frame in &observation.tactile {
            if let BackgroundComparison::Changed(background) = self.backgrounds.compare(frame) {
                self.images.push(PressImage {
                    press: self.press,
                    snapshot: self.snapshots.len() - 1,
                    camera: frame.camera,
                    arm: observation.arm.position,
                    opposition: observation.servos[5].position,
                    image: frame.image.clone(),
                    background: background.clone(),
                });
            }
        }
    }

    /// Returns all images and all snapshots.
    pub fn into_all(self) -> (Vec<PressImage>, Vec<SnapshotTimes>) {
        (self.images, self.snapshots)
    }

    /// Returns the images of the newest press, newest first.
    pub fn of_press(&self) -> impl Iterator<Item = &PressImage> {
        self.images.iter().rev().take_while(|image| image.press == self.press)
    }

    /// Returns the images of the newest snapshot, newest first.
    pub fn of_snapshot(&self) -> impl Iterator<Item = &PressImage> {
        self.images.iter().rev().take_while(|image| image.snapshot + 1 == self.snapshots.len())
    }

    /// Returns the time of the newest image, s; negative infinity before any.
    pub fn newest_time(&self) -> f64 {
        self.backgrounds.last
    }
}

/// Robot wrapper that passes on only informative images: those of untouched pads after a pause, and those of pads that
/// have changed since. Its sessions have a twentieth of the images.
pub struct ImageFilter<R> {
    robot: R,
    backgrounds: Backgrounds,
}

impl<R> ImageFilter<R> {
    /// Wraps `robot`.
    pub fn new(robot: R) -> Self {
        Self { robot, backgrounds: Backgrounds::default() }
    }

    /// Returns the wrapped robot.
    pub fn robot(&self) -> &R {
        &self.robot
    }

    /// Unwraps the robot.
    pub fn into_robot(self) -> R {
        self.robot
    }
}

impl<R: RobotBackend> RobotBackend for ImageFilter<R> {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let mut readings = self.robot.observe()?;
        if !readings.tactile.is_empty() {
            self.backgrounds.note_images(readings.time);
            // At least one frame is passed on as a sign that images arrived.
            let mut passed = 0;
            readings.tactile.retain(|frame| {
                let says = !matches!(self.backgrounds.compare(frame), BackgroundComparison::Same) || passed == 0;
                passed += usize::from(says);
                says
            });
        }
        Ok(readings)
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        self.robot.send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.robot.wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.robot.tick_length()
    }
}

impl PressImage {
    /// Returns the image in the form that perception takes; `radius` is the ball's, m.
    pub fn ball_press(&self, radius: f64) -> BallPress {
        BallPress { camera: self.camera, image: self.image.clone(), background: self.background.clone(), radius }
    }
}

/// Contact that a camera shows in one snapshot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SnapshotContact {
    /// Number of the press.
    pub press: usize,
    /// Index of the snapshot.
    pub look: usize,
    pub touch: BallTouch,
}

/// Returns the mean touch of each camera in each snapshot in which it can locate the ball, in the order of presses and
/// cameras.
pub fn snapshot_contacts<'a>(
    hand: &Hand,
    calibration: &PhotometricCalibration,
    radius: f64,
    images: impl IntoIterator<Item = &'a PressImage>,
) -> Vec<SnapshotContact> {
    let images: Vec<&PressImage> = images.into_iter().collect();
    let located: Vec<Option<BallEstimate>> =
        images.par_iter().map(|image| locate(hand, calibration, &image.ball_press(radius)).ok().flatten()).collect();
    let mut looks: BTreeMap<(usize, usize, usize), CameraImages> = BTreeMap::new();
    for (image, place) in images.into_iter().zip(located) {
        let look = looks.entry((image.press, image.camera, image.snapshot)).or_default();
        look.extend(place.map(|place| (image, place)));
    }
    let of = |(&(press, _, look), seen): (&_, &CameraImages)| {
        mean_touch(seen).map(|touch| SnapshotContact { press, look, touch })
    };
    looks.iter().filter_map(of).collect()
}

/// Returns one touch of each camera in each press, from the snapshot with the deepest contact.
pub fn deepest(looks: &[SnapshotContact]) -> Vec<BallTouch> {
    let mut deepest: BTreeMap<(usize, usize), BallTouch> = BTreeMap::new();
    for SnapshotContact { press, touch, .. } in looks {
        let known = deepest.entry((*press, touch.camera)).or_insert(*touch);
        if touch.center.z < known.center.z {
            *known = *touch;
        }
    }
    deepest.into_values().collect()
}

/// Returns the [`deepest`] touches of the images.
pub fn deepest_touches<'a>(
    hand: &Hand,
    calibration: &PhotometricCalibration,
    radius: f64,
    images: impl IntoIterator<Item = &'a PressImage>,
) -> Vec<BallTouch> {
    deepest(&snapshot_contacts(hand, calibration, radius, images))
}

/// Images of a camera in a snapshot in which the ball was located.
type CameraImages<'a> = Vec<(&'a PressImage, BallEstimate)>;

/// Averages the images of a snapshot. Their errors are common, from calibration and lens, so the covariance does not
/// shrink.
fn mean_touch(look: &CameraImages) -> Option<BallTouch> {
    let (first, place) = look.first()?;
    let sum = look.iter().fold(Vector3::zeros(), |sum, (_, place)| sum + place.center.coords);
    Some(BallTouch {
        camera: first.camera,
        arm: first.arm,
        opposition: first.opposition,
        center: Point3::from(sum / look.len() as f64),
        covariance: place.covariance,
    })
}
