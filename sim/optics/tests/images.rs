//! From force to bytes: force balance, gel, shading and whole images against results worked out by hand.

#![allow(clippy::unwrap_used)]

use std::f64::consts::PI;

use hand_model::Hand;
use hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use tactile_optics::camera::{CameraResponse, Pinhole};
use tactile_optics::elastomer::Elastomer;
use tactile_optics::indentation::{GapMap, PIXEL_COUNT, press_gaps};
use tactile_optics::lamps::Lamp;
use tactile_optics::reflectance::Reflectance;
use tactile_optics::{IndentationMap, OpticsError, Sensor, SensorModel, press};

/// Returns a pad with its first camera; its edges are made square, so that the whole surface is flat.
fn flat_pad(hand: &Hand, name: &str) -> (Pad, PadCamera) {
    let mut pad = hand.pads.iter().find(|pad| pad.name == name).unwrap().clone();
    pad.edge_radius = 0.0;
    let camera = hand.cameras[pad.cameras[0]].clone();
    (pad, camera)
}

fn ball(radius: f64, x0: f64, y0: f64, lowest: f64) -> impl Fn(f64, f64) -> Option<f64> {
    move |x, y| {
        let inside = radius * radius - (x - x0).powi(2) - (y - y0).powi(2);
        (inside > 0.0).then(|| lowest + radius - inside.sqrt())
    }
}

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

#[test]
fn a_ball_sinks_in_as_winkler_says() {
    let hand = Hand::ftac();
    let gel = hand.parameters.gel;
    let (pad, camera) = flat_pad(&hand, "index_distal");
    for (radius, force) in [(0.021, 3.0), (0.010, 1.0), (0.021, 0.2)] {
        let lowest = 0.0123; // where the ball is left hanging must not matter
        let pressed = press(&pad, &[&camera], &gel, force, ball(radius, 0.001, -0.002, lowest)).unwrap();
        let depth = pressed.shift - lowest;
        let winkler = PI * radius * depth * depth * gel.stiffness;
        assert!((winkler - force).abs() < 0.03 * force, "{winkler} N for {force} N");
        assert!((pressed.force - force).abs() < 1e-3 * force);
        assert!((f64::from(pressed.maps[0].max_depth()) - depth).abs() < 2e-6);
    }
}

#[test]
fn a_press_over_two_cameras_shares_the_force() {
    let hand = Hand::ftac();
    let (pad, _) = flat_pad(&hand, "palm_ulnar");
    let cameras: Vec<&PadCamera> = pad.cameras.iter().map(|&index| &hand.cameras[index]).collect();
    let pressed = press(&pad, &cameras, &hand.parameters.gel, 3.0, ball(0.021, 0.0, 0.0, 0.0)).unwrap();
    let [a, b] = [0, 1].map(|i| pressed.maps[i].contact_pixels());
    assert!(a > 1000 && a.abs_diff(b) < a / 50, "{a} {b}");
    assert!((PI * 0.021 * pressed.shift.powi(2) * hand.parameters.gel.stiffness - 3.0).abs() < 0.09);
}

#[test]
fn coarse_to_fine_finds_the_same_and_casts_fewer_rays() {
    let hand = Hand::ftac();
    let pad = hand.pads.iter().find(|pad| pad.name == "index_distal").unwrap();
    let camera = &hand.cameras[pad.cameras[0]];
    let mut rays = 0;
    let shape = ball(0.012, 0.003, 0.004, 0.0);
    let quick = press(pad, &[camera], &hand.parameters.gel, 2.0, |x, y| {
        rays += 1;
        shape(x, y)
    })
    .unwrap();
    let full = press_gaps(&[GapMap::sample(pad, camera, &shape).unwrap()], &hand.parameters.gel, 2.0).unwrap();
    assert!((quick.shift - full.shift).abs() < 1e-8);
    // The two shifts differ only by the solver's rounding.
    let (a, b) = (quick.maps[0].to_depths(), full.maps[0].to_depths());
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-8));
    assert!(rays < PIXEL_COUNT / 3, "{rays}");
}

