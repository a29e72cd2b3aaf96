//! Disturbances in action: applies those of a scenario to the simulated body at their moments.
//!
//! They reach the body through the simulator and never the controller. The controller has to find out about wrong prior
//! perception, objects of another size, forces and failed cameras. It does know which of its digits are without power.

use std::sync::Arc;

use anyhow::Result;
use control::executor::Executor;
use nalgebra::Vector3;
use scenarios::disturbance::{Disturbances, Moment, Target, Which};
use scenarios::noise::{ObjectNoise, TrialNoise};
use sim::SimulatedRobot;
use sim::robot::Truth;
use world::layout::MOST_OBJECTS;
use world::objects::ObjectModel;

/// A disturbance that begins at a moment of a trial and ends some time later.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Interval {
    /// Has not begun.
    #[default]
    Ahead,
    /// Active since this time, s.
    Since(f64),
    Over,
}

/// Change within one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Change {
    Begins,
    Lasts,
    Ends,
    Nothing,
}

impl Interval {
    fn advance(&mut self, moment: &Moment, executor: &Executor, time: f64) -> Change {
        match *self {
            Self::Ahead if executor.phase() == moment.phase && executor.motion().progress() >= moment.at => {
                *self = Self::Since(time);
                Change::Begins
            }
            Self::Since(start) if time - start >= moment.duration => {
                *self = Self::Over;
                Change::Ends
            }
            Self::Since(_) => Change::Lasts,
            Self::Ahead | Self::Over => Change::Nothing,
        }
    }
}

/// Disturbances of a trial in progress; they branch with the trial.
#[derive(Debug, Clone, Default)]
pub struct Disturber {
    what: Disturbances,
    push: Interval,
    slip: Interval,
    /// True for objects that the hand has touched.
    touched: [bool; MOST_OBJECTS],
    log: Vec<String>,
}

impl Disturber {
    /// Creates the disturbances of the scenario for a trial with `objects`.
    pub fn new(what: &Disturbances, objects: &[Arc<ObjectModel>]) -> Self {
        let mut log = Vec::new();
        for (object, size) in objects.iter().zip(what.sizes()).filter(|(_, size)| *size != 1.0) {
            log.push(format!("the {} is {size:.3} times as large as its model", object.name));
        }
        if let Some(wrong) = &what.wrong_position {
            let [x, y, z] = wrong.offset.map(|metres| metres * 1e3);
            let name = &objects[wrong.object.index()].name;
            log.push(format!("the {name} is seen ({x:.0}, {y:.0}, {z:.0}) mm beside its place until it is touched"));
        }
        if !what.disabled().is_empty() {
            let names: Vec<&str> = what.disabled().iter().map(|digit| digit.name()).collect();
            log.push(format!("no power: {}", names.join(", ")));
        }
        if let Some(blind) = &what.blind_pads {
            log.push(format!("cameras failed: {}", blind.pads.join(", ")));
        }
        Self { what: what.clone(), log, ..Self::default() }
    }

    /// Applies the disturbances that exist from the beginning.
    pub fn prepare(&self, robot: &mut SimulatedRobot) {
        robot.cut_power(self.what.disabled());
        if let Some(blind) = &self.what.blind_pads {
            robot.fail_cameras(&blind.pads, blind.frames);
        }
    }

    /// Applies the disturbances of the coming tick. Returns a description of one that begins now.
    pub fn act(&mut self, robot: &mut SimulatedRobot, executor: &Executor) -> Option<String> {
        let time = robot.time();
        let mut began = None;
        let name = |target: Target| match target {
            Target::First => "first object",
            Target::Second => "second object",
            Target::Hand => "hand",
        };
        if let Some(push) = &self.what.push {
            let change = self.push.advance(&push.moment(), executor, time);
            if matches!(change, Change::Begins | Change::Lasts) {
                robot.pull(push.on.object(), Vector3::from(push.force));
            }
            if change == Change::Begins {
                let force = Vector3::from(push.force).norm();
                began = Some(format!("push of {force:.1} N on the {} at {time:.2} s", name(push.on)));
            }
        }
        if let Some(slip) = &self.what.slip {
            let change = self.slip.advance(&slip.moment(), executor, time);
            let object = slip.object.index();
            match change {
                Change::Begins => robot.set_friction(object, slip.friction),
                Change::Ends => robot.set_friction(object, 1.0),
                Change::Lasts | Change::Nothing => {}
            }
            if matches!(change, Change::Begins | Change::Lasts) {
                robot.pull(Some(object), Vector3::from(slip.force));
            }
            if change == Change::Begins {
                let which = name(if slip.object == Which::First { Target::First } else { Target::Second });
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
    pub fn see(&mut self, truth: &Truth) {
        for (touched, by) in self.touched.iter_mut().zip(&truth.touched_by) {
            *touched |= *by != 0;
        }
    }

    /// Returns `noise` of a look at object `index`, plus the position error of the scenario until the hand has touched
    /// the object.
    pub fn perceived_noise(&self, index: usize, noise: &ObjectNoise) -> ObjectNoise {
        match &self.what.wrong_position {
            Some(wrong) if wrong.object.index() == index && !self.touched[index] => {
                ObjectNoise { offset: noise.offset + Vector3::from(wrong.offset), ..*noise }
            }
            _ => *noise,
        }
    }

    /// Returns the noise of the first looks, with the same errors.
    pub fn first_percepts(&self, noise: &TrialNoise) -> TrialNoise {
        let objects = std::array::from_fn(|index| self.perceived_noise(index, &noise.objects[index]));
        TrialNoise { objects, ..*noise }
    }

    /// Returns a description of the disturbances so far.
    pub fn log(&self) -> String {
        self.log.join("; ")
    }
}

/// Returns the real objects: `models` scaled by these sizes.
pub fn resized(models: &[Arc<ObjectModel>], sizes: &[f64]) -> Result<Vec<Arc<ObjectModel>>> {
    let resize = |(model, size): (&Arc<ObjectModel>, &f64)| -> Result<Arc<ObjectModel>> {
        if *size == 1.0 { Ok(model.clone()) } else { Ok(Arc::new(model.scaled(*size)?)) }
    };
    models.iter().zip(sizes).map(resize).collect()
}
