//! Stiffness of the gel and friction of the pads, from the arm's torques while pads of the palm press on a ball and
//! slide over it.
//!
//! A pad of the palm is rigidly connected to the arm, so the load on it follows from the joint torques
//! ([`arm_load`](crate::arm_load)). Its image gives the penetration of the ball, from which the gel's law predicts the
//! nominal load. The ratio of the two is the ratio of the stiffnesses. While the pad slides, friction over normal force
//! is the coefficient of friction (Coulomb).

use std::collections::BTreeMap;

use hand_model::pads::Pad;
use hand_model::robot::ArmState;
use hand_model::{ArmVector, Hand, RobotModel};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector3};
use statistics::percentile;
use tactile_optics::GelFoundation;

use crate::arm_load::estimate_force;
use crate::ball::{CalibrationBall, Slide};
use crate::tick_record::TickRecord;
use crate::touches::SnapshotContact;
use crate::trace::Trace;

/// Distance from the ball beyond which a snapshot shows an unloaded pad, m.
const UNLOADED_DISTANCE: f64 = 4e-4;
/// Minimum depth at which an image gives the force, m: a relative depth error counts twice.
const MIN_FORCE_DEPTH: f64 = 1e-3;
/// Length of a slide after which the ball has left its dent in the gel, m.
const MIN_SLIDE_LENGTH: f64 = 2.5e-3;
/// Change of height beyond which a pad no longer counts as sliding, m.
const MAX_SLIDE_RISE: f64 = 3e-4;
/// Minimum duration of a slide, ticks.
const MIN_SLIDE_TICKS: usize = 20;
/// Relative standard deviation of the stiffness error common to all presses: depths from images are 2 to 3 % off. Set
/// by hand, from instances 1 to 3.
const COMMON_STIFFNESS_SIGMA: f64 = 0.03;
/// Minimum relative standard deviation of one press: stiffness, friction. Set by hand, from instances 1 to 3, because a
/// few presses do not determine the scatter.
const MIN_PRESS_SIGMA: [f64; 2] = [0.05, 0.015];
/// Spacing of the points over which pressure is summed, m.
const GRID_SPACING: f64 = 1e-4;

/// Estimate of a factor on the nominal value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScaleFactor {
    /// Logarithm of the factor.
    pub deviation: f64,
    /// Standard deviation of the logarithm.
    pub sigma: f64,
}

/// Identified factors of pads and gel; none if there were too few presses.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PadMechanics {
    pub stiffness: Option<ScaleFactor>,
    pub friction: Option<ScaleFactor>,
}

/// Results of individual presses in some sessions, for each factor.
#[derive(Debug, Clone, Default)]
pub struct PressResults {
    /// Logarithms, one per press.
    stiffness: Vec<f64>,
    friction: Vec<f64>,
}

impl PressResults {
    /// Adds the results of a session with the touches `touched`, of the robot `own` with the nominal hand `hand` and
    /// the ball's centre at `middle` (m, frame of the arm's base).
    pub fn add(
        &mut self,
        hand: &Hand,
        own: &RobotModel,
        (ball, middle): (&CalibrationBall, &Point3<f64>),
        trace: &Trace,
        touched: &[SnapshotContact],
    ) {
        let gel = GelFoundation::winkler(&hand.gel());
        let mut presses: BTreeMap<(usize, usize), Vec<&SnapshotContact>> = BTreeMap::new();
        for touch in touched {
            presses.entry((touch.press, touch.touch.camera)).or_default().push(touch);
        }
        for ((press, camera), looks) in presses {
            let pad = &hand.pads[hand.cameras[camera].pad];
            if pad.link.is_some() {
                continue;
            }
            let Some(pressing) = PressSegment::new(own, (ball, middle), trace, press, pad) else { continue };
            let ratios: Vec<f64> = looks
                .iter()
                .filter(|look| look.touch.depth(hand, ball) > MIN_FORCE_DEPTH)
                .filter_map(|look| {
                    let borne = -pressing.load_at_snapshot(look.look)?.force.z;
                    let drawn = pad_force(pad, &gel, &look.touch.center, ball.radius);
                    (borne > 0.0 && drawn > 0.0).then(|| (borne / drawn).ln())
                })
                .collect();
            self.stiffness.extend(percentile(&ratios, 50.0));
            if let Some(slide) = &ball.slide {
                self.friction.extend(pressing.slide_friction().map(|friction| (friction / slide.friction).ln()));
            }
        }
    }

    /// Combines the presses into one estimate of each factor.
    pub fn combine(&self, slide: Option<&Slide>) -> PadMechanics {
        let known = slide.map_or(0.0, |slide| slide.uncertain);
        PadMechanics {
            stiffness: factor(&self.stiffness, MIN_PRESS_SIGMA[0], COMMON_STIFFNESS_SIGMA),
            friction: factor(&self.friction, MIN_PRESS_SIGMA[1], known),
        }
    }
}

