//! The reference model beside the robot, the residuals between them, and the detected faults.

use anyhow::Result;
use telemetry::LogLevel;
use telemetry::recorder::ReferenceFrame;

use super::Recording;
use fault_detection::FaultDetector;

impl Recording {
    /// Logs the reference model at the last observed moment, and the faults detected at that moment, in words.
    pub fn log_fault_detector(&mut self, fault_detector: &FaultDetector, named: &[String]) -> Result<()> {
        if !self.is_shown {
            return Ok(());
        }
        let recorder = &mut self.recorder;
        let [arm, hand] = &fault_detector.reference_model().links();
        let residuals = fault_detector.residuals();
        let object = fault_detector.held_object().map(|(estimate, pose)| {
            let turn = estimate.palm_from_object.rotation.to_rotation_matrix().into_inner();
            let place = turn.transpose() * estimate.covariance.fixed_view::<3, 3>(0, 0) * turn;
            (self.names[usize::from(self.reversed)].as_str(), pose, place)
        });
        recorder.log_reference_model(&ReferenceFrame {
            arm,
            palm: fault_detector.reference_model().palm(),
            hand,
            loads: residuals.cables.iter().map(|cable| cable.tension - cable.reference_tension).collect(),
            force: residuals.force.into(),
            object,
        })?;
        named.iter().try_for_each(|text| Ok(recorder.log_text(LogLevel::Warn, text)?))
    }
}
