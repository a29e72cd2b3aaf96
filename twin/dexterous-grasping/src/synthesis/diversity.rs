//! Diversity of a set of the F-TAC Hand's grasps: digits, thumb, opposition, and the dimensionality of the postures.
//!
//! *Opposition* (Iberall 1987; the GRASP taxonomy of Feix et al. 2016): one virtual finger, the thumb or the palm,
//! presses against another, the fingers. The direction in which it presses, in the palm frame, defines the kind: along
//! the palm towards or away from the fingertips is pad opposition, perpendicular to the palm is palm opposition, across
//! the palm is side opposition.

use std::collections::BTreeMap;

use hand_model::Digit;
use nalgebra::{DMatrix, Vector3};
use serde::Serialize;

use super::held::HeldGrasp;

/// Thumb opposition angle above which the thumb counts as abducted, facing the fingers, rad.
const ABDUCTION_ANGLE: f64 = 0.6;

/// Kinds of opposition, as [`opposition`] finds them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Opposition {
    /// Along the palm, between pads.
    Pad,
    /// Perpendicular to the palm.
    Palm,
    /// Across the palm.
    Side,
    /// Neither thumb nor palm touches: fingers against fingers.
    Fingers,
}

impl Opposition {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Pad, Self::Palm, Self::Side, Self::Fingers];

    /// Returns the name: `pad`, `palm`, `side` or `fingers`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pad => "pad",
            Self::Palm => "palm",
            Self::Side => "side",
            Self::Fingers => "fingers",
        }
    }
}

/// Returns the unit direction in which the thumb or the palm, whichever presses harder, presses on the object (palm
/// frame). `None` if neither is in contact.
pub fn pressing_direction(grasp: &HeldGrasp) -> Option<Vector3<f64>> {
    let sum = |of: &dyn Fn(Option<usize>) -> bool| -> Vector3<f64> {
        let own = grasp.contacts.iter().filter(|contact| of(contact.link));
        own.map(|contact| Vector3::from(contact.normal) * contact.force).sum()
    };
    let thumb = sum(&|link| link.is_some_and(|link| Digit::Thumb.ftac_joints().contains(&link)));
    let palm = sum(&|link| link.is_none());
    if thumb.norm() >= palm.norm() { thumb } else { palm }.try_normalize(1e-9)
}

/// Returns the kind of opposition of a grasp.
pub fn opposition(grasp: &HeldGrasp) -> Opposition {
    match pressing_direction(grasp).map(|direction| direction.iamax()) {
        Some(0) => Opposition::Side,
        Some(1) => Opposition::Pad,
        Some(_) => Opposition::Palm,
        None => Opposition::Fingers,
    }
}

/// Returns the initials of the digits in contact, `TIMRL` for all, with a leading `P` if the palm is in contact.
pub fn digit_set(grasp: &HeldGrasp) -> String {
    let letter = |digit: &Digit| digit.name().chars().next().map(|letter| letter.to_ascii_uppercase());
    grasp.palm().then_some('P').into_iter().chain(grasp.digits().iter().filter_map(letter)).collect()
}

/// Statistics of a set of grasps.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
pub struct Diversity {
    /// Number of grasps.
    pub grasps: usize,
    /// Share of the grasps in which each digit is in contact, thumb first.
    pub digits: [f64; 5],
    /// Share of the grasps with palm contact.
    pub palm: f64,
    /// Number of grasps with each set of digits; see [`digit_set`].
    pub sets: BTreeMap<String, usize>,
    /// Number of grasps of each kind of opposition.
    pub opposition: BTreeMap<&'static str, usize>,
    /// Thumb opposition angle: mean and standard deviation, rad; share of abducted thumbs.
    pub thumb: [f64; 3],
    /// Cumulative share of the joint angles' variance explained by the principal components.
    pub explained: Vec<f64>,
    /// 1 - |mean of the approach directions| (object frame): 0 from one side, near 1 from all sides.
    pub approach_spread: f64,
    /// Median clearance of the free digits from the object, over the grasps that leave a digit free, m.
    pub room: Option<f64>,
}

impl Diversity {
    /// Returns the share of the grasps of this kind of opposition.
    pub fn opposition_share(&self, kind: Opposition) -> f64 {
        self.opposition.get(kind.name()).copied().unwrap_or(0) as f64 / self.grasps.max(1) as f64
    }
}