impl PadMechanics {
    /// Adds the uncertainty of the arm's torque gains, with `covariance` of their logarithms. `moved` holds the
    /// estimates with the logarithm of each gain in turn increased by `step`.
    #[must_use]
    pub fn with_gain_uncertainty(self, moved: &[Self], step: f64, covariance: &DMatrix<f64>) -> Self {
        let wider = |of: fn(&Self) -> Option<ScaleFactor>| {
            let factor = of(&self)?;
            let slope =
                |joint: usize| (of(&moved[joint]).map_or(0.0, |moved| moved.deviation - factor.deviation)) / step;
            let slopes = DVector::from_fn(moved.len(), |joint, _| slope(joint));
            let more = (slopes.transpose() * covariance * slopes)[(0, 0)];
            Some(ScaleFactor { sigma: (factor.sigma.powi(2) + more).sqrt(), ..factor })
        };
        Self { stiffness: wider(|all| all.stiffness), friction: wider(|all| all.friction) }
    }
}

/// Returns the median of the presses. Each has an independent error of at least `one`, more if they scatter more;
/// `alike` is the error common to all.
fn factor(presses: &[f64], one: f64, alike: f64) -> Option<ScaleFactor> {
    let deviation = percentile(presses, 50.0)?;
    let off: Vec<f64> = presses.iter().map(|press| (press - deviation).abs()).collect();
    // For a normal distribution, the median absolute deviation is 0.6745 standard deviations, and a median has 1.57
    // times a mean's variance.
    let scatter = percentile(&off, 50.0)? / 0.6745;
    let own = one.max(scatter).powi(2) * 1.57 / presses.len() as f64;
    Some(ScaleFactor { deviation, sigma: (own + alike * alike).sqrt() })
}

/// Returns the force (N) on a ball of this radius (m) with its centre at `center` (pad frame) under the pressure law
/// `gel`, integrated over the pad's surface.
fn pad_force(pad: &Pad, gel: &GelFoundation, center: &Point3<f64>, radius: f64) -> f64 {
    let reach = (radius / GRID_SPACING) as i32;
    let steps = || (-reach..=reach).map(|n| f64::from(n) * GRID_SPACING);
    let pressure = |across: f64, along: f64| {
        let (x, y) = (center.x + across, center.y + along);
        let square = radius * radius - across * across - along * along;
        let on = square > 0.0 && x.abs() < 0.5 * pad.w && y.abs() < 0.5 * pad.h;
        if on { gel.pressure((pad.surface_height(x, y) - center.z + square.sqrt()).max(0.0)) } else { 0.0 }
    };
    steps().flat_map(|x| steps().map(move |y| (x, y))).map(|(x, y)| pressure(x, y)).sum::<f64>()
        * GRID_SPACING
        * GRID_SPACING
}

/// Load on a pad of the palm at an instant of a press.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PressLoad {
    /// Centre of the ball in the pad frame, from the arm's kinematics alone, m.
    middle: Point3<f64>,
    /// Force on the pad in the pad frame, N; z points out of the pad.
    force: Vector3<f64>,
}

/// A press of a pad of the palm.
struct PressSegment<'a> {
    own: &'a RobotModel,
    middle: &'a Point3<f64>,
    trace: &'a Trace,
    pad: &'a Pad,
    /// State of the arm before the first contact of the pad.
    before: ArmState,
    /// Number of the press.
    press: usize,
}

