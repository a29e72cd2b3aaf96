//! Presses a ball, a box and a cylinder into several pads and writes the images as one PNG sheet: `cargo run --release
//! -p optics --example press -- sheet.png`. Also prints the time per image.

use std::error::Error;
use std::time::Instant;

use hand_model::Hand;
use hand_model::pads::{IMAGE_SIZE, PadCamera};
use hand_model::robot::TactileImage;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use tactile_optics::{IndentationMap, Sensor, press};

const PADS: [&str; 5] = ["index_distal", "middle_middle", "thumb_metacarpal", "palm_radial", "palm_ulnar"];

fn ball(x: f64, y: f64) -> Option<f64> {
    let inside = 0.021f64.powi(2) - x * x - y * y;
    (inside > 0.0).then(|| 0.021 - inside.sqrt())
}

/// Returns the height (m) of the corner region of a box, rotated and tilted.
fn cuboid(x: f64, y: f64) -> Option<f64> {
    let (sin, cos) = 0.4f64.sin_cos();
    let (u, v) = (cos * x + sin * y, cos * y - sin * x);
    (u.abs() < 0.004 && v.abs() < 0.007).then_some(0.04 * u)
}

/// Returns the height (m) of a rod across the pad.
fn cylinder(x: f64, y: f64) -> Option<f64> {
    let across = 0.96 * y - 0.28 * x;
    let inside = 0.006f64.powi(2) - across * across;
    (inside > 0.0).then(|| 0.006 - inside.sqrt())
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: press SHEET.png")?;
    let hand = Hand::ftac();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let shapes: [fn(f64, f64) -> Option<f64>; 3] = [ball, cuboid, cylinder];
    let size = IMAGE_SIZE as u32;
    let mut sheet = image::RgbImage::new(PADS.len() as u32 * (size + 4), 5 * (size + 4));
    for (column, name) in PADS.iter().enumerate() {
        let pad = hand.pads.iter().find(|pad| pad.name == *name).ok_or("no such pad")?;
        let cameras: Vec<&PadCamera> = pad.cameras.iter().map(|&index| &hand.cameras[index]).collect();
        let started = Instant::now();
        let sensor = Sensor::unit(pad, cameras[0], column as u64);
        println!("{name}: sensor built in {:.1} ms", 1e3 * started.elapsed().as_secs_f64());
        let mut images = vec![sensor.render(&IndentationMap::idle(), &mut rng)];
        for shape in shapes {
            let pressed = press(pad, &cameras, &hand.parameters.gel, 3.0, shape)?;
            images.push(sensor.render(&pressed.maps[0], &mut rng));
        }
        let off_middle = press(pad, &cameras, &hand.parameters.gel, 3.0, |x, y| ball(x - 0.006, y - 0.010))?;
        images.push(sensor.render(&off_middle.maps[0], &mut rng));
        for (row, TactileImage { rgb }) in images.into_iter().enumerate() {
            let picture = image::RgbImage::from_raw(size, size, rgb).ok_or("an image of the wrong size")?;
            image::imageops::replace(
                &mut sheet,
                &picture,
                (column as u32 * (size + 4)).into(),
                (row as u32 * (size + 4)).into(),
            );
        }
        for force in [0.5, 3.0] {
            let time = |work: &mut dyn FnMut()| {
                let started = Instant::now();
                (0..100).for_each(|_| work());
                10.0 * started.elapsed().as_secs_f64()
            };
            let pressed = press(pad, &cameras, &hand.parameters.gel, force, ball)?;
            let idle = time(&mut || drop(sensor.render(&IndentationMap::idle(), &mut rng)));
            let gel = time(&mut || drop(sensor.model().elastomer.deform(sensor.camera(), &pressed.maps[0])));
            let render = time(&mut || drop(sensor.render(&pressed.maps[0], &mut rng)));
            let pressing = time(&mut || drop(press(pad, &cameras, &hand.parameters.gel, force, ball)));
            println!(
                "  {force} N: press {pressing:.2} ms, render {render:.2} ms (of it gel {gel:.2}), idle {idle:.3} ms"
            );
        }
    }
    sheet.save(path)?;
    Ok(())
}