/// Computes the statistics of `grasps`.
pub fn describe<'a>(grasps: impl IntoIterator<Item = &'a HeldGrasp>) -> Diversity {
    let grasps: Vec<&HeldGrasp> = grasps.into_iter().collect();
    let n = grasps.len().max(1) as f64;
    let share = |of: &dyn Fn(&HeldGrasp) -> bool| grasps.iter().filter(|grasp| of(grasp)).count() as f64 / n;
    let (mut sets, mut kinds) = (BTreeMap::new(), BTreeMap::new());
    for grasp in &grasps {
        *sets.entry(digit_set(grasp)).or_default() += 1;
        *kinds.entry(opposition(grasp).name()).or_default() += 1;
    }
    let mean = grasps.iter().filter_map(|grasp| grasp.opposition).sum::<f64>() / n;
    let variance = grasps.iter().filter_map(|grasp| Some((grasp.opposition? - mean).powi(2))).sum::<f64>() / n;
    let used = || grasps.iter().filter_map(|grasp| grasp.digit_use.as_ref());
    let approach = used().map(|used| Vector3::from(used.approach)).sum::<Vector3<f64>>() / n;
    let mut rooms: Vec<f64> = used().filter_map(|used| used.room).collect();
    rooms.sort_by(f64::total_cmp);
    Diversity {
        grasps: grasps.len(),
        digits: Digit::ALL.map(|digit| share(&|grasp| grasp.digits().contains(&digit))),
        palm: share(&|grasp| grasp.palm()),
        sets,
        opposition: kinds,
        thumb: [mean, variance.sqrt(), share(&|grasp| grasp.opposition > Some(ABDUCTION_ANGLE))],
        explained: explained_variance(&grasps),
        approach_spread: 1.0 - approach.norm(),
        room: rooms.get(rooms.len() / 2).copied(),
    }
}

/// Returns the cumulative shares of the joint angles' variance, largest component first. Empty without variance.
fn explained_variance(grasps: &[&HeldGrasp]) -> Vec<f64> {
    let Some(first) = grasps.first() else { return Vec::new() };
    let joints = first.joints.len();
    let table = DMatrix::from_fn(grasps.len(), joints, |row, joint| grasps[row].joints[joint]);
    let mean = table.row_mean();
    let centered = DMatrix::from_fn(grasps.len(), joints, |row, joint| table[(row, joint)] - mean[joint]);
    let mut values: Vec<f64> =
        (centered.transpose() * &centered).symmetric_eigenvalues().iter().map(|value| value.max(0.0)).collect();
    values.sort_by(|a, b| b.total_cmp(a));
    let total: f64 = values.iter().sum();
    if total < 1e-12 {
        return Vec::new();
    }
    values
        .iter()
        .scan(0.0, |sum, value| {
            *sum += value / total;
            Some(*sum)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::held::tests::{grasp, used};
    use super::super::held::{DigitUse, HeldContact};
    use super::*;

    fn pressed(link: Option<usize>, normal: [f64; 3], force: f64) -> HeldContact {
        HeldContact { link, point: [0.0; 3], normal, force }
    }

    #[test]
    fn opposition_follows_the_harder_of_thumb_and_palm() {
        let finger = pressed(Some(4), [0.0, 0.0, 1.0], 9.0);
        let thumb = pressed(Some(2), [0.1, 0.9, 0.2], 3.0);
        let palm = pressed(None, [0.0, 0.0, -1.0], 5.0);
        let of = |contacts: Vec<HeldContact>| opposition(&HeldGrasp { contacts, ..grasp() });
        assert_eq!(of(vec![finger, thumb]), Opposition::Pad);
        assert_eq!(of(vec![finger, thumb, palm]), Opposition::Palm);
        assert_eq!(of(vec![finger, pressed(Some(1), [1.0, 0.0, 0.0], 1.0)]), Opposition::Side);
        assert_eq!(of(vec![finger]), Opposition::Fingers);
    }

    /// Postures on a line: the first component explains all. Two lines of 4 to 1 in variance: 80 %.
    #[test]
    fn variance_of_known_postures() {
        let bent = |joint: usize, angle: f64| {
            let mut grasp = grasp();
            grasp.joints[joint] += angle;
            grasp
        };
        let line: Vec<HeldGrasp> = [-0.2, 0.0, 0.1, 0.4].iter().map(|angle| bent(3, *angle)).collect();
        assert!((describe(&line).explained[0] - 1.0).abs() < 1e-9);
        let cross = [bent(3, -0.2), bent(3, 0.2), bent(7, -0.1), bent(7, 0.1)];
        let explained = describe(&cross).explained;
        assert!((explained[0] - 0.8).abs() < 1e-9 && (explained[1] - 1.0).abs() < 1e-9, "{explained:?}");
        assert!(describe(&[grasp(), grasp()]).explained.is_empty(), "no variance, no shares");
    }

    #[test]
    fn shares_and_sets() {
        let by = DigitUse { approach: [0.0, 0.0, 1.0], palm: true, room: None, ..used(&[Digit::Thumb]) };
        let contacts = vec![pressed(None, [0.0, 0.0, 1.0], 1.0)];
        let away = HeldGrasp { digit_use: Some(by), opposition: Some(0.2), contacts, ..grasp() };
        let both = describe(&[grasp(), away]);
        assert_eq!(both.sets, BTreeMap::from([("PT".to_owned(), 1), ("T".to_owned(), 1)]));
        assert_eq!((both.digits[0], both.digits[1], both.palm), (1.0, 0.0, 0.5));
        assert_eq!((both.thumb[2], both.approach_spread, both.room), (0.5, 1.0, Some(0.012)));
    }
}
