//! A user's real sensor: calibrated from presses of a ball, then used. The sensor here is a known one, with images
//! rendered from a calibration file written by hand, so that the truth is known.

mod calibration;
mod reconstruction;
mod rendering;
mod synthetic_sensor;
