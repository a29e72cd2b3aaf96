//! Ground truth of a press of a ball from its size and circle alone: the reference for training and testing photometric
//! stereo.

use std::sync::Arc;

use hand_model::pads::IMAGE_SIZE as N;
use hand_model::robot::TactileImage;
use tactile_optics::calibration::{BallPress, CalibratedSensor, PressFolder};
use tactile_perception::CalibrationPress;

use crate::grid::PadGrid;

/// Spherical cap of a ball that lies in the gel.
#[derive(Debug, Clone, Copy)]
pub struct KnownBall {
    /// Centre of the ball in the photo: column and row.
    pub center: [f64; 2],
    /// Radius of the ball, m.
    pub radius: f64,
    /// Radius of the contact, m.
    pub contact: f64,
}

impl KnownBall {
    /// Computes the cap of a press. The contact radius is the label's if it gives one. If only the visible circle is
    /// known, the radius follows from the depth that the sensor's fit assigns to such a circle.
    pub fn from_press(press: &BallPress, sensor: &CalibratedSensor) -> Self {
        let radius = 0.5 * press.diameter;
        let contact = if press.contact_labelled {
            press.radius * 1e-3 * sensor.calibration().pixel_mm
        } else {
            let rim = radius - sensor.ball_depth(press.radius, press.diameter).0.min(radius);
            (radius * radius - rim * rim).sqrt()
        };
        Self { center: press.center, radius, contact: contact.min(0.999 * radius) }
    }

    /// Computes the indentation at each pixel of the pads' grid, m, over a photo with pixels of size `pixel` (m).
    pub fn on_grid(&self, grid: PadGrid, pixel: f64) -> Vec<f32> {
        (0..N * N).map(|i| self.at(self.offset(grid, pixel, i)).map_or(0.0, |(depth, _)| depth as f32)).collect()
    }

    /// Returns the offset (m; x right, y up) of a grid pixel from the centre.
    pub fn offset(&self, grid: PadGrid, pixel: f64, i: usize) -> [f64; 2] {
        let (column, row) = grid.center(i);
        [(column - self.center[0]) * pixel, (self.center[1] - row) * pixel]
    }

    fn rim(&self) -> f64 {
        (self.radius * self.radius - self.contact * self.contact).sqrt()
    }

    /// Returns indentation (m) and its slopes (dh/dx, dh/dy) at an offset (m) from the centre; `None` outside the
    /// contact.
    pub fn at(&self, [x, y]: [f64; 2]) -> Option<(f64, [f64; 2])> {
        let square = x * x + y * y;
        let down = (self.radius * self.radius - square).max(0.0).sqrt();
        (square < self.contact * self.contact).then(|| (down - self.rim(), [-x / down, -y / down]))
    }
}

/// Presses of a folder on the pads' grid. The gel lies on the ball inside the contact and is level outside.
pub struct KnownPresses {
    pub presses: Vec<CalibrationPress>,
    pub balls: Vec<KnownBall>,
}

impl KnownPresses {
    pub fn new(folder: &PressFolder, sensor: &CalibratedSensor, background: &Arc<TactileImage>) -> Self {
        let (width, height) = sensor.size();
        let grid = PadGrid { width, height };
        let balls: Vec<KnownBall> = folder.presses.iter().map(|press| KnownBall::from_press(press, sensor)).collect();
        let pixel = 1e-3 * sensor.calibration().pixel_mm;
        let presses = folder.presses.iter().zip(&balls).map(|(press, ball)| CalibrationPress {
            camera: 0,
            image: grid.image(&press.photo.rgb),
            background: background.clone(),
            indentation: ball.on_grid(grid, pixel),
        });
        Self { presses: presses.collect(), balls }
    }
}
