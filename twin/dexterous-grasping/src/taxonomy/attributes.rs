//! Attributes of a grasp for the rules: the taxonomy's own criteria, measured on the contacts, the joints and the
//! object's shape.
//!
//! Feix's cells are defined by opposition direction, virtual fingers and thumb position; the types within a cell differ
//! by contact areas and the object's shape. Shares are shares of contact force. In a link's frame x runs along the
//! phalanx, y out of its palmar face, z across; in the palm's frame x points to the thumb's side, y to the fingertips, -z
//! out of the palm.

use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Matrix3, Point3, SymmetricEigen, Vector3};

use crate::synthesis::held::{HeldContact, HeldGrasp, pose_from_array};

/// Least share of the contact force for a part of the hand to count as in contact.
const MIN_CONTACT_SHARE: f64 = 0.02;

/// Name and meaning of every attribute, in the order of [`Attributes`].
pub const ATTRIBUTES: [(&str, &str); 25] = [
    ("palm", "share of the contact force on the palm"),
    ("thumb", "share on the thumb"),
    ("index", "share on the index finger"),
    ("middle", "share on the middle finger"),
    ("ring", "share on the ring finger"),
    ("little", "share on the little finger"),
    ("fingers", "fingers that touch, of four"),
    ("tips", "share of the digits' force on their last phalanges"),
    ("roots", "share of the fingers' force on their first phalanges"),
    ("sides", "share of the fingers' force on their sides"),
    ("index_side", "share of the index finger's force on its side"),
    ("middle_side", "share of the middle finger's force on its side"),
    ("abduction", "thumb's opposition angle, rad"),
    ("curl", "mean angle of the touching fingers' two outer joints, rad"),
    ("index_straight", "how much straighter the index finger is than the other fingers, rad a joint"),
    ("to_palm", "part of the fingers' push that goes into the palm, 1 straight, -1 away"),
    ("to_wrist", "part of the fingers' push that goes towards the wrist"),
    ("across", "part of the fingers' push that goes across the hand, thumb side or little side"),
    ("opposed", "largest share of normals along one line: 1/3 from all sides, 1 two parallel faces"),
    ("rounded", "least share of normals along a line: 0 straight-sided, 1/3 round"),
    ("line_across", "cosine between the straight direction of what is touched and the line of the knuckles"),
    ("line_out", "cosine between that direction and the palm's normal"),
    ("ball", "object's least over largest distance of its surface from its centre: 1 is a ball"),
    ("axis_across", "cosine between the object's axis and the line of the knuckles"),
    ("axis_out", "cosine between the object's axis and the palm's normal"),
];

/// Shape of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObjectForm {
    /// The principal axis whose extent differs most from its neighbour's (a can's axis, the normal of a slab's large
    /// faces), a unit vector in the object's frame; `None` if all extents are similar.
    pub axis: Option<Vector3<f64>>,
    /// Extents along the principal axes, largest first, m.
    pub extents: [f64; 3],
    /// Ratio of the least to the largest distance of the surface from its centre.
    pub roundness: f64,
}

/// Number of points on an object's surface from which its form is measured.
pub const FORM_POINTS: usize = 1500;

/// Ratio of extents below which they count as similar.
const SIMILAR_EXTENT_RATIO: f64 = 1.08;

impl ObjectForm {
    /// Measures the form from points spread evenly over the surface (object frame, m).
    pub fn from_points(points: &[Point3<f64>]) -> Self {
        let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let mut second = Matrix3::zeros();
        let (mut near, mut far) = (f64::INFINITY, 0.0_f64);
        for p in points {
            let d = p.coords - mean;
            second += d * d.transpose();
            (near, far) = (near.min(d.norm()), far.max(d.norm()));
        }
        let eigen = SymmetricEigen::new(second);
        let mut found: Vec<(f64, Vector3<f64>)> = (0..3)
            .map(|n| {
                let axis: Vector3<f64> = eigen.eigenvectors.column(n).into();
                let along = points.iter().map(|p| p.coords.dot(&axis));
                let (low, high) =
                    along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
                (high - low, axis)
            })
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let extents = [found[0].0, found[1].0, found[2].0];
        let (long, flat) = (extents[0] / extents[1], extents[1] / extents[2]);
        let axis = (long.max(flat) > SIMILAR_EXTENT_RATIO).then(|| if long > flat { found[0].1 } else { found[2].1 });
        Self { axis, extents, roundness: if far > 0.0 { near / far } else { 0.0 } }
    }
}

/// A grasp in the state in which it holds an object.
#[derive(Debug, Clone, Copy)]
pub struct HoldingState<'a> {
    /// Pose of the object in the palm frame.
    pub palm_from_object: Isometry3<f64>,
    /// Joint angles, rad.
    pub joints: &'a [f64],
    /// Contacts, palm frame.
    pub contacts: &'a [HeldContact],
}

