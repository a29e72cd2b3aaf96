//! A watcher that sends a trial to Rerun.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Result;
use control::executive::Phase;
use hand_model::robot::TactileImage;
use hand_model::{ACTUATORS, ARM_JOINTS};
use nalgebra::Isometry3;
use scenarios::objects::ObjectModel;
use scenarios::record::{Condition, TrialRecord};
use stream::recorder::{Recorder, Settings, Target};
use stream::{DrawnObject, Level, PoseError, SignalFrame, TrialProperties};

use crate::body::Task;
use crate::trial::{Bench, Moment, Watcher};

/// Records the part that all conditions share and the branch of one condition.
pub struct Recording {
    recorder: Option<Recorder>,
    names: [String; 2],
    objects: [Arc<ObjectModel>; 2],
    condition: Condition,
    branch: Option<Condition>,
    phase: Option<Phase>,
    told: bool,
    shown: BTreeMap<usize, Arc<TactileImage>>,
}

impl Recording {
    /// Opens the targets for a trial and the branch of its condition.
    pub fn open(targets: &[Target], bench: &Bench, task: &Task) -> Result<Self> {
        let Task { combination, trial, condition, .. } = *task;
        let plan = &bench.plans.plans[combination];
        let objects = [bench.world.object(&plan.first)?, bench.world.object(&plan.second)?];
        let names = ["first", "second"].map(str::to_owned);
        let drawn: Vec<DrawnObject> = objects
            .iter()
            .zip(&names)
            .map(|(object, name)| {
                let (vertices, triangles, _) = object.shape.triangles();
                DrawnObject::from_mesh(name.clone(), &vertices, &triangles, object.color)
            })
            .collect();
        let settings = Settings {
            eye: stream::blueprint::Eye { position: [1.04, -0.36, 0.20], target: [0.60, 0.0, 0.12] },
            ..Settings::default()
        };
        let mut recorder = Recorder::open(targets, settings, &bench.world.hand, &bench.world.arm, &drawn)?;
        recorder.log_properties(&TrialProperties {
            combination: format!("{combination}: {} then {}", plan.first, plan.second),
            trial: trial as u64,
            condition: condition.name().to_owned(),
            robot: task.robot.clone(),
            seed: bench.seed,
        })?;
        Ok(Self {
            recorder: Some(recorder),
            names,
            objects,
            condition,
            branch: None,
            phase: None,
            told: false,
            shown: BTreeMap::new(),
        })
    }

    /// Flushes what is left.
    pub fn finish(mut self) -> Result<()> {
        if let Some(recorder) = self.recorder.take() {
            recorder.finish()?;
        }
        Ok(())
    }
}

impl Watcher for Recording {
    fn active(&self) -> bool {
        true
    }

    fn branch(&mut self, condition: Condition) -> Result<()> {
        self.branch = Some(condition);
        Ok(())
    }

    fn see(&mut self, moment: &Moment) -> Result<()> {
        if moment.condition.is_some_and(|condition| condition != self.condition) {
            return Ok(());
        }
        let Some(recorder) = self.recorder.as_mut() else { return Ok(()) };
        let truth = moment.truth;
        recorder.set_time(truth.time);
        let (arm, hand) = truth.links.split_at(ARM_JOINTS);
        let inverse = truth.palm.inverse();
        let hand: Vec<Isometry3<f64>> = hand.iter().map(|link| inverse * link).collect();
        recorder.log_robot(arm, &truth.palm, &hand)?;
        for (name, pose) in self.names.iter().zip(&truth.objects) {
            recorder.log_object(name, pose)?;
        }
        let phase = moment.executive.phase();
        if self.phase != Some(phase) {
            self.phase = Some(phase);
            recorder.log_phase(phase.name())?;
        }
        let points: Vec<_> = truth.contacts.iter().map(|contact| contact.point).collect();
        let forces: Vec<_> = truth.contacts.iter().map(|contact| contact.force).collect();
        recorder.log_contacts(&points, &forces)?;
        let servos = moment.executive.servos();
        let mut errors = vec![None, None];
        if let Some(felt) = moment.felt {
            let estimate = felt.estimate.palm_from_object;
            recorder.log_estimate(&self.names[0], Some(&(truth.palm * estimate)))?;
            let real = inverse * truth.objects[0];
            errors[0] = Some(PoseError {
                mm: (real.translation.vector - estimate.translation.vector).norm() * 1e3,
                deg: self.objects[0].symmetry.angle(&real.rotation, &estimate.rotation).to_degrees(),
            });
            if !self.told {
                self.told = true;
                for map in felt.touches.iter().flat_map(|touch| &touch.heights) {
                    recorder.log_height(map.camera, &map.height, 240, 240)?;
                }
            }
        }
        if let Some(note) = moment.note {
            recorder.log_text(Level::Info, note)?;
        }
        for frame in moment.executive.newest_images() {
            // An image stays the newest one for many ticks.
            let known = self.shown.insert(frame.camera, frame.image.clone());
            if known.is_none_or(|known| !Arc::ptr_eq(&known, &frame.image)) {
                recorder.log_tactile(frame.camera, &frame.image)?;
            }
        }
        recorder.log_scalars(&SignalFrame {
            tensions: Some(truth.tensions),
            currents: Some(std::array::from_fn::<f64, ACTUATORS, _>(|n| servos[n].current)),
            joint_angles: truth.hand.clone().try_into().ok(),
            arm_angles: Some(*moment.executive.posture()),
            pad_forces: truth.pad_forces.clone().try_into().ok(),
            pose_errors: errors,
        })?;
        Ok(())
    }

    fn outcome(&mut self, record: &TrialRecord) -> Result<()> {
        if record.condition != self.condition {
            return Ok(());
        }
        let Some(recorder) = self.recorder.as_mut() else { return Ok(()) };
        let text = format!(
            "{}: {}{}",
            record.condition,
            if record.success { "both objects held" } else { "failed" },
            record.cause.map_or_else(String::new, |cause| format!(" ({cause:?})")),
        );
        recorder.log_outcome(&format!("{text}{}", if record.collision { ", collision" } else { "" }))?;
        Ok(())
    }
}