#[test]
fn nothing_and_too_much() {
    let hand = Hand::ftac();
    let (pad, camera) = flat_pad(&hand, "index_middle");
    let gel = hand.parameters.gel;
    let nothing = press(&pad, &[&camera], &gel, 3.0, |_, _| None).unwrap();
    assert_eq!((nothing.force, nothing.maps[0].contact()), (0.0, None));
    let idle = press(&pad, &[&camera], &gel, 0.0, |_, _| Some(0.0)).unwrap();
    assert_eq!(idle.maps[0], IndentationMap::idle());
    let flat = press(&pad, &[&camera], &gel, 1e6, |_, _| Some(0.0)).unwrap();
    assert!((flat.force - gel.stiffness * gel.thickness * pad.w * pad.h).abs() < 1e-3 * flat.force);
    assert!((f64::from(flat.maps[0].max_depth()) - gel.thickness).abs() < 1e-9);
}

#[test]
fn bad_input_is_named() {
    let hand = Hand::ftac();
    let (pad, camera) = flat_pad(&hand, "index_middle");
    let gel = hand.parameters.gel;
    assert_eq!(press(&pad, &[&camera], &gel, -1.0, |_, _| None), Err(OpticsError::Force(-1.0)));
    assert!(matches!(press(&pad, &[&camera], &gel, 1.0, |_, _| Some(f64::NAN)), Err(OpticsError::Surface { .. })));
    assert_eq!(IndentationMap::from_depth(vec![0.0; 3]), Err(OpticsError::MapSize { found: 3, expected: PIXEL_COUNT }));
    let mut depth = vec![0.0; PIXEL_COUNT];
    depth[IMAGE_SIZE * 2 + 5] = f32::NAN;
    assert!(matches!(IndentationMap::from_depth(depth), Err(OpticsError::MapValue { column: 5, row: 2, .. })));
}

#[test]
fn roughness_zero_is_lambert() {
    let reflectance = Reflectance { albedo: [0.9, 0.5, 0.2], roughness: 0.0 };
    assert_eq!((reflectance.a(), reflectance.b()), (1.0, 0.0));
    let normal = Vector3::new(0.2, -0.1, -1.0).normalize();
    let light = Vector3::new(-0.5, 0.3, -0.8).normalize();
    let radiance = reflectance.radiance(2.0, &normal, &light, &Vector3::new(0.0, 0.6, -0.8));
    for (radiance, albedo) in radiance.iter().zip(reflectance.albedo) {
        assert!((radiance - 2.0 * albedo / PI * normal.dot(&light)).abs() < 1e-12);
    }
}

#[test]
fn oren_nayar_is_the_papers_formula_in_angles() {
    let reflectance = Reflectance { albedo: [1.0; 3], roughness: 0.3 };
    let direction = |theta: f64, phi: f64| Vector3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
    for (theta_i, theta_r, phi) in [(0.5, 0.8, 0.3), (1.2, 0.4, 0.1), (0.7, 0.7, 2.5), (0.3, 0.9, -1.0f64)] {
        let (alpha, beta) = (f64::max(theta_i, theta_r), f64::min(theta_i, theta_r));
        let f = reflectance.a() + reflectance.b() * phi.cos().max(0.0) * alpha.sin() * beta.tan();
        let found = reflectance.factor(&Vector3::z(), &direction(theta_i, 1.0), &direction(theta_r, 1.0 + phi));
        assert!((found - theta_i.cos() / PI * f).abs() < 1e-12);
    }
}

#[test]
fn a_lamp_falls_off_as_the_square() {
    let lamp = Lamp::aimed(Point3::new(0.0, 0.0, -0.01), Point3::origin(), 2.0, 1.2, [1.0; 3]);
    assert!((lamp.direction_and_irradiance(&Point3::origin()).1 - 2.0 / 1e-4).abs() < 1e-6);
    assert!((lamp.direction_and_irradiance(&Point3::new(0.0, 0.0, 0.01)).1 - 2.0 / 4e-4).abs() < 1e-6);
    assert_eq!(lamp.direction_and_irradiance(&Point3::new(0.0, 0.0, -0.02)).1, 0.0);
}