impl<'a> PressSegment<'a> {
    /// Returns none if no snapshot shows the pad clear of the ball.
    fn new(
        own: &'a RobotModel,
        (ball, middle): (&CalibrationBall, &'a Point3<f64>),
        trace: &'a Trace,
        press: usize,
        pad: &'a Pad,
    ) -> Option<Self> {
        let mut pressing = Self { own, middle, trace, pad, before: ArmState::default(), press };
        let looks = (0..trace.snapshots.len()).filter(|look| trace.snapshots[*look].press == press);
        let is_clear = |shown: &ArmState| {
            let at = pressing.ball_center_at(shown);
            at.z - ball.radius - pad.surface_height(at.x, at.y) > UNLOADED_DISTANCE
        };
        let before = looks.map_while(|look| pressing.mean_arm_state(look)).take_while(is_clear).last()?;
        pressing.before = before;
        Some(pressing)
    }

    /// Returns `base_from_pad` for the measured state `shown` of the arm.
    fn pose(&self, shown: &ArmState) -> Isometry3<f64> {
        let RobotModel { hand, arm, .. } = self.own;
        arm.tool_pose(&shown.position) * hand.palm_from_flange.inverse() * self.pad.link_from_pad
    }

    fn ball_center_at(&self, shown: &ArmState) -> Point3<f64> {
        self.pose(shown).inverse_transform_point(self.middle)
    }

    fn rows(&self, from: f64, to: f64) -> &[TickRecord] {
        let at = |time: f64| self.trace.rows.partition_point(|row| row.time < time);
        &self.trace.rows[at(from)..at(to).max(at(from))]
    }

    /// Returns the mean state of the arm during a snapshot.
    fn mean_arm_state(&self, look: usize) -> Option<ArmState> {
        let [from, to] = self.trace.snapshots.get(look)?.times;
        let half = 0.5 * self.trace.tick;
        let rows = self.rows(from - half, to + half);
        let mean = |value: fn(&ArmState) -> ArmVector| {
            let mean = |joint: usize| rows.iter().map(|row| value(&row.arm)[joint]).sum::<f64>() / rows.len() as f64;
            (0..self.own.arm.joints()).map(mean).collect()
        };
        (!rows.is_empty()).then(|| ArmState {
            position: mean(|arm| arm.position),
            torque: mean(|arm| arm.torque),
            ..ArmState::default()
        })
    }

    fn load(&self, shown: &ArmState) -> Option<PressLoad> {
        let force = estimate_force(self.own, [&self.before, shown], self.middle)?;
        let pose = self.pose(shown);
        Some(PressLoad { middle: self.ball_center_at(shown), force: pose.inverse_transform_vector(&force) })
    }

    fn load_at_snapshot(&self, look: usize) -> Option<PressLoad> {
        self.load(&self.mean_arm_state(look)?)
    }

    /// Returns the median of friction over normal force during the ticks after the last snapshot in which the pad
    /// slides; none if there are too few.
    fn slide_friction(&self) -> Option<f64> {
        let looks = &self.trace.snapshots;
        let last = looks.iter().rposition(|look| look.press == self.press)?;
        let from = self.ball_center_at(&self.mean_arm_state(last)?);
        let end = looks.get(last + 1).map_or(f64::INFINITY, |next| next.times[0]);
        let ratios: Vec<f64> = self
            .rows(looks[last].times[1], end)
            .iter()
            .filter(|row| {
                let way = self.ball_center_at(&row.arm) - from;
                way.xy().norm() > MIN_SLIDE_LENGTH && way.z.abs() < MAX_SLIDE_RISE
            })
            .filter_map(|row| self.load(&row.arm))
            .filter(|load| load.force.z < 0.0)
            .map(|load| load.force.xy().norm() / -load.force.z)
            .collect();
        if ratios.len() < MIN_SLIDE_TICKS { None } else { percentile(&ratios, 50.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On a pad's flat middle, the sum over its surface agrees with the closed-form law of a ball. At its edge, the
    /// force is smaller.
    #[test]
    fn a_pad_bears_less_at_its_edge() {
        let hand = Hand::ftac();
        let pad = hand.pads.iter().find(|pad| pad.link.is_none()).expect("a pad of the palm");
        let gel = GelFoundation::winkler(&hand.gel());
        let (radius, depth) = (0.008, 0.0012);
        let at = |x: f64| pad_force(pad, &gel, &Point3::new(x, 0.0, radius - depth), radius);
        let law = gel.ball_force(radius, depth);
        assert!((at(0.0) / law - 1.0).abs() < 0.01, "{} {law}", at(0.0));
        assert!(at(0.5 * pad.w - pad.edge_radius) < 0.9 * law);
    }

    /// A stiffness proportional to the mean of all gains is as uncertain as that mean. A friction that depends on no
    /// gain keeps its uncertainty.
    #[test]
    fn unsure_gains_make_stiffness_unsure() {
        let factor = |deviation| Some(ScaleFactor { deviation, sigma: 0.03 });
        let found = PadMechanics { stiffness: factor(0.1), friction: factor(0.2) };
        let moved = [PadMechanics { stiffness: factor(0.1 - 0.01 / 7.0), friction: factor(0.2) }; 7];
        let covariance = DMatrix::from_element(7, 7, 0.04 * 0.04);
        let wider = found.with_gain_uncertainty(&moved, 0.01, &covariance);
        assert!((wider.stiffness.expect("a factor").sigma - 0.05).abs() < 1e-9, "{wider:?}");
        assert_eq!(wider.friction, found.friction);
    }

    /// One outlying press hardly moves the median and makes it less certain. The common error remains for any number of
    /// presses.
    #[test]
    fn a_factor_is_the_median_of_its_presses() {
        let presses: Vec<f64> = (0..100).map(|n| 0.1 + 0.01 * f64::from(n % 5 - 2)).chain([9.0]).collect();
        let found = factor(&presses, 0.001, 0.03).expect("a factor");
        assert!((found.deviation - 0.1).abs() < 1e-9 && (0.03..0.031).contains(&found.sigma), "{found:?}");
        assert!(factor(&[], 0.1, 0.1).is_none());
    }
}