impl<'a> From<&'a HeldGrasp> for HoldingState<'a> {
    fn from(grasp: &'a HeldGrasp) -> Self {
        Self { palm_from_object: pose_from_array(&grasp.closed), joints: &grasp.joints, contacts: &grasp.contacts }
    }
}

/// The attributes of one grasp, in the order of [`ATTRIBUTES`].
#[derive(Debug, Clone, PartialEq)]
pub struct Attributes(pub [f64; ATTRIBUTES.len()]);

impl Attributes {
    /// Returns the index of the attribute called `name`.
    pub fn index(name: &str) -> Option<usize> {
        ATTRIBUTES.iter().position(|(known, _)| *known == name)
    }

    /// Returns the value of the attribute called `name`. `None` if there is none of this name.
    pub fn get(&self, name: &str) -> Option<f64> {
        Self::index(name).map(|n| self.0[n])
    }

    /// Measures the attributes of a grasp on an object of `form`. Without contact force all shares are 0. The hand has
    /// digits with names; the thresholds of the built-in rules were chosen for the F-TAC Hand, with three joints a
    /// digit.
    ///
    /// # Panics
    /// If `grasp` has fewer joints than `hand`.
    pub fn measure<'a>(hand: &Hand, form: &ObjectForm, grasp: impl Into<HoldingState<'a>>) -> Self {
        let grasp = grasp.into();
        let links = hand.tree.forward(grasp.joints);
        let total: f64 = grasp.contacts.iter().map(|contact| contact.force).sum();
        let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 0.0 };
        let (mut palm, mut digits, mut sides) = (0.0, [0.0; 5], [0.0; 5]);
        let (mut tips, mut roots) = (0.0, 0.0);
        let (mut push, mut spread) = (Vector3::zeros(), Matrix3::zeros());
        for contact in grasp.contacts {
            let normal = Vector3::from(contact.normal);
            spread += normal * normal.transpose() * contact.force;
            let (Some(link), Some(digit)) = (contact.link, hand.digit_of(contact.link)) else {
                palm += contact.force;
                continue;
            };
            let (chain, digit) = (hand.links(digit), digit.index());
            digits[digit] += contact.force;
            if chain.last() == Some(&link) {
                tips += contact.force;
            }
            if digit != Digit::Thumb.index() {
                push += normal * contact.force;
                if chain.first() == Some(&link) {
                    roots += contact.force;
                }
                let own = links[link].inverse_transform_vector(&normal);
                if own.z.abs() > own.y.abs().max(own.x.abs()) {
                    sides[digit] += contact.force;
                }
            }
        }
        let by_fingers: f64 = digits[1..].iter().sum();
        let touching: Vec<usize> = (1..5).filter(|digit| share(digits[*digit], total) >= MIN_CONTACT_SHARE).collect();
        let bend = |digit: usize| {
            let chain = Digit::ALL.get(digit).map_or(&[][..], |digit| hand.links(*digit));
            let outer = &chain[chain.len().saturating_sub(2)..];
            outer.iter().map(|joint| grasp.joints[*joint]).sum::<f64>() / outer.len().max(1) as f64
        };
        let mean = |of: &[usize]| of.iter().map(|digit| bend(*digit)).sum::<f64>() / of.len().max(1) as f64;
        let direction = push.try_normalize(1e-9).unwrap_or_default();
        let (opposed, rounded, line) = normals(&spread, total);
        // An object without an axis, such as a cube, takes the straight direction of the touched surface.
        let axis = form.axis.map_or(line, |axis| grasp.palm_from_object.rotation * axis);
        let others: Vec<usize> = touching.iter().copied().filter(|digit| *digit != 1).collect();
        Self([
            share(palm, total),
            share(digits[0], total),
            share(digits[1], total),
            share(digits[2], total),
            share(digits[3], total),
            share(digits[4], total),
            touching.len() as f64,
            share(tips, total - palm),
            share(roots, by_fingers),
            share(sides.iter().sum(), by_fingers),
            share(sides[1], digits[1]),
            share(sides[2], digits[2]),
            hand.transmission.opposition.map_or(0.0, |joint| grasp.joints[joint]),
            mean(&touching),
            if others.is_empty() { 0.0 } else { mean(&others) - bend(1) },
            direction.z,
            -direction.y,
            direction.x.abs(),
            opposed,
            rounded,
            line.x.abs(),
            line.z.abs(),
            form.roundness,
            axis.x.abs(),
            axis.z.abs(),
        ])
    }
}

