//! Processing of rendered tactile images to heights: calibration, height maps, forces and faults, on images of a small
//! Lambertian renderer with near-field lamps behind the gel.

use std::sync::Arc;

use hand_model::Hand;
use hand_model::robot::{TactileFrame, TactileImage};
use nalgebra::Vector3;
use tactile_perception::{CalibrationPress, IMAGE_SIZE as N, PIXELS, PadTouch, PhotometricCalibration, TouchPipeline};

struct Noise(u64);

impl Noise {
    /// Uniform in [0, 1).
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    /// About normal, sd 1.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Indentation (m) by a ball of radius `r` pressed `depth` deep at (x, y), with the rim smoothed by the gel.
fn ball(hand: &Hand, camera: usize, r: f64, x: f64, y: f64, depth: f64) -> Vec<f32> {
    let view = &hand.cameras[camera];
    let pad = &hand.pads[view.pad];
    let mut h: Vec<f32> = (0..PIXELS)
        .map(|i| {
            let (px, py) = view.pixel_center(i % N, i / N);
            let d2 = (px - x).powi(2) + (py - y).powi(2);
            if d2 < r * r {
                (pad.surface_height(px, py) - (r - depth - (r * r - d2).sqrt())).max(0.0) as f32
            } else {
                0.0
            }
        })
        .collect();
    for _ in 0..2 {
        for (step, along) in [(1, 0), (N, 1)] {
            let from = h.clone();
            for i in 0..PIXELS {
                let k = if along == 0 { i % N } else { i / N };
                if (2..N - 2).contains(&k) {
                    h[i] = (from[i - 2 * step] + from[i - step] + from[i] + from[i + step] + from[i + 2 * step]) / 5.0;
                }
            }
        }
    }
    h.iter_mut().for_each(|h| *h = if *h < 2e-6 { 0.0 } else { *h });
    h
}

/// Renders the image of a camera: six lamps (two per colour) around the view 9 mm behind the surface, gamma, noise of
/// 1.5 grey levels.
fn render(hand: &Hand, camera: usize, h: &[f32], noise: &mut Noise) -> Arc<TactileImage> {
    let view = &hand.cameras[camera];
    let pad = &hand.pads[view.pad];
    let (dx, dy) = view.pixel_size();
    let surface: Vec<f64> = (0..PIXELS)
        .map(|i| {
            let (x, y) = view.pixel_center(i % N, i / N);
            pad.surface_height(x, y) - f64::from(h[i])
        })
        .collect();
    let lamps: Vec<(usize, Vector3<f64>)> = (0..6)
        .map(|k| {
            let angle = (k as f64 * 60.0 + 20.0).to_radians();
            let at = Vector3::new(
                (0.5 * view.w + 0.004) * angle.cos(),
                view.center_y + (0.5 * view.h + 0.004) * angle.sin(),
                -0.009,
            );
            ((k / 2) % 3, at)
        })
        .collect();
    let mut rgb = vec![0u8; 3 * PIXELS];
    for row in 0..N {
        for column in 0..N {
            let i = row * N + column;
            let (left, right) = (column.saturating_sub(1), (column + 1).min(N - 1));
            let (up, down) = (row.saturating_sub(1), (row + 1).min(N - 1));
            let zx = (surface[row * N + right] - surface[row * N + left]) / ((right - left) as f64 * dx);
            let zy = (surface[up * N + column] - surface[down * N + column]) / ((down - up) as f64 * dy);
            let normal = Vector3::new(zx, zy, -1.0).normalize();
            let (x, y) = view.pixel_center(column, row);
            let point = Vector3::new(x, y, surface[i]);
            let mut light = [0.04f64; 3];
            for (channel, lamp) in &lamps {
                let d = lamp - point;
                light[*channel] += 0.55 * (normal.dot(&d) / d.norm()).max(0.0) * (0.014 / d.norm()).powi(2);
                // Colours leak into each other.
                light[(channel + 1) % 3] += 0.08 * (normal.dot(&d) / d.norm()).max(0.0) * (0.014 / d.norm()).powi(2);
            }
            for channel in 0..3 {
                rgb[3 * i + channel] =
                    (255.0 * light[channel].powf(0.7) + 1.5 * noise.normal()).round().clamp(0.0, 255.0) as u8;
            }
        }
    }
    Arc::new(TactileImage { rgb })
}

fn press(hand: &Hand, camera: usize, r: f64, noise: &mut Noise, background: &Arc<TactileImage>) -> CalibrationPress {
    let view = &hand.cameras[camera];
    let x = (noise.uniform() - 0.5) * 0.6 * view.w;
    let y = view.center_y + (noise.uniform() - 0.5) * 0.7 * view.h;
    let indentation = ball(hand, camera, r, x, y, 0.0004 + 0.0008 * noise.uniform());
    CalibrationPress {
        camera,
        image: render(hand, camera, &indentation, noise),
        background: background.clone(),
        indentation,
    }
}

/// Pads of all six configurations.
const PAD_NAMES: [&str; 6] =
    ["index_distal", "index_middle", "index_proximal", "thumb_metacarpal", "palm_radial", "palm_ulnar"];

/// A hand with all configurations calibrated by presses of two balls, and the images of its untouched pads.
struct Calibrated {
    hand: Hand,
    noise: Noise,
    backgrounds: Vec<Arc<TactileImage>>,
    /// The first camera of each of [`PAD_NAMES`].
    cameras: Vec<usize>,
    calibration: PhotometricCalibration,
}

fn calibrated() -> Calibrated {
    let hand = Hand::ftac();
    let mut noise = Noise(7);
    let level = vec![0.0; PIXELS];
    let backgrounds: Vec<_> = (0..hand.cameras.len()).map(|camera| render(&hand, camera, &level, &mut noise)).collect();
    let cameras: Vec<usize> =
        PAD_NAMES.iter().map(|name| hand.pads[hand.find_pad(name).expect(name)].cameras[0]).collect();
    let mut presses = Vec::new();
    for &camera in &cameras {
        for k in 0..24 {
            presses.push(press(&hand, camera, [0.004, 0.008][k % 2], &mut noise, &backgrounds[camera]));
        }
    }
    let calibration = PhotometricCalibration::fit(&hand, &presses).expect("a fit");
    Calibrated { hand, noise, backgrounds, cameras, calibration }
}

/// Images with the six pads pressed by a ball of known depth, and the true indentation of each.
fn pressed(of: &mut Calibrated) -> (Vec<Arc<TactileImage>>, Vec<Vec<f32>>) {
    let level = vec![0.0; PIXELS];
    let hand = &of.hand;
    let mut images: Vec<_> =
        (0..hand.cameras.len()).map(|camera| render(hand, camera, &level, &mut of.noise)).collect();
    let mut truths = Vec::new();
    for &camera in &of.cameras {
        let truth = ball(hand, camera, 0.007, 0.001, hand.cameras[camera].center_y - 0.003, 0.0009);
        images[camera] = render(hand, camera, &truth, &mut of.noise);
        truths.push(truth);
    }
    (images, truths)
}

#[test]
fn normals_of_unseen_presses_are_right_to_a_few_degrees() {
    let Calibrated { hand, mut noise, backgrounds, cameras, calibration } = calibrated();
    for (name, &camera) in PAD_NAMES.iter().zip(&cameras) {
        let held_out: Vec<_> = (0..4).map(|_| press(&hand, camera, 0.006, &mut noise, &backgrounds[camera])).collect();
        let error = calibration.evaluate(&hand, &held_out).expect("errors");
        println!("{name}: mean {:.2} median {:.2} p95 {:.2} deg", error.mean, error.median, error.p95);
        assert!(error.mean < 4.0, "{name}: {} deg", error.mean);
    }
    let file = std::env::temp_dir().join(format!("touch-calibration-{}.json", std::process::id()));
    calibration.write(&file).expect("written");
    assert_eq!(PhotometricCalibration::read(&file).expect("read"), calibration);
    std::fs::remove_file(&file).expect("removed");
}

#[test]
fn presses_of_known_depth_are_perceived() {
    let mut of = calibrated();
    let (images, truths) = pressed(&mut of);
    let Calibrated { hand, backgrounds, cameras, calibration, .. } = of;
    let pipeline = TouchPipeline::new(&hand, calibration, backgrounds).expect("a pipeline");
    let touches = pipeline.perceive(&images).expect("touches");
    assert_eq!(
        touches.iter().filter(|touch| touch.is_touched()).count(),
        PAD_NAMES.len(),
        "noise must not count as touch"
    );
    for ((name, &camera), truth) in PAD_NAMES.iter().zip(&cameras).zip(&truths) {
        check_touch(&hand, camera, &touches[hand.cameras[camera].pad], truth, name);
    }
    let again = pipeline.perceive(&images).expect("touches");
    assert!(again.iter().zip(&touches).all(|(a, b)| a.patches == b.patches), "deterministic");
}

/// Checks that there is one patch, with height, force and centre near the true ones.
fn check_touch(hand: &Hand, camera: usize, touch: &PadTouch, truth: &[f32], name: &str) {
    let view = &hand.cameras[camera];
    assert_eq!(touch.patches.len(), 1, "{name}");
    let (dx, dy) = view.pixel_size();
    let force = hand.gel().stiffness * truth.iter().map(|h| f64::from(*h)).sum::<f64>() * dx * dy;
    let peak = truth.iter().fold(0.0f32, |a, &b| a.max(b));
    let inside: Vec<usize> = (0..PIXELS).filter(|&i| truth[i] > 0.5 * peak).collect();
    let squares = inside.iter().map(|&i| f64::from(truth[i] - touch.heights[0].height[i]).powi(2)).sum::<f64>();
    let rms = (squares / inside.len() as f64).sqrt();
    let centroid = touch.patches[0].centroid;
    let off = (centroid.x - 0.001).hypot(centroid.y - view.center_y + 0.003);
    assert!(rms < 1.2e-4, "{name}: height off by {rms} m (rms)");
    assert!((touch.force / force - 1.0).abs() < 0.25, "{name}: {} N of {force} N", touch.force);
    assert!(off < 5e-4, "{name}: centroid off by {off} m");
}

/// A dead camera is reported by name and its pad is blind; all other pads are unchanged. A pad without calibration is
/// blind too.
#[test]
fn faults_are_named_and_blind_only_their_own_pad() {
    let mut of = calibrated();
    let (images, _) = pressed(&mut of);
    let Calibrated { hand, backgrounds, cameras, calibration, .. } = of;
    let mut partial = calibration.clone();
    partial.configurations.remove(&'a');
    let partial = TouchPipeline::new(&hand, partial, backgrounds.clone()).expect("a pipeline");
    let pipeline = TouchPipeline::new(&hand, calibration, backgrounds).expect("a pipeline");
    let touches = pipeline.perceive(&images).expect("touches");
    let frame = |(camera, image): (usize, &Arc<TactileImage>)| TactileFrame {
        camera,
        time: 0.0,
        sequence: 3,
        image: image.clone(),
    };
    let mut frames: Vec<TactileFrame> = images.iter().enumerate().map(frame).collect();
    frames[cameras[0]].image = Arc::new(TactileImage { rgb: vec![0; 3 * PIXELS] });
    let seen = pipeline.perceive_frames(&frames, &[]).expect("touches");
    assert_eq!(seen.faults.len(), 1);
    assert!(seen.faults[0].to_string().contains("index_distal: its image is black"), "{}", seen.faults[0]);
    for (now, before) in seen.touches.iter().zip(&touches) {
        let dead = now.pad == hand.cameras[cameras[0]].pad;
        assert_eq!((now.blind, now.is_touched()), (dead, before.is_touched() && !dead));
        assert!(dead && now.contact_free.is_empty() || now.patches == before.patches);
    }
    let seen = partial.perceive_frames(&frames, &[]).expect("touches");
    assert_eq!(
        seen.faults.iter().filter(|fault| fault.fault == tactile_perception::ImageFault::Uncalibrated('a')).count(),
        4
    );
    assert_eq!(seen.touches.iter().filter(|touch| touch.blind).count(), 5);
}
