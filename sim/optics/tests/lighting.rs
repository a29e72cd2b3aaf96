//! Checks that the nominal lighting serves photometric stereo on every pad: bright enough, never saturated, and well
//! conditioned.

use hand_model::Hand;
use nalgebra::{Matrix3x2, Point3};
use tactile_optics::SensorModel;

/// Returns a grid of positions on the pad in a camera's view, pad frame, m.
fn places(camera: &hand_model::pads::PadCamera) -> Vec<Point3<f64>> {
    let place = |k: i32| (f64::from(k) + 0.5) / 11.0 - 0.5;
    (0..121).map(|i| Point3::new(place(i % 11) * camera.w, camera.center_y + place(i / 11) * camera.h, 0.0)).collect()
}

#[test]
fn lighting_serves_photometric_stereo() {
    let hand = Hand::ftac();
    for camera in &hand.cameras {
        let model = SensorModel::nominal(&hand.pads[camera.pad], camera);
        let mut mean = [0.0; 3];
        let (mut least, mut most) = ([255.0f64; 3], [0.0f64; 3]);
        let mut brightest = 0.0f64;
        let (mut weakest, mut worst_ratio) = (f64::INFINITY, 0.0f64);
        for point in places(camera) {
            let flat = model.grey(&point, [0.0; 2]);
            for c in 0..3 {
                mean[c] += flat[c] / 121.0;
                least[c] = least[c].min(flat[c]);
                most[c] = most[c].max(flat[c]);
            }
            for slope in [0.3, 0.6, 1.0] {
                for turn in 0..12 {
                    let angle = f64::from(turn) * std::f64::consts::TAU / 12.0;
                    let grey = model.grey(&point, [slope * angle.cos(), slope * angle.sin()]);
                    brightest = brightest.max(grey[0]).max(grey[1]).max(grey[2]);
                }
            }
            let step = 0.02;
            let d = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|c| (a[c] - b[c]) / (2.0 * step));
            let x = d(model.grey(&point, [step, 0.0]), model.grey(&point, [-step, 0.0]));
            let y = d(model.grey(&point, [0.0, step]), model.grey(&point, [0.0, -step]));
            let jacobian = Matrix3x2::new(x[0], y[0], x[1], y[1], x[2], y[2]);
            let values = jacobian.singular_values();
            weakest = weakest.min(values.min());
            worst_ratio = worst_ratio.max(values.max() / values.min());
        }
        println!(
            "{:22} mean {:?} least {:?} most {:?} brightest at 45 deg {brightest:.0}; grey/slope at least {weakest:.0}, condition {worst_ratio:.1}",
            camera.name,
            mean.map(f64::round),
            least.map(f64::round),
            most.map(f64::round)
        );
        assert!(mean.iter().all(|mean| (100.0..140.0).contains(mean)), "{}: mean {mean:?}", camera.name);
        assert!(
            least.iter().all(|&least| least > 30.0) && most.iter().all(|&most| most < 220.0),
            "{}: {least:?} {most:?}",
            camera.name
        );
        assert!(brightest < 255.0, "{}: {brightest}", camera.name);
        assert!(weakest > 28.0 && worst_ratio < 3.0, "{}: {weakest} {worst_ratio}", camera.name);
    }
}
