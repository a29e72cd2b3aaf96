//! Counts and sizes of the model, and tactile coverage: the share of the palmar skin that is a sensor.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use hand_model::Hand;
use hand_model::hand::SkinElement;
use nalgebra::{Isometry3, Point3, Vector3};
use report::picture::{Picture, View, save, tile};
use serde_json::json;

use super::row::{CheckRow, Verdict};

/// The paper's table of sensor configurations: letter, h and w (mm).
const CONFIGURATIONS: [(&str, f64, f64); 6] =
    [("a", 33.0, 20.0), ("b", 29.0, 20.0), ("c", 41.0, 20.0), ("d", 45.0, 25.0), ("e", 48.0, 29.0), ("f", 69.0, 47.0)];
/// Fingertip in the distal link's frame: the end of its cover, m.
const FINGERTIP: [f64; 3] = [0.0325, 0.0, 0.0];
/// Side of a skin element, m.
const SKIN_ELEMENT_SIDE: f64 = 0.001;
/// Maximum angle between the normal of palmar skin and the pads' direction, rad.
const MAX_PALMAR_ANGLE: f64 = std::f64::consts::FRAC_PI_4;

/// Returns the rows derived directly from the model.
pub fn rows(hand: &Hand) -> Vec<CheckRow> {
    let poses = hand.tree.forward(&[0.0; 15]);
    let tip = hand.tree.find("middle_3").map_or(f64::NAN, |link| (poses[link] * Point3::from(FINGERTIP)).y);
    let length = (tip - hand.palm_from_flange.translation.y) * 1e3;
    let range = |joint: &hand_model::kinematics::Joint| {
        (joint.lower.to_degrees().abs() < 1e-6) && (joint.upper.to_degrees() - 90.0).abs() < 1e-6
    };
    let full = hand.tree.joints.iter().filter(|joint| range(joint)).count();
    let thumb = &hand.tree.joints[hand_model::Digit::Thumb.ftac_joints()[0]];
    let pip = poses[1] * hand.tree.joints[1].axis.into_inner();
    let cmc = poses[0] * thumb.axis.into_inner();
    let tilt = (cmc.dot(&pip).abs().acos()).to_degrees();
    let mut by_letter: BTreeMap<String, usize> = BTreeMap::new();
    for pad in &hand.pads {
        *by_letter.entry(pad.configuration.to_string()).or_default() += 1;
    }
    let sizes = CONFIGURATIONS.iter().all(|(letter, h, w)| {
        hand.parameters
            .configuration
            .get(*letter)
            .is_some_and(|c| (c.h * 1e3 - h).abs() < 1e-9 && (c.w * 1e3 - w).abs() < 1e-9)
    });
    let double = hand.parameters.configuration.get("f").is_some_and(|c| c.cameras == 2);
    let count = |what: &str, found: usize, wanted: usize, method: &str| {
        CheckRow::new(what, found.to_string(), &wanted.to_string(), method, Verdict::from_good(found == wanted))
    };
    vec![
        CheckRow::new(
            "wrist to middle fingertip",
            format!("{length:.1} mm"),
            "194 mm",
            "flange to the end of the middle finger's cover, open hand; within 0.5 mm",
            Verdict::from_good((length - 194.0).abs() < 0.5),
        ),
        count("joints", hand.tree.len(), 15, "revolute joints of the hand's tree"),
        count("joints of 0 to 90 deg", full, 15, "joint limits; exact"),
        CheckRow::new(
            "thumb: CMC axis to PIP axis",
            format!("{tilt:.1} deg"),
            "45 deg",
            "angle between the axes, open hand; by the public model's frames, within 5 deg",
            Verdict::from_good((tilt - 45.0).abs() < 5.0),
        ),
        count("actuators (5 cables, opposition)", hand.parameters.actuator.len(), 6, "servos of the parameter file"),
        count("pads", hand.pads.len(), 17, "sensing surfaces"),
        count("cameras", hand.cameras.len(), 18, "one a pad, two on the largest"),
        CheckRow::new(
            "sensor configurations",
            format!("{} used, sizes {}", by_letter.len(), if sizes && double { "equal" } else { "differ" }),
            "6 with their sizes",
            "h x w of every configuration against the paper's table; exact; two cameras on f",
            Verdict::from_good(by_letter.len() == 6 && sizes && double),
        )
        .with_details(json!({ "pads_of_each": by_letter })),
    ]
}

