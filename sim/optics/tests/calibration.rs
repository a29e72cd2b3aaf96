//! Calibration folders and files, and agreement of the two renderers of a fitted sensor.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::PathBuf;

use hand_model::Hand;
use nalgebra::Point3;
use tactile_optics::SensorModel;
use tactile_optics::calibration::background::estimate_background;
use tactile_optics::calibration::{
    Assumptions, BallFit, BallPress, CalibratedSensor, FitEffort, Lens, Photo, PressFolder, SensorCalibration,
    similarity,
};
use tactile_optics::camera::Pinhole;
use tactile_optics::elastomer::Elastomer;
use tactile_optics::lamps::Lamp;
use tactile_optics::reflectance::Reflectance;

const SIZE: (usize, usize) = (200, 150);
const PIXEL_MM: f64 = 0.08;
const BALL: f64 = 6e-3;

/// Creates an empty folder for one test.
fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("ftac-optics-{}-{name}", std::process::id()));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// Builds a known sensor: red, green and blue lamps around an image of 16 x 12 mm.
fn made() -> CalibratedSensor {
    let hand = Hand::ftac();
    let lamp = |x: f64, y: f64, color| Lamp::aimed(Point3::new(x, y, -6e-3), Point3::origin(), 1e-4, 1.5, color);
    let model = SensorModel {
        gain: [1.0; 3],
        noise: 0.0,
        ambient: [0.15; 3],
        camera: Pinhole { position: Point3::new(0.0, 0.0, -22e-3) },
        reflectance: Reflectance { albedo: [1.0; 3], roughness: 0.3 },
        elastomer: Elastomer { coating: 0.1e-3, ..Elastomer::default() },
        lamps: vec![
            lamp(13e-3, 0.0, [1.2, 0.1, 0.1]),
            lamp(-7e-3, 11e-3, [0.1, 1.2, 0.1]),
            lamp(-7e-3, -11e-3, [0.1, 0.1, 1.2]),
        ],
        ..SensorModel::nominal(&hand.pads[0], &hand.cameras[hand.pads[0].cameras[0]])
    };
    let (columns, rows) = SIZE;
    let file = SensorCalibration {
        version: 1,
        columns,
        rows,
        pixel_mm: PIXEL_MM,
        pixel_interval_mm: None,
        contact_over_visible: 1.0,
        background: String::new(),
        lens: None,
        model,
    };
    let (w, h) = SIZE;
    let grey = |at: usize| {
        let (x, y) = ((at % w) as f64 - 0.5 * (w - 1) as f64, 0.5 * (h - 1) as f64 - (at / w) as f64);
        let point = Point3::new(1e-3 * PIXEL_MM * x, 1e-3 * PIXEL_MM * y, 0.0);
        file.model.grey(&point, [0.0; 2]).map(|grey| grey as f32)
    };
    let background = (0..w * h).flat_map(grey).collect();
    CalibratedSensor::new(file, background).unwrap()
}

/// Writes a folder of presses on the known sensor; returns their circles.
fn write_presses(path: &std::path::Path, labels: bool) -> Vec<([f64; 2], f64)> {
    let sensor = made();
    let nothing = vec![f32::NEG_INFINITY; SIZE.0 * SIZE.1];
    sensor.render(&nothing).unwrap().write(&path.join("background.png")).unwrap();
    let mut marks = Vec::new();
    let mut csv = String::from("file,center_x_px,center_y_px,contact_radius_px\n");
    for (n, (x, y)) in [(60.0, 50.0), (140.0, 52.0), (100.0, 75.0), (62.0, 100.0), (141.0, 98.0), (100.0, 40.0)]
        .into_iter()
        .enumerate()
    {
        let radius = 19.0 + n as f64 % 3.0;
        sensor
            .render(&sensor.ball_penetration([x, y], radius, BALL))
            .unwrap()
            .write(&path.join(format!("{n:02}.png")))
            .unwrap();
        csv += &format!("{n:02}.png,{x},{y},{radius}\n");
        marks.push(([x, y], radius));
    }
    if labels {
        fs::write(path.join("labels.csv"), csv).unwrap();
    }
    marks
}