/// Returns the largest and the least share of the normals along a line, and the line with the least share, along which
/// the touched surface is straight.
fn normals(spread: &Matrix3<f64>, total: f64) -> (f64, f64, Vector3<f64>) {
    if total <= 0.0 {
        return (0.0, 0.0, Vector3::zeros());
    }
    let eigen = SymmetricEigen::new(spread / total);
    let (least, most) = (eigen.eigenvalues.imin(), eigen.eigenvalues.imax());
    (eigen.eigenvalues[most], eigen.eigenvalues[least], eigen.eigenvectors.column(least).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::held::{self, ClosedPose};

    /// A grasp with the given contacts (link, normal in the palm frame, force) at joint angles of `bend`.
    fn grasp(bend: f64, contacts: &[(Option<usize>, [f64; 3], f64)]) -> HeldGrasp {
        HeldGrasp {
            closed: ClosedPose::PalmFromObject([0.0, 0.0, -0.04, 0.0, 0.0, 0.0, 1.0]),
            joints: [bend; 15].into_iter().collect(),
            contacts: contacts
                .iter()
                .map(|&(link, normal, force)| HeldContact { link, point: [0.0; 3], normal, force })
                .collect(),
            ..held::tests::grasp()
        }
    }

    fn rod() -> ObjectForm {
        ObjectForm { axis: Some(Vector3::x()), extents: [0.12, 0.03, 0.03], roundness: 0.25 }
    }

    /// A rotated box gives its principal axes and extents in order.
    #[test]
    fn form_of_a_box() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.7, 1.1);
        let (half, mut points) = ([0.05, 0.03, 0.01], Vec::new());
        for (i, j, k) in (0..11).flat_map(|i| (0..11).flat_map(move |j| (0..11).map(move |k| (i, j, k)))) {
            let at = |n: i32, half: f64| half * (f64::from(n) / 5.0 - 1.0);
            points.push(turn * Point3::new(at(i, half[1]), at(j, half[0]), at(k, half[2])));
        }
        let form = ObjectForm::from_points(&points);
        for (found, half) in form.extents.iter().zip(half) {
            assert!((found - 2.0 * half).abs() < 1e-9, "{form:?}");
        }
        // 30 to 10 mm differ more than 50 to 30 mm: the axis is across the slab.
        assert!((form.axis.expect("a slab has one").dot(&(turn * Vector3::z())).abs() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn shares() {
        let hand = Hand::ftac();
        let held = grasp(
            0.5,
            &[(None, [0.0, 0.0, -1.0], 6.0), (Some(5), [0.0, 0.0, 1.0], 3.0), (Some(9), [0.0, 0.0, 1.0], 1.0)],
        );
        let found = Attributes::measure(&hand, &rod(), &held);
        let get = |name| found.get(name).expect("known");
        assert!(
            (get("palm") - 0.6).abs() < 1e-12
                && (get("index") - 0.3).abs() < 1e-12
                && (get("ring") - 0.1).abs() < 1e-12
        );
        assert!((get("tips") - 0.75).abs() < 1e-12 && (get("roots") - 0.25).abs() < 1e-12);
        assert_eq!(get("fingers"), 2.0);
        assert!((get("to_palm") - 1.0).abs() < 1e-12 && (get("curl") - 0.5).abs() < 1e-12);
        assert!((get("opposed") - 1.0).abs() < 1e-12 && get("rounded").abs() < 1e-12);
        assert!((get("axis_across") - 1.0).abs() < 1e-12);
    }

    /// Normals in the y-z plane have x as the straight direction: a rod across the hand. Normals from all sides have none.
    #[test]
    fn straight_direction() {
        let hand = Hand::ftac();
        let (s, c) = 2.1_f64.sin_cos();
        let across = [(None, [0.0, 0.0, -1.0], 1.0), (Some(4), [0.0, s, c], 1.0), (Some(2), [0.0, -s, c], 1.0)];
        let found = Attributes::measure(&hand, &rod(), &grasp(0.5, &across));
        assert!(found.get("line_across").expect("known") > 0.999 && found.get("rounded").expect("known") < 1e-9);
        let all: Vec<_> =
            (0..3).flat_map(|axis| [1.0, -1.0].map(|sign| (Some(5), Vector3::ith(axis, sign).into(), 1.0))).collect();
        let found = Attributes::measure(&hand, &rod(), &grasp(0.5, &all));
        assert!((found.get("rounded").expect("known") - 1.0 / 3.0).abs() < 1e-9);
    }

    /// Without contacts all attributes are finite.
    #[test]
    fn nothing_touches() {
        let found = Attributes::measure(&Hand::ftac(), &rod(), &grasp(0.2, &[]));
        assert!(found.0.iter().all(|value| value.is_finite()), "{found:?}");
    }
}
