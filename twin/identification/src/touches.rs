//! Images of pads that are pressed on the ball, as a session has them, and what they say of where it is.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use control::inverse_kinematics::Joints;
use hand_model::Hand;
use hand_model::robot::{Command, Observation, Readings, RobotBackend, RobotError, TactileFrame, TactileImage, Tick};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use touch::ball_press::{BallPlace, BallPress, locate};
use touch::colour_change::find_change;
use touch::{PhotometricCalibration, StereoOptions};

use crate::kinematic_calibration::Touch;

/// Images that come later than this after those before them are of untouched pads: a press is over, and another begins, s.
pub const PAUSE: f64 = 0.6;

/// Images that come later than this after those before them belong to another look, s.
const LOOK: f64 = 0.1;

/// An image of a pressed pad.
#[derive(Debug, Clone, PartialEq)]
pub struct PressImage {
    /// Number of the press, in the order of the session.
    pub press: usize,
    /// Index of the look: the arm stands during a look.
    pub look: usize,
    pub camera: usize,
    /// What the arm's encoders showed, rad.
    pub arm: Joints,
    /// Angle of the opposition servo, rad.
    pub opposition: f64,
    pub image: Arc<TactileImage>,
    /// The pad before the press.
    pub background: Arc<TactileImage>,
}

/// The untouched pads before a press: the first image of each camera after a pause.
#[derive(Debug, Clone)]
struct Backgrounds {
    /// When images came last, s.
    last: f64,
    images: BTreeMap<usize, Arc<TactileImage>>,
}

impl Default for Backgrounds {
    fn default() -> Self {
        Self { last: f64::NEG_INFINITY, images: BTreeMap::new() }
    }
}

impl Backgrounds {
    /// Notes that images came at `time` (s): whether after a pause.
    fn come(&mut self, time: f64) -> bool {
        let paused = time > self.last + PAUSE;
        if paused {
            self.images.clear();
        }
        self.last = time;
        paused
    }

    /// What a frame is.
    fn compare(&mut self, frame: &TactileFrame) -> Compared<'_> {
        let background = match self.images.entry(frame.camera) {
            Entry::Vacant(place) => {
                place.insert(frame.image.clone());
                return Compared::First;
            }
            Entry::Occupied(known) => known.into_mut(),
        };
        let changed = find_change(&frame.image, background, &StereoOptions::default()).is_some();
        if changed { Compared::Changed(background) } else { Compared::Same }
    }
}

/// A frame beside the untouched pad.
enum Compared<'a> {
    /// It is the untouched pad.
    First,
    /// It looks like it.
    Same,
    /// It differs from this.
    Changed(&'a Arc<TactileImage>),
}

/// When images were taken that belong together; the arm stood meanwhile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Number of the press, in the order of the session.
    pub press: usize,
    /// When its first and its last image came, s.
    pub times: [f64; 2],
}

/// The images of a session that show something, press by press.
#[derive(Debug, Clone, Default)]
pub struct PressImages {
    press: usize,
    backgrounds: Backgrounds,
    images: Vec<PressImage>,
    looks: Vec<Look>,
}

impl PressImages {
    /// Takes what a robot observed. The arm stands while images are taken.
    pub fn see(&mut self, observation: &Observation) {
        if observation.tactile.is_empty() {
            return;
        }
        let begins = observation.time > self.backgrounds.last + LOOK;
        self.press += usize::from(self.backgrounds.come(observation.time));
        match self.looks.last_mut() {
            Some(look) if !begins => look.times[1] = observation.time,
            _ => self.looks.push(Look { press: self.press, times: [observation.time; 2] }),
        }
        for frame in &observation.tactile {
            if let Compared::Changed(background) = self.backgrounds.compare(frame) {
                self.images.push(PressImage {
                    press: self.press,
                    look: self.looks.len() - 1,
                    camera: frame.camera,
                    arm: observation.arm.position,
                    opposition: observation.servos[5].position,
                    image: frame.image.clone(),
                    background: background.clone(),
                });
            }
        }
    }

    /// All of them, and all looks.
    pub fn into_all(self) -> (Vec<PressImage>, Vec<Look>) {
        (self.images, self.looks)
    }

    /// Those of the newest press.
    pub fn of_press(&self) -> impl Iterator<Item = &PressImage> {
        self.images.iter().rev().take_while(|image| image.press == self.press)
    }