/// Palmar skin of one link, and its part covered by pads, m2.
struct PalmarSkin {
    palmar: f64,
    covered: f64,
}

/// Returns the row on palmar coverage.
pub fn coverage(hand: &Hand, out: Option<&Path>) -> Result<CheckRow> {
    let poses = hand.tree.forward(&[0.0; 15]);
    let (mut palmar, mut covered) = (0.0, 0.0);
    let mut by_link = BTreeMap::new();
    for link in std::iter::once(None).chain((0..hand.tree.len()).map(Some)) {
        let share = link_share(hand, link, &poses, MAX_PALMAR_ANGLE);
        let name = link.map_or("palm", |link| hand.tree.joints[link].name.as_str());
        by_link.insert(name, json!({ "palmar_cm2": share.palmar * 1e4, "covered_cm2": share.covered * 1e4 }));
        palmar += share.palmar;
        covered += share.covered;
    }
    let share = covered / palmar;
    let wide: (f64, f64) = std::iter::once(None).chain((0..hand.tree.len()).map(Some)).fold((0.0, 0.0), |sum, link| {
        let share = link_share(hand, link, &poses, std::f64::consts::FRAC_PI_2);
        (sum.0 + share.palmar, sum.1 + share.covered)
    });
    let mut row = CheckRow::new(
        "palmar coverage",
        format!("{:.1} % of {:.0} cm2", share * 100.0, palmar * 1e4),
        "70 %",
        "area of the covers' skin in 1 mm elements whose normal is within 45 deg of the pads' direction and that no other \
         cover hides; covered if a pad's rectangle lies over it; at least 70 %",
        Verdict::from_good(share >= 0.70),
    )
    .with_details(json!({ "links": by_link, "share_with_normals_up_to_90_deg": wide.1 / wide.0 }));
    if let Some(folder) = out {
        let views = [View::palm().recentered(Point3::new(0.012, -0.005, 0.0), 0.235), View::thumb_side()];
        let pictures = views.map(|view| {
            let mut picture = Picture::new(480, view);
            picture.hand(hand, &[0.0; 15]);
            picture.finish("the open hand; blue: the 17 pads")
        });
        save(&tile(&pictures, 2), &folder.join("pads.png"))?;
        row.picture = Some("pads.png".into());
    }
    Ok(row)
}

fn link_share(hand: &Hand, link: Option<usize>, poses: &[Isometry3<f64>], reach: f64) -> PalmarSkin {
    let pads: Vec<_> = hand.pads.iter().filter(|pad| pad.link == link).collect();
    let pose = link.map_or(Isometry3::identity(), |link| poses[link]);
    let cover = link.map_or(&hand.palm_cover, |link| &hand.covers[link]);
    // All pads of a link face the same way; every link of this hand has one.
    let Some(direction) = pads.first().map(|pad| pad.link_from_pad * Vector3::z()) else {
        return PalmarSkin { palmar: 0.0, covered: 0.0 };
    };
    let hidden = |element: &SkinElement| {
        let at = pose * element.point;
        std::iter::once((None, &hand.palm_cover))
            .chain(hand.covers.iter().enumerate().map(|(other, cover)| (Some(other), cover)))
            .filter(|(other, _)| *other != link)
            .any(|(other, cover)| {
                let other = other.map_or(Isometry3::identity(), |other| poses[other]) * cover.link_from_cover;
                let local = other.inverse_transform_point(&at);
                (0..3).all(|axis| local[axis].abs() < cover.half[axis] - 1e-4)
            })
    };
    let mut share = PalmarSkin { palmar: 0.0, covered: 0.0 };
    for element in cover.skin_elements(SKIN_ELEMENT_SIDE) {
        if element.normal.dot(&direction) < reach.cos() || hidden(&element) {
            continue;
        }
        share.palmar += element.area;
        let under = pads.iter().any(|pad| {
            let local = pad.link_from_pad.inverse_transform_point(&element.point);
            local.x.abs() <= 0.5 * pad.w && local.y.abs() <= 0.5 * pad.h
        });
        if under {
            share.covered += element.area;
        }
    }
    share
}
