//! An attempt at an object, as announced by the controller.

/// Object, grasp and predictions of an attempt.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Attempt {
    /// Index of the object to be picked.
    pub object: usize,
    /// Identification number of the grasp.
    pub grasp: u32,
    /// Reason for this grasp.
    pub why: String,
    /// Predicted clearance between the held objects and this object on the way to it, m.
    pub clearance: Option<f64>,
    /// Predicted probability of an unwanted contact.
    pub risk: Option<f64>,
    /// In-hand pose estimate of the first object, palm frame: position (m) and rotation vector (rad).
    pub felt: Option<[f64; 6]>,
    /// Covariance of `felt`, row by row.
    pub covariance: Option<[f64; 36]>,
}
