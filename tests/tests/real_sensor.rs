//! A real sensor as a user brings it: calibrated from presses of a ball, then used. The sensor here is a known one, whose images are
//! rendered from a calibration file written by hand, so that the truth is known.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use e2e::{ftac, run, stderr};
use tempfile::{TempDir, tempdir};

const COLUMNS: usize = 160;
const ROWS: usize = 120;
/// m
const PIXEL: f64 = 0.08e-3;
/// Radius of the ball, m.
const BALL: f64 = 2e-3;
/// Positions (m), directions and colours of the lamps.
const LAMPS: [([f64; 3], [f64; 3], [f64; 3]); 3] = [
    ([12e-3, 1e-3, -6e-3], [-0.894, 0.0, 0.447], [3.0, 0.2, 0.1]),
    ([-7e-3, 11e-3, -7e-3], [0.48, -0.768, 0.424], [0.1, 3.2, 0.3]),
    ([-6e-3, -11e-3, -6e-3], [0.48, -0.768, 0.424], [0.2, 0.3, 3.1]),
];

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

fn unit([x, y, z]: [f64; 3]) -> [f64; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// Aimed at the image's middle.
fn direction(position: [f64; 3]) -> [f64; 3] {
    unit(position.map(|part| -part))
}

/// Grey levels of the untouched gel: diffuse light and three lamps on a level, matt surface; a linear response.
fn flat(column: usize, row: usize) -> [u8; 3] {
    let point = [(column as f64 - 79.5) * PIXEL, (59.5 - row as f64) * PIXEL, 0.0];
    let mut radiance = [0.25; 3];
    for (position, _, color) in LAMPS {
        let to_lamp: [f64; 3] = std::array::from_fn(|k| position[k] - point[k]);
        let square = to_lamp.iter().map(|part| part * part).sum::<f64>();
        let (s, p) = (unit(to_lamp), direction(position));
        let along = -(s[0] * p[0] + s[1] * p[1] + s[2] * p[2]);
        let light = 1e-4 * along / square * -s[2] / std::f64::consts::PI;
        radiance.iter_mut().zip(color).for_each(|(sum, color)| *sum += color * light);
    }
    radiance.map(|part| (255.0 * part).round().clamp(0.0, 255.0) as u8)
}

fn known_sensor(folder: &Path) -> PathBuf {
    let background =
        image::RgbImage::from_fn(COLUMNS as u32, ROWS as u32, |x, y| image::Rgb(flat(x as usize, y as usize)));
    background.save(folder.join("known.background.png")).expect("saved");
    let mut file = format!(
        "version = 1\ncolumns = {COLUMNS}\nrows = {ROWS}\npixel_mm = {}\ncontact_over_visible = 1.0\n\
         background = \"known.background.png\"\n[model]\ngain = [1.0, 1.0, 1.0]\nnoise = 0.0\ntexture = [0.0, 0.0]\n\
         ambient = [0.25, 0.25, 0.25]\n[model.camera]\nposition = [0.0, 0.0, -0.025]\n[model.reflectance]\n\
         albedo = [1.0, 1.0, 1.0]\nroughness = 0.0\n[model.elastomer]\nkernels = [0.3e-3]\ncoating = 0.0\n",
        1e3 * PIXEL
    );
    for _ in 0..3 {
        file += "[[model.response]]\ncoefficients = [1.0, 0.0, 0.0]\n";
    }
    for (position, _, color) in LAMPS {
        let direction = direction(position);
        let _ = writeln!(
            file,
            "[[model.lamps]]\nposition = {position:?}\ndirection = {direction:?}\neta = 1e-4\nmu = 1.0\ncolor = {color:?}\nsize = 2e-3"
        );
    }
    let path = folder.join("known.toml");
    fs::write(&path, file).expect("written");
    path
}

/// A ball as a mesh, m: two poles and rings between them.
fn ball(radius: f64) -> String {
    let (around, down) = (96, 48);
    let mut mesh = format!("v 0 0 {radius}\nv 0 0 {}\n", -radius);
    for j in 1..down {
        for i in 0..around {
            let turn = |k: i32, of: i32| f64::from(k) / f64::from(of) * std::f64::consts::PI;
            let ((sin, cos), (wide, high)) = (turn(2 * i, around).sin_cos(), turn(j, down).sin_cos());
            let _ = writeln!(mesh, "v {} {} {}", radius * wide * cos, radius * wide * sin, radius * high);
        }
    }
    let at = |i: i32, j: i32| match j {
        0 => 1,
        _ if j == down => 2,
        _ => (j - 1) * around + i % around + 3,
    };
    for j in 0..down {
        for i in 0..around {
            // At a pole a side has no length.
            if j + 1 < down {
                let _ = writeln!(mesh, "f {} {} {}", at(i, j), at(i, j + 1), at(i + 1, j + 1));
            }
            if j > 0 {
                let _ = writeln!(mesh, "f {} {} {}", at(i, j), at(i + 1, j + 1), at(i + 1, j));
            }
        }
    }
    mesh
}

/// A prism with three sides along y, an edge down.
fn prism(size: f64) -> String {
    let corners = [[0.0, 0.0], [1.0, 1.0], [-1.0, 1.0]];
    let mut mesh = String::new();
    for y in [-1.0, 1.0] {
        for [x, z] in corners {
            let _ = writeln!(mesh, "v {} {} {}", x * size, y * size, z * size);
        }
    }
    mesh + "f 1 2 3\nf 4 6 5\nf 1 4 5\nf 1 5 2\nf 2 5 6\nf 2 6 3\nf 3 6 4\nf 3 4 1\n"
}

/// Renders what the known sensor sees of a mesh at (x, y) mm, `depth` mm deep.
fn press(sensor: &Path, mesh: &Path, [x, y]: [f64; 2], depth: f64, out: &Path) -> Output {
    let pose = format!("{x},{y},0,0,0");
    let depth = depth.to_string();
    run(&[
        "optics",
        "render",
        text(mesh),
        "--calibration",
        text(sensor),
        "--depth-mm",
        &depth,
        "--pose",
        &pose,
        "--out",
        text(out),
        "--json",
    ])
}

/// A folder of eighteen presses with labels, and the known sensor.
struct Made {
    folder: TempDir,
}

impl Made {
    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

fn made() -> &'static Made {
    static MADE: OnceLock<Made> = OnceLock::new();
    MADE.get_or_init(|| {
        let made = Made { folder: tempdir().expect("a folder") };
        let sensor = known_sensor(made.folder.path());
        fs::write(made.at("ball.obj"), ball(BALL)).expect("written");
        fs::write(made.at("larger.obj"), ball(1.5 * BALL)).expect("written");
        fs::write(made.at("prism.obj"), prism(2e-3)).expect("written");
        fs::create_dir(made.at("presses")).expect("made");
        fs::create_dir(made.at("views")).expect("made");
        let mut labels = "file,center_x_px,center_y_px,contact_radius_px\n".to_owned();
        for n in 0..18 {
            let place = [f64::from(n % 5) * 1.9 - 3.8, f64::from(n / 5) * 1.7 - 2.6];
            let depth = 0.45 + 0.05 * f64::from(n * 7 % 11);
            let (view, name) = (made.at("views").join(format!("{n:02}.png")), format!("{n:02}.png"));
            let output = press(&sensor, &made.at("ball.obj"), place, depth, &view);
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            fs::copy(view, made.at("presses").join(&name)).expect("copied");
            let radius = (BALL * BALL - (BALL - 1e-3 * depth).powi(2)).sqrt() / PIXEL;
            let (column, row) = (79.5 + 1e-3 * place[0] / PIXEL, 59.5 - 1e-3 * place[1] / PIXEL);
            let _ = writeln!(labels, "{name},{column},{row},{radius}");
        }
        fs::write(made.at("presses/labels.csv"), labels).expect("written");
        fs::copy(made.at("known.background.png"), made.at("presses/background.png")).expect("copied");
        let fitted =
            calibrate(&made.at("presses"), &["--ball-diameter-mm", "4", "--pixel-mm", "0.08"], &made.at("fitted.toml"));
        assert_eq!(fitted.status.code(), Some(0), "{}", stderr(&fitted));
        made
    })
}

fn calibrate(folder: &Path, more: &[&str], out: &Path) -> Output {
    run(&[&["optics", "calibrate", text(folder), "--out", text(out), "--json"], more].concat())
}

/// Presses of another ball, deeper and shallower ones, are reconstructed to their known depth with what the first ball taught.
#[test]
fn what_presses_is_reconstructed_to_scale() {
    let made = made();
    let (images, out) = (made.at("to-scale"), made.at("to-scale-found"));
    fs::create_dir(&images).expect("made");
    let depths = [0.4, 0.6, 0.8];
    for depth in depths {
        let view = made.at("views").join(format!("larger-{depth}.png"));
        assert_eq!(
            press(&made.at("known.toml"), &made.at("larger.obj"), [0.6, -0.4], depth, &view).status.code(),
            Some(0)
        );
        fs::copy(view, images.join(format!("{depth}.png"))).expect("copied");
    }
    fs::copy(made.at("known.background.png"), images.join("untouched.png")).expect("copied");
    let sensor = made.at("fitted.toml");
    for method in ["look-up", "network"] {
        let output = run(&[
            "optics",
            "reconstruct",
            text(&images),
            "--sensor",
            text(&sensor),
            "--out",
            text(&out),
            "--method",
            method,
            "--json",
        ]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let rows = found["images"].as_array().expect("rows");
        assert_eq!(rows[3]["touched"], false, "{found}");
        for (depth, row) in depths.iter().zip(rows) {
            let (found, error) =
                (row["depth_mm"].as_f64().expect("a depth"), row["depth_error_mm"].as_f64().expect("an error"));
            assert!((found / depth - 1.0).abs() < 0.4 && error > 0.0, "{method}: {found} mm, {depth} mm: {row}");
        }
    }
    // The height image agrees with the array, and every point of the cloud lies in the gel.
    let height = image::open(out.join("0.6.height.png")).expect("an image").to_luma16();
    let array = fs::read(out.join("0.6.height.npy")).expect("read");
    let values: Vec<f32> = array[array.len() - 4 * COLUMNS * ROWS..]
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes(four.try_into().expect("four bytes")))
        .collect();
    assert!(
        height.pixels().zip(&values).all(|(level, value)| (f32::from(level.0[0]) * 1e-7 - value.max(0.0)).abs() < 1e-7)
    );
    let mask = image::open(out.join("0.6.contact.png")).expect("an image").to_luma8();
    let contact = mask.pixels().filter(|pixel| pixel.0[0] == 255).count();
    let cloud = fs::read(out.join("0.6.ply")).expect("read");
    assert!(String::from_utf8_lossy(&cloud).contains(&format!("element vertex {contact}\n")));
    // The contact of a ball of 6 mm, 0.6 mm deep.
    let area = std::f64::consts::PI * (3.0f64.powi(2) - 2.4f64.powi(2)) / (1e3 * PIXEL).powi(2);
    assert!((contact as f64 / area - 1.0).abs() < 0.4, "{contact} {area}");
}

#[test]
fn images_of_a_live_folder_are_taken_as_they_come() {
    let made = made();
    let (images, out) = (made.at("live"), made.at("live-found"));
    fs::create_dir(&images).expect("made");
    let sensor = made.at("fitted.toml");
    let mut child = ftac(&[
        "optics",
        "reconstruct",
        text(&images),
        "--sensor",
        text(&sensor),
        "--out",
        text(&out),
        "--watch",
        "--quiet",
    ])
    .stdout(std::process::Stdio::null())
    .stderr(std::process::Stdio::null())
    .spawn()
    .expect("started");
    fs::write(images.join("broken.png"), b"no image").expect("written");
    fs::copy(made.at("presses/03.png"), images.join("03.png")).expect("copied");
    let (started, cloud) = (Instant::now(), out.join("03.ply"));
    while !cloud.exists() && started.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(50));
    }
    let running = child.try_wait().expect("asked").is_none();
    child.kill().expect("ended");
    child.wait().expect("gone");
    assert!(cloud.exists() && running, "a broken image ends it");
}

