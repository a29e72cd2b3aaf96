//! A held grasp for tests.

use dexterous_grasping::synthesis::held::{ClosedPose, DigitUse, HeldContact, HeldGrasp};

/// Builds a grasp with the given contacts (link, normal in the palm frame, force) at joint angles of `bend`.
pub(crate) fn grasp(bend: f64, contacts: &[(Option<usize>, [f64; 3], f64)]) -> HeldGrasp {
    HeldGrasp {
        object: "thing".into(),
        chain: 0,
        closed: ClosedPose::PalmFromObject([0.0, 0.0, -0.04, 0.0, 0.0, 0.0, 1.0]),
        joints: [bend; 15].into_iter().collect(),
        start: [0.0, 0.0, -0.04, 0.0, 0.0, 0.0, 1.0],
        open_joints: [0.0; 15].into_iter().collect(),
        open_tensions: None,
        tensions: [0.0; 5].into_iter().collect(),
        opposition: Some(bend),
        contacts: contacts
            .iter()
            .map(|&(link, normal, force)| HeldContact { link, point: [0.0; 3], normal, force })
            .collect(),
        digit_use: Some(DigitUse {
            digits: Vec::new(),
            palm: contacts.iter().any(|(link, _, _)| link.is_none()),
            approach: [0.0, 0.0, -1.0],
            room: None,
        }),
        margin: 1.0,
        penetration: 0.0,
        held_without_tension: None,
        moved: Some([0.0; 2]),
        energy: Some(0.0),
        verified_load: None,
    }
}