#[test]
fn fitted_presses_are_rendered_alike_by_the_fit_and_by_the_renderer() {
    let path = folder("fit");
    write_presses(&path, true);
    let all = PressFolder::read(&path, BALL, false).unwrap();
    let (fitted, held_out) = all.even_odd();
    let effort = FitEffort { per_press: 200, starts: 1, steps: [15, 10], split: false };
    let fit = BallFit::new(&fitted, Assumptions::full(Some(1e-3 * PIXEL_MM)), &effort, 1).unwrap();
    let held = fit.evaluate(&held_out).unwrap();
    assert!(held.rendered.crop.psnr > held.floor.crop.psnr + 10.0 && held.rendered.crop.psnr > 32.0, "{held:?}");
    let file = path.join("made.toml");
    SensorCalibration::write(&fit, &file).unwrap();
    let sensor = CalibratedSensor::read(&file).unwrap();
    let mut worst = f64::INFINITY;
    for press in &held_out.presses {
        let (by_fit, by_grid) =
            (fit.render_press(press), sensor.render_ball(press.center, press.radius, press.diameter));
        worst = worst.min(similarity::compare(&by_fit, &by_grid, SIZE.0, 0..SIZE.0, 0..SIZE.1).psnr);
    }
    assert!(worst > 38.0, "{worst} dB between the two");
    // Displaced circles are corrected by the model; labels are left unchanged.
    let mut off = held_out.clone();
    for (n, press) in off.presses.iter_mut().enumerate() {
        press.labelled = n == 0;
        press.center = [press.center[0] + 14.0, press.center[1] - 9.0];
    }
    for (n, (found, truth)) in fit.relocated(&off).presses.iter().zip(&held_out.presses).enumerate() {
        let far = (found.center[0] - truth.center[0]).hypot(found.center[1] - truth.center[1]);
        if n == 0 {
            assert_eq!(found.center, off.presses[0].center);
        } else {
            assert!(far < 1.0 && (found.radius / truth.radius - 1.0).abs() < 0.06, "{far} px, radius {}", found.radius);
        }
    }
    fs::remove_dir_all(&path).unwrap();
}

/// Writes the untouched gel of the known sensor under each of its lamps alone. Each lamp contributes to a channel's
/// diffuse light in proportion to its colour.
fn write_lamps(path: &std::path::Path) {
    let sensor = made();
    let model = sensor.model();
    let (w, h) = SIZE;
    fs::create_dir_all(path).unwrap();
    let all: [f64; 3] = std::array::from_fn(|c| model.lamps.iter().map(|lamp| lamp.color[c]).sum());
    for (k, lamp) in model.lamps.iter().enumerate() {
        let ambient = std::array::from_fn(|c| model.ambient[c] * lamp.color[c] / all[c]);
        let alone = SensorModel { lamps: vec![*lamp], ambient, ..model.clone() };
        let grey = |at: usize| {
            let (x, y) = sensor.pixel_center((at % w) as f64, (at / w) as f64);
            alone.grey(&Point3::new(x, y, 0.0), [0.0; 2]).map(|grey| grey.round().clamp(0.0, 255.0) as u8)
        };
        let photo = Photo { width: w, height: h, rgb: (0..w * h).flat_map(grey).collect() };
        photo.write(&path.join(format!("{k}.png"))).unwrap();
    }
}