#[test]
fn wrong_images_and_sensors_are_told_by_name() {
    let made = made();
    let images = made.at("wrong");
    fs::create_dir(&images).expect("made");
    let reconstruct = |sensor: &Path| run(&["optics", "reconstruct", text(&images), "--sensor", text(sensor)]);
    let refused = |sensor: &Path, named: &[&str]| {
        let output = reconstruct(sensor);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(named.iter().all(|part| stderr(&output).contains(part)), "{}", stderr(&output));
    };
    let fitted = made.at("fitted.toml");
    refused(&fitted, &["no images"]);
    image::RgbImage::new(20, 10).save(images.join("small.png")).expect("saved");
    refused(&fitted, &["small.png", "20 x 10", "160 x 120"]);
    fs::remove_file(images.join("small.png")).expect("removed");
    image::GrayImage::from_pixel(160, 120, image::Luma([90])).save(images.join("grey.png")).expect("saved");
    refused(&fitted, &["grey.png", "grey image"]);
    // A calibration without what was learned beside it.
    refused(&made.at("known.toml"), &["known.normals.json"]);
    // One bad image among good ones is left out, by name.
    fs::copy(made.at("presses/03.png"), images.join("03.png")).expect("copied");
    let output = reconstruct(&fitted);
    assert!(output.status.code() == Some(1) && stderr(&output).contains("grey.png"), "{}", stderr(&output));
}

