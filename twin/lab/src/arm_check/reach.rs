//! Workspace of the level palm with fingers forward, without collisions of the arm with itself, the hand or the table.

use std::path::Path;

use anyhow::Result;
use control::arm_clearance::ArmBodies;
use control::inverse_kinematics::{ArmKinematics, Joints};
use grasp_verification::simulated_world::World;
use image::{Rgb, RgbImage};
use nalgebra::{Isometry3, Translation3};
use rayon::prelude::*;
use report::picture::{save, text};
use serde_json::json;

use crate::hand_check::{Row, Verdict};

/// Grid, m: spacing of the points, and extents of the maps.
const STEP: f64 = 0.05;
const ACROSS: (f64, f64) = (-0.9, 0.9);
const UP: (f64, f64) = (0.0, 1.2);
/// Height of the map seen from above, m.
const LEVEL: f64 = 0.15;
/// Minimum clearance of postures from themselves and from the table, m.
const CLEAR: f64 = 0.0;
/// Singularity threshold: smallest singular value of the Jacobian (m/rad).
const SINGULAR: f64 = 0.04;
/// Pixels per point of the grid.
const PIXELS: u32 = 16;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Free,
    NearSingular,
    OnlyColliding,
    OutOfReach,
}

impl Place {
    const ALL: [(Self, &'static str, [u8; 3]); 4] = [
        (Self::Free, "reached, free", [96, 170, 110]),
        (Self::NearSingular, "reached near a singularity", [220, 190, 80]),
        (Self::OnlyColliding, "only with a collision", [205, 85, 70]),
        (Self::OutOfReach, "out of reach", [225, 226, 228]),
    ];
}

fn look(world: &World, kinematics: &ArmKinematics, bodies: &ArmBodies, at: [f64; 3]) -> Result<Place> {
    let start = kinematics.palm_pose(&world.cell.ready);
    let palm = Isometry3::from_parts(Translation3::from(at), start.rotation);
    let postures: Vec<Joints> = match kinematics.solve(&palm, &world.cell.ready) {
        Some(q) if free(kinematics, bodies, &q)? => vec![q],
        Some(_) => kinematics.solutions(&palm, &world.cell.ready),
        None => return Ok(Place::OutOfReach),
    };
    let mut best = Place::OnlyColliding;
    for q in &postures {
        if free(kinematics, bodies, q)? {
            let (_, mut jacobian) = kinematics.jacobian(q);
            jacobian.fixed_rows_mut::<3>(3).scale_mut(0.25);
            let smallest = jacobian.singular_values().min();
            if smallest > SINGULAR {
                return Ok(Place::Free);
            }
            best = Place::NearSingular;
        }
    }
    Ok(best)
}

fn free(kinematics: &ArmKinematics, bodies: &ArmBodies, q: &Joints) -> Result<bool> {
    Ok(bodies.clearance(kinematics, q)?.distance > CLEAR && bodies.height(kinematics, q)? > CLEAR)
}

fn count((from, to): (f64, f64)) -> usize {
    ((to - from) / STEP).round() as usize + 1
}

/// Returns the row with its maps: from the side (y = 0) and from above.
pub fn row(world: &World, out: Option<&Path>, quiet: bool) -> Result<Row> {
    let kinematics = world.cell.kinematics();
    let bodies = ArmBodies::new(&kinematics, &world.cell.robot.hand)?;
    let (columns, heights, depths) = (count(ACROSS), count(UP), count(ACROSS));
    let across = |n: usize| ACROSS.0 + STEP * n as f64;
    let side = (0..columns * heights).map(|n| [across(n % columns), 0.0, UP.0 + STEP * (n / columns) as f64]);
    let above = (0..columns * depths).map(|n| [across(n % columns), across(n / columns), LEVEL]);
    let places: Vec<[f64; 3]> = side.chain(above).collect();
    let bar = progress::bar(places.len() as u64, "places", quiet);
    let found: Vec<Place> = places
        .par_iter()
        .map(|at| {
            let place = look(world, &kinematics, &bodies, *at);
            bar.inc(1);
            place
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    let number = |kind: Place| found.iter().filter(|place| **place == kind).count();
    let layout = &world.scenario.layout;
    // Points above the places where the objects of a trial stand, at the map's height.
    let needed: Vec<[f64; 3]> = [&layout.first, &layout.second].iter().map(|spot| [spot.x, spot.y, LEVEL]).collect();
    let mut served = 0;
    for at in &needed {
        served += usize::from(look(world, &kinematics, &bodies, *at)? == Place::Free);
    }
    let mut row = Row::new(
        "reach, palm level",
        format!("{} of {} places free", number(Place::Free), found.len()),
        "table in reach",
        &format!(
            "places {:.0} mm apart in the plane y = 0 and at z = {LEVEL} m: a posture within the limits at which no two bodies of arm, \
             hand and table touch; near a singularity {}, only with a collision {}, out of reach {}; over both objects' places: \
             {served} of {}",
            STEP * 1e3,
            number(Place::NearSingular),
            number(Place::OnlyColliding),
            number(Place::OutOfReach),
            needed.len()
        ),
        Verdict::of(served == needed.len()),
    )
    .with(json!({
        "free": number(Place::Free), "near_singular": number(Place::NearSingular),
        "only_colliding": number(Place::OnlyColliding), "out_of_reach": number(Place::OutOfReach), "step_m": STEP,
    }));
    if let Some(folder) = out {
        let maps = [
            ("from the side, y = 0; x to the right, z up", &found[..columns * heights], heights),
            ("from above, z = 0.15 m; x to the right, y up", &found[columns * heights..], depths),
        ];
        save(&draw(&maps, columns), &folder.join("reach.png"))?;
        row.picture = Some("reach.png".into());
    }
    Ok(row)
}

fn draw(maps: &[(&str, &[Place], usize); 2], columns: usize) -> RgbImage {
    let (width, gap, head) = (columns as u32 * PIXELS, 24u32, 90u32);
    let tallest = maps.iter().map(|map| map.2).max().unwrap_or(0) as u32 * PIXELS;
    let mut image = RgbImage::from_pixel(2 * width + 3 * gap, tallest + head + gap, Rgb([255, 255, 255]));
    for (n, (_, name, color)) in Place::ALL.iter().enumerate() {
        fill(&mut image, gap, 8 + 14 * n as u32, 10, *color);
        text(&mut image, i64::from(gap) + 16, 9 + 14 * n as i64, name, [40, 42, 48]);
    }
    for (m, (title, places, rows)) in maps.iter().enumerate() {
        let left = gap + m as u32 * (width + gap);
        text(&mut image, i64::from(left), i64::from(head) - 14, title, [40, 42, 48]);
        for (n, place) in places.iter().enumerate() {
            let (column, row) = (n % columns, rows - 1 - n / columns);
            let color = Place::ALL.iter().find(|kind| kind.0 == *place).map_or([0; 3], |kind| kind.2);
            fill(&mut image, left + column as u32 * PIXELS, head + row as u32 * PIXELS, PIXELS - 1, color);
        }
        // Mark of the base's axis.
        let middle = ((-ACROSS.0) / STEP).round() as u32;
        let row = if m == 0 { *rows as u32 - 1 } else { *rows as u32 / 2 };
        fill(&mut image, left + middle * PIXELS + 4, head + row * PIXELS + 4, 7, [40, 42, 48]);
    }
    image
}

fn fill(image: &mut RgbImage, x: u32, y: u32, size: u32, color: [u8; 3]) {
    for (dx, dy) in (0..size).flat_map(|dx| (0..size).map(move |dy| (dx, dy))) {
        if x + dx < image.width() && y + dy < image.height() {
            image.put_pixel(x + dx, y + dy, Rgb(color));
        }
    }
}