#[test]
fn images_of_single_lamps_find_the_lamps_from_a_single_press() {
    let path = folder("lamps");
    write_presses(&path, true);
    write_lamps(&path.join("lamps"));
    let all = PressFolder::read(&path, BALL, false).unwrap();
    assert_eq!(all.lamps.len(), 3);
    let (fitted, held_out) = all.split(|index, _| index == 2);
    let effort = FitEffort { per_press: 200, starts: 1, steps: [15, 10], split: false };
    let assumptions = Assumptions::full(Some(1e-3 * PIXEL_MM));
    let fit = BallFit::new(&fitted, assumptions, &effort, 1).unwrap();
    // Lamps are fitted in the order of their images.
    let sensor = made();
    let off = fit.model.lamps.iter().zip(&sensor.model().lamps).map(|(a, b)| 1e3 * (a.position - b.position).norm());
    let worst = off.fold(0.0, f64::max);
    let psnr = fit.evaluate(&held_out).unwrap().rendered.crop.psnr;
    println!("worst lamp {worst} mm, {psnr} dB");
    assert!(fit.model.lamps.len() == 3 && worst < 1.0 && psnr > 45.0, "{worst} mm, {psnr} dB");
    // An error in such a folder names the file.
    let refusal = |named: &[&str]| {
        let text = PressFolder::read(&path, BALL, false).unwrap_err().to_string();
        assert!(named.iter().all(|part| text.contains(part)), "{text}");
    };
    let blank = |w: usize, grey: u8| Photo { width: w, height: SIZE.1, rgb: vec![grey; 3 * w * SIZE.1] };
    blank(SIZE.0, 250).write(&path.join("lamps/1.png")).unwrap();
    refusal(&["1.png", "mean grey level of 250", "all lamps"]);
    blank(SIZE.0 - 1, 50).write(&path.join("lamps/1.png")).unwrap();
    refusal(&["1.png", "199 x 150", "200 x 150"]);
    fs::remove_file(path.join("lamps/1.png")).unwrap();
    fs::remove_file(path.join("lamps/2.png")).unwrap();
    refusal(&["lamps", "found 1 images", "at least 2"]);
    fs::remove_dir_all(&path).unwrap();
}

#[test]
fn circles_of_made_presses_are_found() {
    let path = folder("circles");
    let marks = write_presses(&path, false);
    let found = PressFolder::read(&path, BALL, false).unwrap();
    for (press, (center, radius)) in found.presses.iter().zip(marks) {
        let off = (press.center[0] - center[0]).hypot(press.center[1] - center[1]);
        assert!(
            !press.labelled && off < 5.0 && (0.75..1.5).contains(&(press.radius / radius)),
            "{off} {}",
            press.radius
        );
    }
    fs::remove_dir_all(&path).unwrap();
}

#[test]
fn bad_folders_are_refused_by_name() {
    let path = folder("bad");
    let refusal = |expected: &[&str]| {
        let text = PressFolder::read(&path, BALL, false).unwrap_err().to_string();
        assert!(expected.iter().all(|part| text.contains(part)), "{text}");
    };
    let photo = |w: usize, h: usize, grey: u8| Photo { width: w, height: h, rgb: vec![grey; 3 * w * h] };
    refusal(&["no background image"]);
    photo(60, 40, 100).write(&path.join("background.png")).unwrap();
    refusal(&["no press images"]);
    photo(60, 41, 100).write(&path.join("a.png")).unwrap();
    refusal(&["a.png", "60 x 41", "60 x 40"]);
    photo(60, 40, 101).write(&path.join("a.png")).unwrap();
    refusal(&["a.png", "no contact found"]);
    fs::write(path.join("labels.csv"), "file,center_x_px,center_y_px\n").unwrap();
    refusal(&["labels.csv", "contact_radius_px"]);
    fs::write(path.join("labels.csv"), "file,center_x_px,center_y_px,contact_radius_px\na.png,1,x,3\n").unwrap();
    refusal(&["labels.csv", "line 2", "center_y_px", "`x`"]);
    fs::write(path.join("labels.csv"), "file,center_x_px,center_y_px,contact_radius_px\nb.png,1,2,3\n").unwrap();
    refusal(&["a.png", "no row"]);
    assert!(PressFolder::read(&path, f64::NAN, false).is_err());
    fs::remove_dir_all(&path).unwrap();
}