#[test]
fn presses_that_cannot_be_are_refused_and_leave_no_file() {
    let made = made();
    let folder = made.at("refused");
    fs::create_dir(&folder).expect("made");
    let restore = || {
        for entry in fs::read_dir(made.at("presses")).expect("read") {
            let path = entry.expect("a file").path();
            fs::copy(&path, folder.join(path.file_name().expect("a name"))).expect("copied");
        }
    };
    let out = made.at("refused.toml");
    let refused = |more: &[&str], named: &[&str]| {
        let output = calibrate(&folder, more, &out);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{:?} {}", output.status, stderr(&output));
        assert!(named.iter().all(|part| stderr(&output).contains(part)), "{named:?}: {}", stderr(&output));
        for ending in ["toml", "background.png", "normals.json"] {
            assert!(!out.with_extension(ending).exists(), "left {ending} behind");
        }
    };
    let good = ["--ball-diameter-mm", "4", "--pixel-mm", "0.08"];
    restore();
    refused(&["--ball-diameter-mm", "4"], &["--pixel-mm", "--ruler", "--field-mm"]);
    refused(&["--ball-diameter-mm", "0.004", "--pixel-mm", "0.08"], &["0.004 mm"]);
    refused(&["--ball-diameter-mm", "20", "--pixel-mm", "0.08"], &["20 mm", "--shallow"]);
    refused(&["--ball-diameter-mm", "4", "--pixel-mm", "0.0008"], &["size of a pixel"]);
    refused(&["--ball-diameter-mm", "2", "--pixel-mm", "0.08"], &[".png", "ball of 2 mm"]);
    refused(&["--ball-diameter-mm", "4", "--ruler", "1,2,3,2,5"], &["--ruler"]);
    // Grey among colours.
    image::open(folder.join("04.png")).expect("read").to_luma8().save(folder.join("04.png")).expect("saved");
    refused(&good, &["04.png", "grey"]);
    restore();
    // Labels outside the image.
    let labels = fs::read_to_string(folder.join("labels.csv")).expect("read");
    fs::write(folder.join("labels.csv"), labels.replacen("00.png,", "00.png,9", 1)).expect("written");
    refused(&good, &["labels.csv", "line 2", "outside"]);
    restore();
    // A prism where a label says that there is a ball.
    let view = made.at("views").join("prism.png");
    assert_eq!(press(&made.at("known.toml"), &made.at("prism.obj"), [0.0, 0.8], 0.8, &view).status.code(), Some(0));
    fs::copy(&view, folder.join("07.png")).expect("copied");
    refused(&good, &["07.png", "expected a ball"]);
    restore();
    // A single press leaves nothing to judge it by.
    for n in 1..18 {
        fs::remove_file(folder.join(format!("{n:02}.png"))).expect("removed");
    }
    refused(&[&good[..], &["--split", "none"]].concat(), &["single press"]);
    restore();
    // Among the presses, the background would be one of them.
    let inside = folder.join("inside.toml");
    let output = calibrate(&folder, &good, &inside);
    assert!(
        output.status.code() == Some(2) && stderr(&output).contains("folder of the presses"),
        "{}",
        stderr(&output)
    );
    assert!(!inside.exists());
}

#[test]
fn a_press_that_bottoms_out_says_so() {
    let made = made();
    let (sensor, mesh, out) = (made.at("known.toml"), made.at("ball.obj"), made.at("views/bottom.png"));
    let render = |gel: &str| {
        run(&[
            "optics",
            "render",
            text(&mesh),
            "--calibration",
            text(&sensor),
            "--depth-mm",
            "0.9",
            "--gel-mm",
            gel,
            "--out",
            text(&out),
            "--json",
        ])
    };
    let output = render("0.5");
    assert!(output.status.code() == Some(1) && stderr(&output).contains("pressed flat"), "{}", stderr(&output));
    let output = render("2");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!((found["deepest_mm"].as_f64().expect("a depth") - 0.9).abs() < 0.02, "{found}");
    assert!(found["render_ms"].as_f64().is_some_and(|ms| ms > 0.0), "{found}");
}