    /// Those of the newest look.
    pub fn of_look(&self) -> impl Iterator<Item = &PressImage> {
        self.images.iter().rev().take_while(|image| image.look + 1 == self.looks.len())
    }

    /// When the newest image came, s; before any: minus infinity.
    pub fn newest_time(&self) -> f64 {
        self.backgrounds.last
    }
}

/// A robot that passes on only images that say something: those of untouched pads after a pause, and those of pads that have changed since. A
/// session of it has a twentieth of the images.
pub struct Thinned<R> {
    robot: R,
    backgrounds: Backgrounds,
}

impl<R> Thinned<R> {
    /// Around `robot`.
    pub fn new(robot: R) -> Self {
        Self { robot, backgrounds: Backgrounds::default() }
    }

    /// The robot.
    pub fn robot(&self) -> &R {
        &self.robot
    }

    /// The robot, for itself.
    pub fn into_robot(self) -> R {
        self.robot
    }
}

impl<R: RobotBackend> RobotBackend for Thinned<R> {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let mut readings = self.robot.observe()?;
        if !readings.tactile.is_empty() {
            self.backgrounds.come(readings.time);
            // One frame is always passed on: it says that images came.
            let mut passed = 0;
            readings.tactile.retain(|frame| {
                let says = !matches!(self.backgrounds.compare(frame), Compared::Same) || passed == 0;
                passed += usize::from(says);
                says
            });
        }
        Ok(readings)
    }

    fn send(&mut self, command: &Command) -> Result<Command, RobotError> {
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
    /// As perception takes it; `radius` is the ball's, m.
    pub fn ball_press(&self, radius: f64) -> BallPress {
        BallPress { camera: self.camera, image: self.image.clone(), background: self.background.clone(), radius }
    }
}

/// What a camera shows of the ball in a look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LookTouch {
    /// Number of the press.
    pub press: usize,
    /// Index of the look.
    pub look: usize,
    pub touch: Touch,
}

/// What each camera shows in each look in which it can tell where the ball is, the mean of its images: in the order of presses and cameras.
pub fn look_touches<'a>(
    hand: &Hand,
    calibration: &PhotometricCalibration,
    radius: f64,
    images: impl IntoIterator<Item = &'a PressImage>,
) -> Vec<LookTouch> {
    let images: Vec<&PressImage> = images.into_iter().collect();
    let located: Vec<Option<BallPlace>> =
        images.par_iter().map(|image| locate(hand, calibration, &image.ball_press(radius)).ok().flatten()).collect();
    let mut looks: BTreeMap<(usize, usize, usize), Seen> = BTreeMap::new();
    for (image, place) in images.into_iter().zip(located) {
        let look = looks.entry((image.press, image.camera, image.look)).or_default();
        look.extend(place.map(|place| (image, place)));
    }
    let of = |(&(press, _, look), seen): (&_, &Seen)| mean(seen).map(|touch| LookTouch { press, look, touch });
    looks.iter().filter_map(of).collect()
}

/// One touch of each camera in each press: that of the look that shows the deepest contact.
pub fn deepest(looks: &[LookTouch]) -> Vec<Touch> {
    let mut deepest: BTreeMap<(usize, usize), Touch> = BTreeMap::new();
    for LookTouch { press, touch, .. } in looks {
        let known = deepest.entry((*press, touch.camera)).or_insert(*touch);
        if touch.center.z < known.center.z {
            *known = *touch;
        }
    }
    deepest.into_values().collect()
}

/// The [`deepest`] touches of some images.
pub fn touches<'a>(
    hand: &Hand,
    calibration: &PhotometricCalibration,
    radius: f64,
    images: impl IntoIterator<Item = &'a PressImage>,
) -> Vec<Touch> {
    deepest(&look_touches(hand, calibration, radius, images))
}

/// The images of a camera in a look that show the ball.
type Seen<'a> = Vec<(&'a PressImage, BallPlace)>;

/// What the images of a look say together. Their errors are alike: those of calibration and lens.
fn mean(look: &Seen) -> Option<Touch> {
    let (first, place) = look.first()?;
    let sum = look.iter().fold(Vector3::zeros(), |sum, (_, place)| sum + place.center.coords);
    Some(Touch {
        camera: first.camera,
        arm: first.arm,
        opposition: first.opposition,
        center: Point3::from(sum / look.len() as f64),
        covariance: place.covariance,
    })
}
