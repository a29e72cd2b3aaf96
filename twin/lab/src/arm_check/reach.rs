//! Workspace of the level palm with fingers forward, without collisions of the arm with itself, the hand or the table.

use std::path::Path;

use anyhow::Result;
use control::arm_clearance::ArmBodies;
use control::inverse_kinematics::{ArmKinematics, Joints};
use grasp_verification::simulated_world::SimulatedWorld;
use image::{Rgb, RgbImage};
use nalgebra::{Isometry3, Translation3};
use rayon::prelude::*;
use report::lettering::{TEXT_COLOR, text};
use report::picture::save;
use serde_json::json;

use crate::hand_check::{CheckRow, Verdict};

/// Grid, m: spacing of the points, and extents of the maps.
const GRID_STEP: f64 = 0.05;
const HORIZONTAL_EXTENT: (f64, f64) = (-0.9, 0.9);
const VERTICAL_EXTENT: (f64, f64) = (0.0, 1.2);
/// Height of the map from above, m.
const TOP_MAP_HEIGHT: f64 = 0.15;
/// Minimum clearance of postures from themselves and from the table, m.
const MIN_CLEARANCE: f64 = 0.0;
/// Singularity threshold: smallest singular value of the Jacobian (m/rad).
const SINGULARITY_THRESHOLD: f64 = 0.04;
/// Pixels per point of the grid.
const PIXELS_PER_POINT: u32 = 16;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reachability {
    Free,
    NearSingular,
    OnlyColliding,
    OutOfReach,
}

