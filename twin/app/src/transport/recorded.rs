//! A transport in Rerun: robot, balls, contacts, tactile images, and what was decided, in words.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use control::carrier::{Carrier, Stage};
use hand_model::robot::TactileImage;
use hand_model::{ACTUATORS, ARM_JOINTS};
use nalgebra::Isometry3;
use sim::robot::Truth;
use stream::recorder::{Recorder, Settings, Target};
use stream::{DrawnObject, Level, SignalFrame, TrialProperties};

use super::play::{Policy, Site, TransportRecord, Witness};

/// Records one transport.
pub struct Recorded {
    recorder: Recorder,
    names: Vec<String>,
    stage: Option<Stage>,
    shown: BTreeMap<usize, Arc<TactileImage>>,
}

impl Recorded {
    /// Opens `file` for transport `trial` under `policy`.
    pub fn open(file: &Path, site: &Site, trial: usize, policy: Policy) -> Result<Self> {
        let drawn: Vec<DrawnObject> = site
            .transport
            .ball
            .iter()
            .map(|ball| {
                let model = ball.model();
                let (vertices, triangles, _) = model.shape.triangles();
                DrawnObject::from_mesh(model.name, &vertices, &triangles, model.color)
            })
            .collect();
        let settings = Settings {
            eye: stream::blueprint::Eye { position: [1.04, -0.36, 0.20], target: [0.60, 0.0, 0.12] },
            ..Settings::default()
        };
        let targets = [Target::File(file.to_owned())];
        let mut recorder = Recorder::open(&targets, settings, &site.world.hand, &site.world.arm, &drawn)?;
        recorder.log_properties(&TrialProperties {
            combination: site.transport.name.clone(),
            trial: trial as u64,
            condition: policy.name().to_owned(),
            robot: "sim".to_owned(),
            seed: site.seed,
        })?;
        let names = site.transport.ball.iter().map(|ball| ball.name.clone()).collect();
        Ok(Self { recorder, names, stage: None, shown: BTreeMap::new() })
    }

    /// Writes the outcome and what is left.
    pub fn finish(mut self, record: &TransportRecord) -> Result<()> {
        let last = record.story.last().map_or("nothing was carried", String::as_str);
        self.recorder.log_outcome(&format!("{}: {:?} objects a trip; {last}", record.policy.name(), record.carried))?;
        self.recorder.finish()?;
        Ok(())
    }
}

impl Witness for Recorded {
    fn see(&mut self, truth: &Truth, carrier: &Carrier, note: Option<&str>) -> Result<()> {
        let recorder = &mut self.recorder;
        recorder.set_time(truth.time);
        let (arm, hand) = truth.links.split_at(ARM_JOINTS);
        let inverse = truth.palm.inverse();
        let hand: Vec<Isometry3<f64>> = hand.iter().map(|link| inverse * link).collect();
        recorder.log_robot(arm, &truth.palm, &hand)?;
        for (name, pose) in self.names.iter().zip(&truth.objects) {
            recorder.log_object(name, pose)?;
        }
        if self.stage != Some(carrier.stage()) {
            self.stage = Some(carrier.stage());
            recorder.log_phase(carrier.stage().name())?;
        }
        let points: Vec<_> = truth.contacts.iter().map(|contact| contact.point).collect();
        let forces: Vec<_> = truth.contacts.iter().map(|contact| contact.force).collect();
        recorder.log_contacts(&points, &forces)?;
        if let Some(note) = note {
            recorder.log_text(Level::Info, note)?;
        }
        for frame in carrier.newest_images() {
            let known = self.shown.insert(frame.camera, frame.image.clone());
            if known.is_none_or(|known| !Arc::ptr_eq(&known, &frame.image)) {
                recorder.log_tactile(frame.camera, &frame.image)?;
            }
        }
        let servos = carrier.servos();
        recorder.log_scalars(&SignalFrame {
            tensions: Some(truth.tensions),
            currents: Some(std::array::from_fn::<f64, ACTUATORS, _>(|n| servos[n].current)),
            joint_angles: truth.hand.clone().try_into().ok(),
            arm_angles: Some(*carrier.posture()),
            pad_forces: truth.pad_forces.clone().try_into().ok(),
            pose_errors: Vec::new(),
        })?;
        Ok(())
    }
}
