//! An attempt at an object, as the controller announces it.

/// Object, grasp and what is expected of it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Attempt {
    /// The object that is to be taken: 0 or 1.
    pub object: usize,
    /// Number of the grasp.
    pub grasp: u32,
    /// Why this grasp.
    pub why: String,
    /// Predicted distance between what the hand holds and the object on the way to it, m.
    pub clearance: Option<f64>,
    /// Predicted probability of an unwanted contact.
    pub risk: Option<f64>,
    /// The first object as felt: position (m) and rotation vector (rad) in the palm's frame.
    pub felt: Option<[f64; 6]>,
    /// Covariance of that, rows one after the other.
    pub covariance: Option<[f64; 36]>,
}
