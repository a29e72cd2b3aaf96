//! All entity paths of a recording.
//!
//! `world/...` is shown in the 3D views. `tactile/...`, `changes/...` and `heights/...` are maps laid out as the hand.
//! `signals/...` is plotted, `trial/...` is text. The name of an object or pad becomes one part of a path.

use hand_model::Hand;

/// Root of the 3D view, the `world` frame.
pub const WORLD: &str = "world";
pub const TABLE: &str = "world/table";
/// The arm's base.
pub const ARM_BASE: &str = "world/arm/base";
/// The palm; the hand's links are below it, in the palm frame.
pub const HAND: &str = "world/hand";
/// Frame that the hand view follows: it moves with the palm and turns with it about the vertical.
pub const FOLLOW: &str = "world/follow";
/// The cables, palm frame.
pub const CABLES: &str = "world/hand/cables";
/// Trajectories: the rejected one, and that of the chosen action.
pub const REJECTED_PATH: &str = "world/paths/rejected";
pub const CHOSEN_PATH: &str = "world/paths/chosen";
/// Closest approach of the rejected trajectory to the target.
pub const CLOSEST_APPROACH: &str = "world/paths/nearest";
/// Root of the reference model: the links of its arm, and its palm with the hand's links below that.
pub const REFERENCE_MODEL: &str = "world/reference_model";
pub const REFERENCE_HAND: &str = "world/reference_model/hand";
/// Contact forces.
pub const CONTACTS: &str = "world/contacts";
/// Root of the tactile images.
pub const TACTILE: &str = "tactile";
/// Root of the height maps.
pub const HEIGHTS: &str = "heights";
/// Root of the differences from untouched images.
pub const CHANGES: &str = "changes";
/// Root of the plotted signals.
pub const SIGNALS: &str = "signals";
/// Cable tensions, N.
pub const TENSIONS: &str = "signals/tension";
/// Servo currents, A.
pub const CURRENTS: &str = "signals/current";
/// Finger joint angles, degrees.
pub const JOINT_ANGLES: &str = "signals/joint_angle";
/// Arm joint angles, degrees.
pub const ARM_ANGLES: &str = "signals/arm_angle";
/// Force on each pad, N.
pub const PAD_FORCES: &str = "signals/pad_force";
/// Errors of the estimated object poses, mm.
pub const POSE_ERROR_MM: &str = "signals/pose_error_mm";
/// Errors of the estimated object poses, degrees.
pub const POSE_ERROR_DEG: &str = "signals/pose_error_deg";
/// Residual cable load, robot minus reference model, N.
pub const RESIDUAL_LOADS: &str = "signals/residual_load";
/// Residual force on the hand, robot minus reference model, N.
pub const RESIDUAL_FORCE: &str = "signals/residual_force";
/// Phase of the trial, a state.
pub const PHASE: &str = "trial/phase";
/// Log of events, as text.
pub const LOG: &str = "trial/log";
/// Current state, as a page of text.
pub const STATE_PAGE: &str = "trial/now";
/// The outcome of the trial.
pub const OUTCOME: &str = "trial/outcome";

/// Root of a gallery of grasps.
pub const GALLERY: &str = "grasps";
/// Text of a gallery.
pub const GALLERY_TEXT: &str = "grasps_text";

/// Sheet of images beside a held object.
pub const IMAGE_SHEET: &str = "image_sheet";

/// Path of grasp number `n` (from 0) of a gallery.
pub fn gallery(n: usize, name: &str) -> String {
    format!("{GALLERY}/{:02}_{}", n + 1, path_part(name))
}

/// Path of link `k` (0..7) of the arm.
pub fn arm_link(k: usize) -> String {
    format!("world/arm/link_{}", k + 1)
}

/// Path of a link of the hand.
pub fn hand_link(name: &str) -> String {
    format!("{HAND}/{}", path_part(name))
}

/// Path of a link of the reference model's arm.
pub fn reference_arm_link(k: usize) -> String {
    format!("{REFERENCE_MODEL}/arm_link_{}", k + 1)
}