#[test]
fn another_version_and_bad_maps_are_refused() {
    let text = SensorCalibration::parse("version = 3\n").unwrap_err().to_string();
    assert!(text.contains("found 3") && text.contains("expected 1"), "{text}");
    assert!(SensorCalibration::parse("columns = 3\n").unwrap_err().to_string().contains("version: found none"));
    let sensor = made();
    let mut map = vec![0.0f32; SIZE.0 * SIZE.1];
    assert!(sensor.render(&map[1..]).unwrap_err().to_string().contains("expected 30000"));
    map[203] = f32::NAN;
    assert!(sensor.render(&map).unwrap_err().to_string().contains("column 3, row 1"));
}

#[test]
fn raw_presses_are_rectified_and_a_calibration_renders_raw() {
    let path = folder("lens");
    let marks = write_presses(&path, true);
    let lens = Lens { focal: [190.0, 190.0], center: [99.5, 74.5], radial: [-0.15, 0.02, 0.0], tangential: [0.0; 2] };
    // The images as distorted by the lens.
    let mut csv = String::from("file,center_x_px,center_y_px,contact_radius_px\n");
    for entry in fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.extension().is_some_and(|extension| extension == "png") {
            lens.distort(&Photo::read(&entry).unwrap()).write(&entry).unwrap();
        }
    }
    for (n, (center, radius)) in marks.iter().enumerate() {
        let [x, y] = lens.distort_point(*center);
        csv += &format!("{n:02}.png,{x},{y},{radius}\n");
    }
    fs::write(path.join("labels.csv"), csv).unwrap();
    let raw = PressFolder::read(&path, BALL, false).unwrap();
    let rectified = raw.rectified(&lens).unwrap();
    let sensor = made();
    let single = |photo: &Photo| photo.rgb.iter().map(|&grey| f32::from(grey)).collect::<Vec<f32>>();
    for ((press, raw), (center, radius)) in rectified.presses.iter().zip(&raw.presses).zip(&marks) {
        assert!((press.center[0] - center[0]).hypot(press.center[1] - center[1]) < 1e-3);
        let truth = sensor.render(&sensor.ball_penetration(*center, *radius, BALL)).unwrap();
        let psnr = |photo: &Photo| {
            similarity::compare(&single(photo), &single(&truth), SIZE.0, 30..SIZE.0 - 30, 25..SIZE.1 - 25).psnr
        };
        assert!(psnr(&press.photo) > psnr(&raw.photo) + 6.0, "{} {}", psnr(&press.photo), psnr(&raw.photo));
    }
    let folded = Lens { radial: [-3.0, 0.0, 0.0], ..lens };
    assert!(raw.rectified(&folded).unwrap_err().to_string().contains("lens.radial"));
    fs::remove_dir_all(&path).unwrap();
}

/// Frames of a gel whose lamps drift by up to 15 %, unevenly, each with a press at a different position: the estimated
/// background has no edges where the set of presses changes.
#[test]
fn drift_leaves_no_edges() {
    let (width, height) = (160, 120);
    let gel = |x: f64, y: f64, c: usize| 90.0 + 40.0 * (0.02 * x + 1.3 * c as f64).sin() + 0.2 * y;
    let gain =
        |n: usize, x: f64| 1.0 + 0.15 * (2.1 * n as f64).sin() + 0.05 * (1.7 * n as f64).cos() * (x / 80.0 - 1.0);
    let photo = |shown: &dyn Fn(f64, f64, usize) -> f64| {
        let at = |i: usize| (((i / 3) % width) as f64, (i / 3 / width) as f64, i % 3);
        let value = |i: usize| {
            let (x, y, c) = at(i);
            shown(x, y, c).round().clamp(0.0, 255.0) as u8
        };
        Photo { width, height, rgb: (0..3 * width * height).map(value).collect() }
    };
    let presses = (0..16).map(|n| {
        let center = [30.0 + 25.0 * (n % 4) as f64, 25.0 + 22.0 * (n / 4) as f64];
        let shown = |x: f64, y: f64, c: usize| {
            let pressed = (x - center[0]).hypot(y - center[1]) < 12.0;
            gain(n, x) * gel(x, y, c) + if pressed { 40.0 } else { 0.0 }
        };
        BallPress {
            name: format!("{n}.png"),
            photo: photo(&shown),
            center,
            radius: 12.0,
            diameter: 4e-3,
            labelled: true,
            contact_labelled: true,
        }
    });
    let folder = PressFolder {
        background: photo(&gel),
        presses: presses.collect(),
        lamps: Vec::new(),
        skipped: Vec::new(),
        depth: None,
    };
    let found = estimate_background(&folder);
    let mean = |x: f64| (0..16).map(|n| gain(n, x)).sum::<f64>() / 16.0;
    for (i, found) in found.iter().enumerate() {
        let (x, y, c) = (((i / 3) % width) as f64, (i / 3 / width) as f64, i % 3);
        let off = f64::from(*found) - mean(x) * gel(x, y, c);
        assert!(off.abs() < 1.5, "({x}, {y}, {c}): {off}");
    }
}

