//! Presses objects into a pad of your own under known forces and renders the images of its camera: `cargo run --release -p
//! tactile-optics --example press_own_pad`.
//!
//! The pad is a fingertip of 16 x 20 mm, like that of a DIGIT, under a cylindrical cover of 20 mm radius.

use std::error::Error;

use nalgebra::Isometry3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use tactile_optics::calibration::Photo;
use tactile_optics::hand_model::pads::{IMAGE_SIZE, Pad, PadCamera};
use tactile_optics::hand_model::parameters::Gel;
use tactile_optics::shapes::TEST_SHAPES;
use tactile_optics::{CurvedSensor, PadCover, SensorModel, UnitVariation, press};

fn main() -> Result<(), Box<dyn Error>> {
    // Geometry in metres: a pad with one camera that sees all of it, and a gel of 2 mm.
    let pad = Pad {
        name: "fingertip".into(),
        link: None,
        configuration: 'a',
        link_from_pad: Isometry3::identity(),
        h: 0.020,
        w: 0.016,
        edge_radius: 0.001,
        cameras: vec![0],
    };
    let camera = PadCamera { name: "fingertip".into(), pad: 0, center_y: 0.0, h: pad.h, w: pad.w };
    let gel = Gel { thickness: 2e-3, stiffness: 75e6 };

    // The nominal ring of lamps as built in unit 7; replace lamps and camera by those of your sensor.
    let model = SensorModel::nominal(&pad, &camera).varied(&UnitVariation::default(), 7);
    let sensor = CurvedSensor::new(&pad, &camera, model, PadCover::cylinder(0.020)?, 7)?;

    let folder = std::env::temp_dir().join(format!("tactile-optics-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let mut noise = ChaCha8Rng::seed_from_u64(1);
    for (name, shape) in TEST_SHAPES.iter().filter(|(name, _)| ["sphere", "torus", "hexagon"].contains(name)) {
        for force in [0.5, 2.0] {
            // Forces are balanced on the pad's plane; the cover bends the relief.
            let pressed = press(&pad, &[&camera], &gel, force, shape)?;
            let image = sensor.render(&pressed.maps[0], &mut noise);
            let depth = 1e3 * pressed.maps[0].max_depth();
            println!(
                "{name:8} {:.2} N: {depth:.2} mm deep, {} pixels",
                pressed.force,
                pressed.maps[0].contact_pixels()
            );
            let photo = Photo { width: IMAGE_SIZE, height: IMAGE_SIZE, rgb: image.rgb };
            photo.write(&folder.join(format!("{name}-{force}N.png")))?;
        }
    }
    println!("images: {}", folder.display());
    Ok(())
}
