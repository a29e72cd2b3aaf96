//! A real sensor as a user brings it: calibrated from presses of a ball, then used. The sensor here is a known one, whose images are
//! rendered from a calibration file written by hand, so that the truth is known.

mod calibration;
mod made_sensor;
mod reconstruction;
mod rendering;