#[test]
fn the_pinhole_is_rectified_to_the_camera() {
    let hand = Hand::ftac();
    for camera in &hand.cameras {
        let pinhole = Pinhole { position: Point3::new(1e-4, camera.center_y, -0.015) };
        let (x, y) = camera.pixel_center(17, 200);
        let (column, row) = pinhole.project(camera, &Point3::new(x, y, 0.0));
        assert!((column - 17.0).abs() < 1e-9 && (row - 200.0).abs() < 1e-9);
    }
}

/// Computes the mean grey level of a channel over a window.
fn mean(image: &[u8], channel: usize, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> f64 {
    let count = (columns.len() * rows.len()) as f64;
    rows.flat_map(|row| columns.clone().map(move |column| (row, column)))
        .map(|(row, column)| f64::from(image[3 * (row * IMAGE_SIZE + column) + channel]))
        .sum::<f64>()
        / count
}

#[test]
fn a_tilted_plane_brightens_the_lamp_it_faces() {
    let hand = Hand::ftac();
    let (pad, camera) = flat_pad(&hand, "index_distal");
    let sensor = Sensor::unit(&pad, &camera, 3);
    // dz/dx, dz/dy of the pressed gel, and the channel whose lamp it then faces (and one that it turns away from).
    for (slope, brighter, darker) in [([0.3, 0.0], 0, 1), ([-0.3, 0.0], 1, 0), ([0.0, 0.3], 2, 0), ([0.0, -0.3], 1, 2)]
    {
        let depth = (0..PIXEL_COUNT).map(|i| {
            let (x, y) = camera.pixel_center(i % IMAGE_SIZE, i / IMAGE_SIZE);
            let near = x.abs() < 0.003 && y.abs() < 0.003;
            if near { (0.001 - slope[0] * x - slope[1] * y) as f32 } else { 0.0 }
        });
        let image = sensor.render(&IndentationMap::from_depth(depth.collect()).unwrap(), &mut rng(1));
        let change = |channel| {
            let part = |image| mean(image, channel, 110..130, 110..130);
            part(&image.rgb) - part(&sensor.background().rgb)
        };
        assert!(
            change(brighter) > 5.0 && change(darker) < change(brighter) - 10.0,
            "{slope:?}: {} {}",
            change(brighter),
            change(darker)
        );
    }
}

#[test]
fn symmetric_lamps_give_a_symmetric_image() {
    let hand = Hand::ftac();
    let (pad, camera) = flat_pad(&hand, "index_distal");
    let mut model = SensorModel::nominal(&pad, &camera);
    model.noise = 0.0;
    let color = [1.0, 0.5, 0.25];
    model.lamps = [-0.012, 0.012]
        .map(|x| Lamp::aimed(Point3::new(x, 0.0, -0.01), Point3::new(-0.5 * x, 0.0, 0.0), 1.0, 2.0, color))
        .to_vec();
    let sensor = Sensor::with_model(&pad, &camera, model, 0).unwrap();
    let pressed = press(&pad, &[&camera], &hand.parameters.gel, 3.0, ball(0.021, 0.0, 0.0, 0.0)).unwrap();
    let image = sensor.render(&pressed.maps[0], &mut rng(0));
    for (index, value) in image.rgb.iter().enumerate() {
        let (row, column, channel) = (index / 3 / IMAGE_SIZE, index / 3 % IMAGE_SIZE, index % 3);
        for (row, column) in [(row, IMAGE_SIZE - 1 - column), (IMAGE_SIZE - 1 - row, column)] {
            // A level more than rounding: lines to a lamp are followed in another order on its other side.
            assert!(image.rgb[3 * (row * IMAGE_SIZE + column) + channel].abs_diff(*value) <= 2);
        }
    }
}

#[test]
fn idle_is_the_background_up_to_noise() {
    let hand = Hand::ftac();
    for (index, camera) in hand.cameras.iter().enumerate().step_by(5) {
        let sensor = Sensor::unit(&hand.pads[camera.pad], camera, index as u64);
        let image = sensor.render(&IndentationMap::idle(), &mut rng(5));
        let differences = image.rgb.iter().zip(&sensor.background().rgb).map(|(a, b)| f64::from(*a) - f64::from(*b));
        let (sum, squares) = differences.fold((0.0, 0.0), |(sum, squares), d| (sum + d, squares + d * d));
        let n = image.rgb.len() as f64;
        // 0.7 of noise and the rounding of both: sqrt(0.49 + 2/12) at most.
        let deviation = (squares / n).sqrt();
        assert!((sum / n).abs() < 0.02 && (0.6..0.85).contains(&deviation), "{} {deviation}", sum / n);
    }
}

#[test]
fn far_from_the_contact_is_the_background() {
    let hand = Hand::ftac();
    let pad = &hand.pads[0];
    let camera = &hand.cameras[pad.cameras[0]];
    let mut model = SensorModel::unit(pad, camera, 9);
    model.noise = 0.0;
    let sensor = Sensor::with_model(pad, camera, model, 9).unwrap();
    let mut depth = vec![0.0; PIXEL_COUNT];
    depth[120 * IMAGE_SIZE + 30] = 1e-3;
    let image = sensor.render(&IndentationMap::from_depth(depth).unwrap(), &mut rng(5));
    assert_ne!(image, **sensor.background());
    let half = |image: &[u8]| -> Vec<u8> { image.chunks(3 * IMAGE_SIZE).flat_map(|row| row[360..].to_vec()).collect() };
    assert_eq!(half(&image.rgb), half(&sensor.background().rgb));
}

#[test]
fn same_seed_same_bytes_other_seed_other_bytes() {
    let hand = Hand::ftac();
    let (pad, camera) = flat_pad(&hand, "thumb_distal");
    let pressed = press(&pad, &[&camera], &hand.parameters.gel, 3.0, ball(0.021, 0.0, 0.0, 0.0)).unwrap();
    let image = |unit, noise| Sensor::unit(&pad, &camera, unit).render(&pressed.maps[0], &mut rng(noise));
    assert_eq!(image(1, 2), image(1, 2));
    assert_ne!(image(1, 2), image(1, 3));
    assert_ne!(image(1, 2), image(2, 2));
}

#[test]
fn a_calibration_survives_the_file_and_is_checked() {
    let hand = Hand::ftac();
    let mut model = SensorModel::unit(&hand.pads[3], &hand.cameras[hand.pads[3].cameras[0]], 4);
    assert_eq!(SensorModel::from_toml(&model.to_toml().unwrap()).unwrap(), model);
    model.lamps[2].eta = -1.0;
    let error = SensorModel::from_toml(&model.to_toml().unwrap()).unwrap_err();
    assert!(error.to_string().contains("lamps[2]"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn smoothing_never_enters_the_object_nor_goes_deeper_than_it(
        spots in proptest::collection::vec((0usize..240, 0usize..240, 1usize..40, 1e-5f32..2.5e-3), 1..5),
    ) {
        let hand = Hand::ftac();
        let mut depth = vec![0.0f32; PIXEL_COUNT];
        for (column, row, size, deep) in spots {
            for r in row..(row + size).min(240) {
                for c in column..(column + size).min(240) {
                    depth[r * IMAGE_SIZE + c] = deep;
                }
            }
        }
        let deepest = depth.iter().copied().fold(0.0, f32::max);
        let map = IndentationMap::from_depth(depth.clone()).unwrap();
        let gel = Elastomer::default().deform(&hand.cameras[0], &map).unwrap();
        for (index, own) in depth.into_iter().enumerate() {
            let smooth = gel.depth(index % IMAGE_SIZE, index / IMAGE_SIZE);
            let good = (own..=deepest * 1.001).contains(&smooth);
            prop_assert!(good, "{} became {}", own, smooth);
        }
    }

    #[test]
    fn response_inverts(g2 in 0.0..0.3f64, g3 in 0.0..0.3f64, measured in 0.0..1.0f64) {
        let response = CameraResponse { coefficients: [1.0 - g2 - g3, g2, g3] };
        prop_assert!((response.measured(response.radiance(measured)) - measured).abs() < 1e-9);
    }
}
