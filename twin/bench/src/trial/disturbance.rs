//! Applies the disturbances of a scenario to the simulated backend at their moments.
//!
//! They reach the backend through the simulator and never the controller. The controller has to find out about wrong
//! detections, objects of another size, forces and failed cameras. It is informed only of digits without power.

use std::sync::Arc;

use anyhow::Result;
use control::executor::Executor;
use nalgebra::Vector3;
use scenarios::disturbance::{Disturbances, EventTiming, PushTarget, TargetObject};
use scenarios::noise::{ObjectNoise, TrialNoise};
use sim::SimulatedRobot;
use sim::robot::GroundTruth;
use world::layout::MAX_OBJECTS;
use world::objects::ObjectModel;

/// A disturbance that begins at a moment of a trial and ends some time later.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum DisturbancePhase {
    /// Not begun.
    #[default]
    Pending,
    /// Active since this time, s.
    Active(f64),
    Finished,
}

/// Change within one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
enum IntervalChange {
    Begins,
    Lasts,
    Ends,
    Nothing,
}

impl DisturbancePhase {
    fn advance(&mut self, moment: &EventTiming, executor: &Executor, time: f64) -> IntervalChange {
        match *self {
            Self::Pending if executor.phase() == moment.phase && executor.motion().progress() >= moment.at => {
                *self = Self::Active(time);
                IntervalChange::Begins
            }
            Self::Active(start) if time - start >= moment.duration => {
                *self = Self::Finished;
                IntervalChange::Ends
            }
            Self::Active(_) => IntervalChange::Lasts,
            Self::Pending | Self::Finished => IntervalChange::Nothing,
        }
    }
}

/// Disturbances of a trial in progress; they branch with the trial.
#[derive(Debug, Clone, Default)]
pub struct Disturber {
    disturbances: Disturbances,
    push: DisturbancePhase,
    slip: DisturbancePhase,
    /// True for objects that the hand has touched.
    touched: [bool; MAX_OBJECTS],
    log: Vec<String>,
}

impl Disturber {
    /// Creates the disturbances of the scenario for a trial with `objects`.
    pub fn new(what: &Disturbances, objects: &[Arc<ObjectModel>]) -> Self {
        let mut log = Vec::new();
        for (object, size) in objects.iter().zip(what.size_factors()).filter(|(_, size)| *size != 1.0) {
            log.push(format!("the {} is {size:.3} times as large as its model", object.name));
        }
        if let Some(wrong) = &what.wrong_position {
            let [x, y, z] = wrong.offset.map(|metres| metres * 1e3);
            let name = &objects[wrong.object.index()].name;
            log.push(format!("the {name} is detected ({x:.0}, {y:.0}, {z:.0}) mm off its pose until it is touched"));
        }
        if !what.disabled().is_empty() {
            let names: Vec<&str> = what.disabled().iter().map(|digit| digit.name()).collect();
            log.push(format!("no power: {}", names.join(", ")));
        }
        if let Some(blind) = &what.blind_pads {
            log.push(format!("cameras failed: {}", blind.pads.join(", ")));
        }
        Self { disturbances: what.clone(), log, ..Self::default() }
    }

    /// Applies the disturbances that exist from the start.
    pub fn prepare(&self, robot: &mut SimulatedRobot) {
        robot.cut_power(self.disturbances.disabled());
        if let Some(blind) = &self.disturbances.blind_pads {
            robot.fail_cameras(&blind.pads, blind.frames);
        }
    }

    /// Applies the disturbances of the coming tick. Returns a description of one that begins now.
    pub fn apply(&mut self, robot: &mut SimulatedRobot, executor: &Executor) -> Option<String> {
        let time = robot.time();
        let mut began = None;
        let name = |target: PushTarget| match target {
            PushTarget::First => "first object",
            PushTarget::Second => "second object",
            PushTarget::Hand => "hand",
        };
        if let Some(push) = &self.disturbances.push {
            let change = self.push.advance(&push.timing(), executor, time);
            if matches!(change, IntervalChange::Begins | IntervalChange::Lasts) {
                robot.apply_force(push.on.object(), Vector3::from(push.force));
            }
            if change == IntervalChange::Begins {
                let force = Vector3::from(push.force).norm();
                began = Some(format!("push of {force:.1} N on the {} at {time:.2} s", name(push.on)));
            }
        }
        if let Some(slip) = &self.disturbances.slip {
            let change = self.slip.advance(&slip.timing(), executor, time);
            let object = slip.object.index();
            match change {
                IntervalChange::Begins => robot.set_friction(object, slip.friction),
                IntervalChange::Ends => robot.set_friction(object, 1.0),
                IntervalChange::Lasts | IntervalChange::Nothing => {}
            }
            if matches!(change, IntervalChange::Begins | IntervalChange::Lasts) {
                robot.apply_force(Some(object), Vector3::from(slip.force));
            }
            if change == IntervalChange::Begins {
                let which =
                    name(if slip.object == TargetObject::First { PushTarget::First } else { PushTarget::Second });
                let force = Vector3::from(slip.force).norm();
                began = Some(format!(
                    "the {which} becomes slippery (friction times {:.2}, tug of {force:.1} N) at {time:.2} s",
                    slip.friction
                ));
            }
        }
        self.log.extend(began.clone());
        began
    }

    /// Notes which objects the hand has touched.
    pub fn note_touched(&mut self, truth: &GroundTruth) {
        for (touched, by) in self.touched.iter_mut().zip(&truth.touched_by) {
            *touched |= *by != 0;
        }
    }

    /// Returns `noise` of a detection of object `index`, plus the position error of the scenario until the hand has
    /// touched the object.
    pub fn perceived_noise(&self, index: usize, noise: &ObjectNoise) -> ObjectNoise {
        match &self.disturbances.wrong_position {
            Some(wrong) if wrong.object.index() == index && !self.touched[index] => {
                ObjectNoise { offset: noise.offset + Vector3::from(wrong.offset), ..*noise }
            }
            _ => *noise,
        }
    }

    /// Returns the noise of the first detections, with the same errors.
    pub fn first_detection_noise(&self, noise: &TrialNoise) -> TrialNoise {
        let objects = std::array::from_fn(|index| self.perceived_noise(index, &noise.objects[index]));
        TrialNoise { objects, ..*noise }
    }

    /// Returns a description of the disturbances so far.
    pub fn description(&self) -> String {
        self.log.join("; ")
    }
}

/// Returns the true objects: `models` scaled by `sizes`.
pub fn scaled_objects(models: &[Arc<ObjectModel>], sizes: &[f64]) -> Result<Vec<Arc<ObjectModel>>> {
    let resize = |(model, size): (&Arc<ObjectModel>, &f64)| -> Result<Arc<ObjectModel>> {
        if *size == 1.0 { Ok(model.clone()) } else { Ok(Arc::new(model.scaled(*size)?)) }
    };
    models.iter().zip(sizes).map(resize).collect()
}
