//! Images of curved pads.

#![allow(clippy::unwrap_used)]

use hand_model::Hand;
use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use tactile_optics::{CurvedSensor, GelFoundation, IndentationMap, PadCover, Sensor, SensorModel, press};

fn index() -> (Hand, Pad, PadCamera) {
    let hand = Hand::ftac();
    let pad = hand.pads.iter().find(|pad| pad.name == "index_distal").unwrap().clone();
    let camera = hand.cameras[pad.cameras[0]].clone();
    (hand, pad, camera)
}

fn ball(radius: f64) -> impl Fn(f64, f64) -> Option<f64> {
    move |x, y| {
        let inside = radius * radius - x * x - y * y;
        (inside > 0.0).then(|| radius - inside.sqrt())
    }
}

fn curved(pad: &Pad, camera: &PadCamera, cover: PadCover) -> CurvedSensor {
    CurvedSensor::new(pad, camera, SensorModel::unit(pad, camera, 3), cover, 3).unwrap()
}

/// Computes the largest and the mean difference between two images, grey levels.
fn differences(a: &[u8], b: &[u8]) -> (u8, f64) {
    let all = || a.iter().zip(b).map(|(a, b)| a.abs_diff(*b));
    (all().max().unwrap(), all().map(f64::from).sum::<f64>() / a.len() as f64)
}

#[test]
fn without_curvature_the_images_are_bit_identical_to_the_flat_pads() {
    let (hand, pad, camera) = index();
    let sensor = Sensor::with_model(&pad, &camera, SensorModel::unit(&pad, &camera, 3), 3).unwrap();
    let flat = curved(&pad, &camera, PadCover::FLAT);
    for force in [0.0, 0.4, 3.0] {
        let map = press(&pad, &[&camera], &hand.gel(), force, ball(0.006)).unwrap().maps.remove(0);
        let mut seeds = [ChaCha8Rng::seed_from_u64(5), ChaCha8Rng::seed_from_u64(5)];
        assert_eq!(flat.render(&map, &mut seeds[0]), sensor.render(&map, &mut seeds[1]));
    }
    assert_eq!(flat.background(), **sensor.background());
}

#[test]
fn a_nearly_flat_cover_looks_nearly_flat() {
    let (hand, pad, camera) = index();
    let quiet = SensorModel { noise: 0.0, ..SensorModel::unit(&pad, &camera, 3) };
    let sensor = Sensor::with_model(&pad, &camera, quiet.clone(), 3).unwrap();
    let cover = PadCover::cylinder(50.0).unwrap();
    let nearly = CurvedSensor::new(&pad, &camera, quiet, cover, 3).unwrap();
    // Shadows dim a few pixels beside the foot of a lamp above the gel (a known flaw), already in the background.
    let (a, b) = (nearly.background(), sensor.background());
    let (_, mean) = differences(&a.rgb, &b.rgb);
    let off = a.rgb.iter().zip(&b.rgb).filter(|(a, b)| a.abs_diff(**b) > 1).count();
    assert!(off < 50 && mean < 0.02, "{off} {mean}");
    // A shallow press, so that the shift of relief towards the camera's foot, which the flat pad leaves out, is small.
    let map = press(&pad, &[&camera], &hand.gel(), 0.05, ball(0.02)).unwrap().maps.remove(0);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (a, b) = (nearly.render(&map, &mut rng), sensor.render(&map, &mut rng));
    let (_, moved) = differences(&b.rgb, &sensor.background().rgb);
    let (_, off) = differences(&a.rgb, &b.rgb);
    assert!(off < 0.25 * moved, "{off} of {moved}");
}

#[test]
fn the_relief_is_the_circle_that_pressing_along_the_normals_leaves() {
    let (_, pad, camera) = index();
    let radius = 0.02;
    let sensor = curved(&pad, &camera, PadCover::cylinder(radius).unwrap());
    let deep = 0.4e-3;
    let relief = sensor.relief(&vec![deep as f32; IMAGE_SIZE * IMAGE_SIZE]);
    for column in [0, 50, 119, 200] {
        let (x, _) = camera.pixel_center(column, 77);
        let exact = radius - ((radius - deep).powi(2) - x * x).sqrt();
        assert!((f64::from(relief[77 * IMAGE_SIZE + column]) - exact).abs() < 2e-6, "{column}");
    }
}

#[test]
fn a_plate_shows_as_a_stripe_along_the_digit() {
    let (_, pad, camera) = index();
    let cover = PadCover::cylinder(0.015).unwrap();
    let quiet = SensorModel { noise: 0.0, ..SensorModel::unit(&pad, &camera, 3) };
    let sensor = CurvedSensor::new(&pad, &camera, quiet, cover, 3).unwrap();
    let gel = GelFoundation { thickness: 0.0025, modulus: 1.5e5, exponent: 1.0, hardening: 0.0 };
    let pressed = cover.press(&pad, &[&camera], &gel, 8.0, |_, _| Some(0.0)).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let background = sensor.background();
    assert_eq!(sensor.render(&IndentationMap::idle(), &mut rng), background);
    let image = sensor.render(&pressed.maps[0], &mut rng);
    let changed = |column: usize, row: usize| {
        let at = 3 * (row * IMAGE_SIZE + column);
        (0..3).any(|c| image.rgb[at + c].abs_diff(background.rgb[at + c]) > 4)
    };
    let contact = pressed.maps[0].contact().unwrap();
    // Under the stripe most rows change; beside it, beyond the gel's bulge, none does.
    for row in [40, 120, 200] {
        let share = (contact.left..contact.right).filter(|&column| changed(column, row)).count() as f64
            / contact.width() as f64;
        println!("row {row}: {share}");
        assert!(share > 0.5, "row {row}: {share}");
    }
    let outside = (0..20).flat_map(|column| (0..IMAGE_SIZE).map(move |row| (column, row)));
    let outside = outside.filter(|&(column, row)| changed(column, row)).count();
    assert!(contact.left > 40 && outside < 240, "{outside} {contact:?}");
}
