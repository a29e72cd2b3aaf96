//! Images a second: `cargo bench -p optics`. Idle, a ball and a bumpy shape; with and without cast shadows; one pad and all 17; one
//! and two threads. What is timed starts at an indentation map and ends at an image's bytes. A plain program: means over half a second.

use std::error::Error;
use std::time::Instant;

use hand_model::Hand;
use hand_model::pads::Camera;
use optics::shapes::SHAPES;
use optics::{IndentationMap, Sensor, press};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

/// Seconds that a row is measured for.
const SECONDS: f64 = 0.5;
/// Force on each pad, N.
const FORCE: f64 = 2.0;

fn main() -> Result<(), Box<dyn Error>> {
    let hand = Hand::ftac();
    let first: Vec<(usize, &Camera)> =
        hand.pads.iter().map(|pad| (pad.cameras[0], &hand.cameras[pad.cameras[0]])).collect();
    let sensors: Vec<Sensor> =
        first.iter().map(|(n, camera)| Sensor::unit(&hand.pads[camera.pad], camera, *n as u64)).collect();
    let ball = |x: f64, y: f64| {
        let inside = 0.02f64.powi(2) - x * x - y * y;
        (inside > 0.0).then(|| 0.02 - inside.sqrt())
    };
    let bumpy = SHAPES.iter().find(|(name, _)| *name == "random").ok_or("no such shape")?.1;
    let maps = |shape: &dyn Fn(f64, f64) -> Option<f64>| -> Result<Vec<IndentationMap>, Box<dyn Error>> {
        let one = |(_, camera): &(usize, &Camera)| {
            let moved = |x: f64, y: f64| shape(x, y - camera.center_y);
            Ok(press(&hand.pads[camera.pad], &[camera], &hand.gel(), FORCE, moved)?.maps.remove(0))
        };
        first.iter().map(one).collect()
    };
    let scenes =
        [("idle", vec![IndentationMap::idle(); first.len()]), ("ball", maps(&ball)?), ("bumpy", maps(&bumpy)?)];
    println!(
        "{:6} {:>7} {:>7} {:>8} {:>12} {:>12}",
        "scene", "shadows", "sensors", "threads", "images/s", "ms an image"
    );
    for (name, maps) in &scenes {
        for shadows in [true, false] {
            for count in [1, sensors.len()] {
                for threads in [1, 2] {
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
                    let image = |n: usize| {
                        let (sensor, mut rng) = (&sensors[n], ChaCha8Rng::seed_from_u64(n as u64));
                        if shadows {
                            return sensor.render(&maps[n], &mut rng);
                        }
                        let gel = sensor.model().elastomer.deform(sensor.camera(), &maps[n]);
                        sensor.render_unshadowed(gel.as_ref(), &mut rng)
                    };
                    let started = Instant::now();
                    let mut images = 0;
                    while started.elapsed().as_secs_f64() < SECONDS {
                        let bytes: usize =
                            pool.install(|| (0..count).into_par_iter().map(|n| image(n).rgb.len()).sum());
                        images += usize::from(bytes > 0) * count;
                    }
                    let rate = images as f64 / started.elapsed().as_secs_f64();
                    println!("{name:6} {shadows:>7} {count:>7} {threads:>8} {rate:>12.0} {:>12.3}", 1e3 / rate);
                }
            }
        }
    }
    Ok(())
}
