//! The twin of a mirror beside the robot, the residuals between them, and the diagnoses.

use anyhow::Result;
use telemetry::Level;
use telemetry::recorder::TwinFrame;

use super::Recording;
use fault_detection::Mirror;

impl Recording {
    /// Logs the twin at the moment that was seen last, and its diagnoses at that moment, in words.
    pub fn log_mirror(&mut self, mirror: &Mirror, named: &[String]) -> Result<()> {
        let Some(recorder) = self.recorder.as_mut().filter(|_| self.shows) else { return Ok(()) };
        let [arm, hand] = &mirror.twin().links();
        let residuals = mirror.residuals();
        let object = mirror.object().map(|(belief, pose)| {
            let turn = belief.palm_from_object.rotation.to_rotation_matrix().into_inner();
            let place = turn.transpose() * belief.covariance.fixed_view::<3, 3>(0, 0) * turn;
            (self.names[usize::from(self.reversed)].as_str(), pose, place)
        });
        recorder.log_twin(&TwinFrame {
            arm,
            palm: mirror.twin().palm(),
            hand,
            loads: residuals.cables.iter().map(|cable| cable.tension - cable.free).collect(),
            force: residuals.force.into(),
            object,
        })?;
        named.iter().try_for_each(|text| Ok(recorder.log_text(Level::Warn, text)?))
    }
}
