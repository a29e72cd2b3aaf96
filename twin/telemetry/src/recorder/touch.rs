//! Logging of the tactile pads: images, their changes, height maps.

use hand_model::robot::TactileImage;
use rerun::Clear;

use super::Recorder;
use crate::error::TelemetryError;
use crate::{entities, scene, tactile};

impl Recorder {
    /// Logs the image of a camera. An image like the last one is not logged again.
    pub fn log_tactile(&mut self, camera: usize, image: &TactileImage) -> Result<(), TelemetryError> {
        let name = self.camera_name(camera)?;
        if self.last_image[camera].as_ref().is_some_and(|last| !tactile::differ(last, image))
            || !self.images.due(camera, self.time)
        {
            return Ok(());
        }
        let bytes = tactile::encode(image, self.settings.image_side, self.settings.jpeg_quality)
            .map_err(|reason| TelemetryError::Image { what: name.clone(), reason })?;
        self.last_image[camera] = Some(image.clone());
        self.rec.log(entities::tactile(&name), &tactile::archetype(bytes))?;
        self.log_change(camera, image)
    }

    /// Logs the change from the untouched image: as colours on the hand, in the map of changes, and by the drawn size
    /// of its pad.
    fn log_change(&mut self, camera: usize, image: &TactileImage) -> Result<(), TelemetryError> {
        let name = self.camera_name(camera)?;
        if self.changes.update(camera, image) {
            let changes = &self.changes;
            tactile::log_cells(&self.rec, &self.robot.hand, self.sides(), |camera| changes.active(camera))?;
            if !self.changes.active(camera) {
                self.rec.log(entities::change(&name), &Clear::flat())?;
            }
        }
        self.log_pad(self.robot.hand.cameras[camera].pad)?;
        if !self.changes.active(camera) {
            return Ok(());
        }
        let difference = self.changes.difference(camera, image);
        let bytes = tactile::encode(&difference, self.settings.change_side, self.settings.jpeg_quality)
            .map_err(|reason| TelemetryError::Image { what: name.clone(), reason })?;
        Ok(self.rec.log(entities::change(&name), &tactile::archetype(bytes))?)
    }

    /// Logs all pads in their untouched state.
    pub(super) fn log_pads(&mut self) -> Result<(), TelemetryError> {
        (0..self.robot.hand.pads.len()).try_for_each(|pad| self.log_pad(pad))?;
        tactile::log_cells(&self.rec, &self.robot.hand, self.sides(), |_| false)
    }

    /// Returns the sides of tactile images and of their differences, pixels.
    fn sides(&self) -> (usize, usize) {
        (self.settings.image_side, self.settings.change_side)
    }

    fn log_pad(&mut self, index: usize) -> Result<(), TelemetryError> {
        let pad = &self.robot.hand.pads[index];
        let link = pad.link.map(|link| self.robot.hand.tree.joints[link].name.as_str());
        let colors = self.changes.colors(&self.robot.hand, pad);
        Ok(self.rec.log(entities::pad(link, &pad.name), &scene::pad_colors(colors))?)
    }

    /// Removes all height maps, because their content is gone.
    pub fn clear_heights(&mut self) -> Result<(), TelemetryError> {
        for camera in 0..self.last_height.len() {
            if let Some((_, idle)) = &mut self.last_height[camera]
                && !std::mem::replace(idle, true)
            {
                self.rec.log(entities::height(&self.robot.hand.cameras[camera].name), &Clear::flat())?;
            }
        }
        Ok(())
    }

    /// Logs the height map (m, row-major, `w` by `h`, row 0 distal) of a camera. An idle one is logged once.
    pub fn log_height(&mut self, camera: usize, heights: &[f32], w: usize, h: usize) -> Result<(), TelemetryError> {
        let name = self.camera_name(camera)?;
        let idle = heights.iter().all(|height| height.abs() < self.settings.height_idle);
        let last = self.last_height[camera];
        if last == Some(([w, h], true)) && idle || !self.heights.due(camera, self.time) {
            return Ok(());
        }
        let range = self.settings.height_range;
        let (bytes, place) =
            tactile::height_image(&self.robot.hand, camera, heights, [w, h], range, self.settings.jpeg_quality)
                .map_err(|reason| TelemetryError::Image { what: name.clone(), reason })?;
        let path = entities::height(&name);
        if last.is_none_or(|(size, _)| size != [w, h]) {
            self.rec.log_static(path.as_str(), &place)?;
        }
        self.last_height[camera] = Some(([w, h], idle));
        Ok(self.rec.log(path, &tactile::archetype(bytes))?)
    }
}