impl Reachability {
    const ALL: [(Self, &'static str, [u8; 3]); 4] = [
        (Self::Free, "reached, free", [96, 170, 110]),
        (Self::NearSingular, "reached near a singularity", [220, 190, 80]),
        (Self::OnlyColliding, "only with a collision", [205, 85, 70]),
        (Self::OutOfReach, "out of reach", [225, 226, 228]),
    ];
}

fn classify_point(
    world: &SimulatedWorld,
    kinematics: &ArmKinematics,
    bodies: &ArmBodies,
    at: [f64; 3],
) -> Result<Reachability> {
    let start = kinematics.palm_pose(&world.cell.ready_posture);
    let palm = Isometry3::from_parts(Translation3::from(at), start.rotation);
    let postures: Vec<Joints> = match kinematics.solve(&palm, &world.cell.ready_posture) {
        Some(q) if is_collision_free(kinematics, bodies, &q)? => vec![q],
        Some(_) => kinematics.solutions(&palm, &world.cell.ready_posture),
        None => return Ok(Reachability::OutOfReach),
    };
    let mut best = Reachability::OnlyColliding;
    for q in &postures {
        if is_collision_free(kinematics, bodies, q)? {
            let (_, mut jacobian) = kinematics.jacobian(q);
            jacobian.fixed_rows_mut::<3>(3).scale_mut(0.25);
            let smallest = jacobian.singular_values().min();
            if smallest > SINGULARITY_THRESHOLD {
                return Ok(Reachability::Free);
            }
            best = Reachability::NearSingular;
        }
    }
    Ok(best)
}

fn is_collision_free(kinematics: &ArmKinematics, bodies: &ArmBodies, q: &Joints) -> Result<bool> {
    Ok(bodies.clearance(kinematics, q)?.distance > MIN_CLEARANCE
        && bodies.lowest_point_height(kinematics, q)? > MIN_CLEARANCE)
}

fn point_count((from, to): (f64, f64)) -> usize {
    ((to - from) / GRID_STEP).round() as usize + 1
}

/// Returns the row with its maps: from the side (y = 0) and from above.
pub fn row(world: &SimulatedWorld, out: Option<&Path>, quiet: bool) -> Result<CheckRow> {
    let kinematics = world.cell.kinematics();
    let bodies = ArmBodies::new(&kinematics, &world.cell.robot.hand)?;
    let (columns, heights, depths) =
        (point_count(HORIZONTAL_EXTENT), point_count(VERTICAL_EXTENT), point_count(HORIZONTAL_EXTENT));
    let across = |n: usize| HORIZONTAL_EXTENT.0 + GRID_STEP * n as f64;
    let side = (0..columns * heights)
        .map(|n| [across(n % columns), 0.0, VERTICAL_EXTENT.0 + GRID_STEP * (n / columns) as f64]);
    let above = (0..columns * depths).map(|n| [across(n % columns), across(n / columns), TOP_MAP_HEIGHT]);
    let places: Vec<[f64; 3]> = side.chain(above).collect();
    let bar = progress::bar(places.len() as u64, "places", quiet);
    let found: Vec<Reachability> = places
        .par_iter()
        .map(|at| {
            let place = classify_point(world, &kinematics, &bodies, *at);
            bar.inc(1);
            place
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    let number = |kind: Reachability| found.iter().filter(|place| **place == kind).count();
    let layout = &world.scenario.layout;
    // Points above the object positions of a trial, at the map's height.
    let needed: Vec<[f64; 3]> =
        [&layout.first, &layout.second].iter().map(|spot| [spot.x, spot.y, TOP_MAP_HEIGHT]).collect();
    let mut served = 0;
    for at in &needed {
        served += usize::from(classify_point(world, &kinematics, &bodies, *at)? == Reachability::Free);
    }
    let mut row = CheckRow::new(
        "reach, palm level",
        format!("{} of {} places free", number(Reachability::Free), found.len()),
        "table in reach",
        &format!(
            "places {:.0} mm apart in the plane y = 0 and at z = {TOP_MAP_HEIGHT} m: a posture within the limits at which no two bodies of arm, \
             hand and table touch; near a singularity {}, only with a collision {}, out of reach {}; over both objects' places: \
             {served} of {}",
            GRID_STEP * 1e3,
            number(Reachability::NearSingular),
            number(Reachability::OnlyColliding),
            number(Reachability::OutOfReach),
            needed.len()
        ),
        Verdict::from_good(served == needed.len()),
    )
    .with_details(json!({
        "free": number(Reachability::Free), "near_singular": number(Reachability::NearSingular),
        "only_colliding": number(Reachability::OnlyColliding), "out_of_reach": number(Reachability::OutOfReach), "step_m": GRID_STEP,
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

fn draw(maps: &[(&str, &[Reachability], usize); 2], columns: usize) -> RgbImage {
    let (width, gap, head) = (columns as u32 * PIXELS_PER_POINT, 24u32, 90u32);
    let tallest = maps.iter().map(|map| map.2).max().unwrap_or(0) as u32 * PIXELS_PER_POINT;
    let mut image = RgbImage::from_pixel(2 * width + 3 * gap, tallest + head + gap, Rgb([255, 255, 255]));
    for (n, (_, name, color)) in Reachability::ALL.iter().enumerate() {
        fill(&mut image, gap, 8 + 14 * n as u32, 10, *color);
        text(&mut image, (i64::from(gap) + 16, 6 + 14 * n as i64), name, TEXT_COLOR);
    }
    for (m, (title, places, rows)) in maps.iter().enumerate() {
        let left = gap + m as u32 * (width + gap);
        text(&mut image, (i64::from(left), i64::from(head) - 17), title, TEXT_COLOR);
        for (n, place) in places.iter().enumerate() {
            let (column, row) = (n % columns, rows - 1 - n / columns);
            let color = Reachability::ALL.iter().find(|kind| kind.0 == *place).map_or([0; 3], |kind| kind.2);
            fill(
                &mut image,
                left + column as u32 * PIXELS_PER_POINT,
                head + row as u32 * PIXELS_PER_POINT,
                PIXELS_PER_POINT - 1,
                color,
            );
        }
        // Mark of the base's axis.
        let middle = ((-HORIZONTAL_EXTENT.0) / GRID_STEP).round() as u32;
        let row = if m == 0 { *rows as u32 - 1 } else { *rows as u32 / 2 };
        fill(&mut image, left + middle * PIXELS_PER_POINT + 4, head + row * PIXELS_PER_POINT + 4, 7, [40, 42, 48]);
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