/// Path of a link of the reference model's hand.
pub fn reference_hand_link(name: &str) -> String {
    format!("{REFERENCE_HAND}/{}", path_part(name))
}

/// Path of the object estimated to be in the reference model's hand.
pub fn reference_object(name: &str) -> String {
    format!("{REFERENCE_MODEL}/objects/{}", path_part(name))
}

/// Path of a pad, below the link that carries it (`None`: the palm).
pub fn pad(link: Option<&str>, name: &str) -> String {
    match link {
        Some(link) => format!("{}/pad_{}", hand_link(link), path_part(name)),
        None => format!("{HAND}/pad_{}", path_part(name)),
    }
}

/// Path of an object at its true pose.
pub fn object(name: &str) -> String {
    format!("world/objects/{}", path_part(name))
}

/// Path of an object at its pose estimate.
pub fn estimate(name: &str) -> String {
    format!("world/estimate/{}", path_part(name))
}

/// Path of the covariance of an estimate, below the estimate's.
pub fn covariance(name: &str) -> String {
    format!("{}/covariance", estimate(name))
}

/// Path of the difference between a camera's image and the untouched one.
pub fn change(camera: &str) -> String {
    format!("{CHANGES}/{}", path_part(camera))
}

/// Path of a camera's image.
pub fn tactile(camera: &str) -> String {
    format!("{TACTILE}/{}", path_part(camera))
}

/// Path of a camera's height map.
pub fn height(camera: &str) -> String {
    format!("{HEIGHTS}/{}", path_part(camera))
}

/// Lists every path that a recording of `hand`, an arm of `arm_links` links and these objects can have.
pub fn all_paths(hand: &Hand, arm_links: usize, objects: &[&str]) -> Vec<String> {
    let fixed = [
        WORLD,
        TABLE,
        ARM_BASE,
        HAND,
        FOLLOW,
        CABLES,
        REJECTED_PATH,
        CLOSEST_APPROACH,
        CHOSEN_PATH,
        REFERENCE_MODEL,
        REFERENCE_HAND,
        CONTACTS,
        TACTILE,
        HEIGHTS,
        CHANGES,
        SIGNALS,
        TENSIONS,
        CURRENTS,
        JOINT_ANGLES,
        ARM_ANGLES,
        PAD_FORCES,
        POSE_ERROR_MM,
        POSE_ERROR_DEG,
        RESIDUAL_LOADS,
        RESIDUAL_FORCE,
        PHASE,
        LOG,
        STATE_PAGE,
        OUTCOME,
    ];
    let mut paths: Vec<String> = fixed.iter().map(ToString::to_string).collect();
    paths.extend((0..arm_links).map(arm_link));
    paths.extend((0..arm_links).map(reference_arm_link));
    paths.extend(hand.tree.joints.iter().flat_map(|joint| [hand_link(&joint.name), reference_hand_link(&joint.name)]));
    paths.extend(hand.pads.iter().map(|p| pad(p.link.map(|link| hand.tree.joints[link].name.as_str()), &p.name)));
    paths.extend(
        hand.cameras.iter().flat_map(|camera| [tactile(&camera.name), height(&camera.name), change(&camera.name)]),
    );
    paths.extend(
        objects.iter().flat_map(|name| [object(name), estimate(name), covariance(name), reference_object(name)]),
    );
    paths
}

/// Turns a name into one part of a path: every character but letters, digits, `-`, `_` and `.` becomes `_`.
fn path_part(name: &str) -> String {
    let keep = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.');
    name.chars().map(|c| if keep(c) { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_unique_and_valid() {
        let paths = all_paths(&Hand::ftac(), 7, &["ball", "water bottle", "cup/1"]);
        let mut sorted = paths.clone();
        sorted.sort();
        sorted.dedup();
        assert_eq!(sorted.len(), paths.len());
        assert_eq!(paths.len(), 29 + 2 * 7 + 2 * 15 + 17 + 3 * 18 + 4 * 3);
        for path in &paths {
            assert_eq!(rerun::EntityPath::parse_strict(path).expect("strict path").to_string(), format!("/{path}"));
        }
    }
}