proptest::proptest! {
    /// Any modified text of a calibration is either refused or renders numbers.
    #[test]
    fn no_calibration_panics(places in proptest::collection::vec((0usize..4000, 0usize..12), 1..6)) {
        let text = toml::to_string(made().calibration()).expect("a calibration");
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        for (place, what) in places {
            let at = place % lines.len();
            let line = &mut lines[at];
            match what {
                0 => line.clear(),
                1 => *line = line.replace("0.", "-0."),
                2 => *line = line.replace('1', "nan"),
                3 => *line = line.replace('1', "inf"),
                4 => *line = line.replace("0.", "1e308"),
                5 => *line = line.replace("0.0", "1e9"),
                6 => *line = line.replace('=', "= []#"),
                7 => line.truncate(place % (line.len() + 1)),
                8 => *line = line.replace(']', ""),
                9 => *line = line.replace("0.", "0.00000000"),
                10 => *line = format!("{line}{line}"),
                _ => line.push('\u{0}'),
            }
        }
        if let Ok(file) = SensorCalibration::parse(&lines.join("\n"))
            && file.columns.checked_mul(file.rows).is_some_and(|pixels| pixels <= 40_000)
        {
            let (columns, rows) = (file.columns, file.rows);
            let sensor = CalibratedSensor::new(file, vec![100.0; 3 * columns * rows]).expect("its size");
            let below: Vec<f32> = (0..columns * rows).map(|at| if at % 7 == 0 { 1e-4 } else { f32::NEG_INFINITY }).collect();
            let photo = sensor.render(&below).expect("rendered");
            proptest::prop_assert_eq!(photo.rgb.len(), 3 * columns * rows);
        }
    }

    /// Any modified bytes of an image are either refused or give an image with a size.
    #[test]
    fn no_image_panics(changes in proptest::collection::vec((0usize..100_000, 0u8..=255), 0..12), cut in 0usize..3000) {
        use std::hash::{DefaultHasher, Hash as _, Hasher as _};
        let photo = Photo { width: 20, height: 10, rgb: (0..600).map(|i| (i * 7 % 251) as u8).collect() };
        let mut hasher = DefaultHasher::new();
        (&changes, cut, std::process::id()).hash(&mut hasher);
        let path = std::env::temp_dir().join(format!("ftac-image-{:x}.png", hasher.finish()));
        photo.write(&path).expect("written");
        let mut bytes = std::fs::read(&path).expect("read");
        for (place, value) in changes {
            let at = place % bytes.len();
            bytes[at] = value;
        }
        bytes.truncate(cut.max(1));
        std::fs::write(&path, &bytes).expect("written");
        if let Ok(found) = Photo::read(&path) {
            proptest::prop_assert_eq!(found.rgb.len(), 3 * found.width * found.height);
        }
        std::fs::remove_file(&path).expect("removed");
    }
}
