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
        "--sensor",
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

/// Copies the made presses `which`, with their labels, into a folder of their own.
fn some_presses(name: &str, which: impl IntoIterator<Item = usize>) -> PathBuf {
    let (made, folder) = (made(), made().at(name));
    fs::create_dir(&folder).expect("made");
    fs::copy(made.at("presses").join("background.png"), folder.join("background.png")).expect("copied");
    let labels = fs::read_to_string(made.at("presses").join("labels.csv")).expect("read");
    let mut rows: Vec<&str> = labels.lines().take(1).collect();
    for n in which {
        let image = format!("{n:02}.png");
        fs::copy(made.at("presses").join(&image), folder.join(&image)).expect("copied");
        rows.extend(labels.lines().filter(|row| row.starts_with(&format!("{image},"))));
    }
    fs::write(folder.join("labels.csv"), rows.join("\n")).expect("written");
    folder
}

const GOOD: [&str; 4] = ["--ball-diameter-mm", "4", "--pixel-mm", "0.08"];

/// A calibration that ends in vain names these things and leaves no file behind.
fn refused(folder: &Path, code: i32, more: &[&str], named: &[&str]) {
    let out = folder.with_extension("toml");
    let output = calibrate(folder, more, &out);
    assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
    assert!(named.iter().all(|part| stderr(&output).contains(part)), "{named:?}: {}", stderr(&output));
    for ending in ["toml", "background.png", "normals.json"] {
        assert!(!out.with_extension(ending).exists(), "left {ending} behind");
    }
}

#[test]
fn presses_that_cannot_be_are_refused_and_leave_no_file() {
    let folder = some_presses("refused", 0..18);
    refused(&folder, 2, &["--ball-diameter-mm", "4"], &["--pixel-mm", "--ruler", "--field-mm"]);
    refused(&folder, 2, &["--ball-diameter-mm", "0.004", "--pixel-mm", "0.08"], &["0.004 mm"]);
    refused(&folder, 2, &["--ball-diameter-mm", "20", "--pixel-mm", "0.08"], &["20 mm", "--shallow"]);
    refused(&folder, 2, &["--ball-diameter-mm", "4", "--pixel-mm", "0.0008"], &["size of a pixel"]);
    refused(&folder, 2, &["--ball-diameter-mm", "2", "--pixel-mm", "0.08"], &[".png", "ball of 2 mm"]);
    refused(&folder, 2, &["--ball-diameter-mm", "4", "--ruler", "1,2,3,2,5"], &["--ruler"]);
    // Among the presses, the background would be one of them.
    let output = calibrate(&folder, &GOOD, &folder.join("inside.toml"));
    assert!(
        output.status.code() == Some(2) && stderr(&output).contains("folder of the presses"),
        "{}",
        stderr(&output)
    );
    assert!(!folder.join("inside.toml").exists());
    // Too few presses to judge by.
    refused(&some_presses("three", 0..3), 2, &GOOD, &["found 3 presses", "at least 4"]);
}

/// Six of eighteen presses are wrong, each in a way of its own: the others calibrate, and each is named with its own fault. The sheet
/// is there even where nothing can be fitted.
#[test]
fn presses_out_of_line_are_left_out_by_name_and_the_others_calibrate() {
    let made = made();
    let folder = some_presses("out-of-line", 0..18);
    let at = |name: &str| folder.join(name);
    image::open(at("04.png")).expect("read").to_luma8().save(at("04.png")).expect("saved");
    image::imageops::flip_horizontal(&image::open(at("13.png")).expect("read")).save(at("13.png")).expect("saved");
    image::RgbImage::new(80, 60).save(at("10.png")).expect("saved");
    let view = made.at("views").join("prism.png");
    assert_eq!(press(&made.at("known.toml"), &made.at("prism.obj"), [0.0, 0.8], 0.8, &view).status.code(), Some(0));
    fs::copy(&view, at("07.png")).expect("copied");
    let rows = fs::read_to_string(at("labels.csv")).expect("read");
    let mut rows: Vec<String> = rows.lines().map(str::to_owned).collect();
    rows[1] = rows[1].replacen("00.png,", "00.png,9", 1);
    let moved: Vec<&str> = rows[17].split(',').collect();
    rows[17] = format!("{},30,100,{}", moved[0], moved[3]);
    rows.push("99.png,50,50,12".to_owned());
    fs::write(at("labels.csv"), rows.join("\n")).expect("written");
    for sidecar in ["._03.png", ".DS_Store", "Thumbs.db"] {
        fs::write(at(sidecar), b"no image").expect("written");
    }
    let (out, sheet) = (made.at("in-line.toml"), made.at("in-line.png"));
    let output = calibrate(&folder, &[&GOOD[..], &["--sheet", text(&sheet)]].concat(), &out);
    let told = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{told}");
    for named in [
        "00.png left out: labels.csv, line 2, center_x_px: found 9",
        "04.png left out: found a grey image; expected colours",
        // An edge is not where a ball's label says that the image changes.
        "07.png left out: found ",
        "10.png left out: found 80 x 60 pixels; expected the background's 160 x 120",
        "13.png left out: found an image that looks mirrored left to right",
        "16.png left out: found a label at column 30, row 100; expected",
        "99.png left out: labels.csv, line 20: found no image",
    ] {
        assert!(told.contains(named), "{named}: {told}");
    }
    assert!(!told.contains("._03") && out.exists() && image::open(&sheet).is_ok(), "{told}");
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(found["presses"]["fitted"], 12, "{found}");
    // Most labels wrong: more is out of line than single presses. The sheet shows which.
    let rows: Vec<String> = rows.iter().map(|row| row.replace(".png,", ".png,9")).collect();
    fs::write(at("labels.csv"), rows.join("\n")).expect("written");
    fs::remove_file(&sheet).expect("removed");
    refused(&folder, 2, &[&GOOD[..], &["--sheet", text(&sheet)]].concat(), &["00.png"]);
}

/// Images that have nothing to do with the balls that the labels name: figures of presses held out refuse the calibration.
#[test]
fn a_calibration_no_better_than_doing_nothing_is_refused() {
    let folder = some_presses("useless", 0..8);
    let background = image::open(folder.join("background.png")).expect("read").to_rgb8();
    let labels = fs::read_to_string(folder.join("labels.csv")).expect("read");
    for (n, row) in labels.lines().skip(1).take(8).enumerate() {
        let cells: Vec<f64> = row.split(',').skip(1).map(|cell| cell.parse().expect("a number")).collect();
        let mut image = background.clone();
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            let (u, v) = ((f64::from(x) - cells[0]) / cells[2], (f64::from(y) - cells[1]) / cells[2]);
            if u.hypot(v) < 1.0 {
                // A tint that turns from press to press.
                for c in 0..3 {
                    let turn = 0.8 * n as f64 * (c + 1) as f64;
                    let change = 60.0 * (u * turn.cos() + v * turn.sin());
                    pixel.0[c] = (f64::from(pixel.0[c]) + change).clamp(0.0, 255.0) as u8;
                }
            }
        }
        image.save(folder.join(format!("{n:02}.png"))).expect("saved");
    }
    refused(&folder, 1, &GOOD, &["held out"]);
}

/// Six presses of one ball suffice for presses held out to be found within a quarter of their depth. The label file may name more.
#[test]
fn six_presses_calibrate() {
    let made = made();
    let folder = some_presses("six", [0, 3, 6, 9, 12, 16]);
    fs::copy(made.at("presses/labels.csv"), folder.join("labels.csv")).expect("copied");
    let sensor = made.at("six.toml");
    let output = calibrate(&folder, &GOOD, &sensor);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    for method in ["look_up", "network"] {
        let accuracy = &found["reconstruction"][method];
        assert_eq!(accuracy["presses"], 6);
        assert!(accuracy["depth_relative"].as_f64().is_some_and(|error| error < 0.25), "{method}: {accuracy}");
    }
}

/// Reconstructs a folder's images with the sensor that all presses calibrated: the rows, by image.
fn reconstructed(images: &Path, code: i32) -> (serde_json::Value, String) {
    let sensor = made().at("fitted.toml");
    let output = run(&["optics", "reconstruct", text(images), "--sensor", text(&sensor), "--json"]);
    assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
    (serde_json::from_slice(&output.stdout).expect("JSON"), stderr(&output))
}

/// A cube's edge is steeper than any ball's press: either its depth is right within thrice the error that is told, or none is told.
#[test]
fn an_edge_steeper_than_the_balls_has_no_narrow_error() {
    let made = made();
    let images = made.at("edges");
    fs::create_dir(&images).expect("made");
    let depths = [0.5, 0.8, 1.0];
    for depth in depths {
        let view = made.at("views").join(format!("edge-{depth}.png"));
        let pressed = press(&made.at("known.toml"), &made.at("prism.obj"), [0.3, 0.2], depth, &view);
        assert_eq!(pressed.status.code(), Some(0), "{}", stderr(&pressed));
        fs::copy(view, images.join(format!("{depth}.png"))).expect("copied");
    }
    let (found, _) = reconstructed(&images, 0);
    for row in found["images"].as_array().expect("rows") {
        let depth: f64 = row["image"].as_str().and_then(|name| name.parse().ok()).expect("a depth");
        let told = row["depth_mm"].as_f64().expect("a depth");
        let error = row["depth_error_mm"].as_f64();
        println!("{depth} mm: {row}");
        assert!(error.is_none_or(|error| (told - depth).abs() < 3.0 * error), "{row}");
        assert!(error.is_some() || row["notes"].to_string().contains("no press of the calibration"), "{row}");
    }
}

/// A BMP file of 24 bits.
fn bitmap(image: &image::RgbImage) -> Vec<u8> {
    let mut bytes = [&b"BM"[..], &[0; 8], &54u32.to_le_bytes(), &40u32.to_le_bytes()].concat();
    bytes.extend([image.width(), image.height(), 24 << 16 | 1].map(u32::to_le_bytes).concat());
    bytes.extend([0; 24]);
    // 160 columns of three bytes need no padding.
    bytes.extend(image.rows().rev().flatten().flat_map(|pixel| [pixel.0[2], pixel.0[1], pixel.0[0]]));
    bytes
}

/// Images of another kind: each is told, or handled.
#[test]
fn images_of_another_kind_are_told() {
    let made = made();
    let images = made.at("kinds");
    fs::create_dir(&images).expect("made");
    let at = |name: &str| images.join(name);
    let good = image::open(made.at("presses/03.png")).expect("read").to_rgb8();
    fs::write(at("good.bmp"), bitmap(&good)).expect("written");
    fs::write(at("._good.bmp"), b"no image").expect("written");
    // Twelve bits in a file of sixteen.
    let deep = good.pixels().flat_map(|pixel| pixel.0.map(|value| u16::from(value) * 16 + 8)).collect();
    let deep = image::ImageBuffer::<image::Rgb<u16>, Vec<u16>>::from_raw(COLUMNS as u32, ROWS as u32, deep);
    deep.expect("an image").save(at("deep.png")).expect("saved");
    // A ball so large that it covers the image.
    fs::write(made.at("huge.obj"), ball(30e-3)).expect("written");
    let view = made.at("views").join("huge.png");
    let pressed = press(&made.at("known.toml"), &made.at("huge.obj"), [0.0, 0.0], 1.3, &view);
    assert_eq!(pressed.status.code(), Some(0), "{}", stderr(&pressed));
    fs::copy(view, at("whole.png")).expect("copied");
    let (found, told) = reconstructed(&images, 0);
    let row =
        |name: &str| found["images"].as_array().expect("rows").iter().find(|row| row["image"] == name).expect(name);
    let depth = |name: &str| row(name)["depth_mm"].as_f64();
    let good_depth = depth("good").expect("a depth");
    assert!(depth("deep").is_some_and(|depth| (depth / good_depth - 1.0).abs() < 0.05), "{found}");
    assert!(told.contains("12-bit data"), "{told}");
    assert!(depth("whole").is_none() && row("whole")["notes"].to_string().contains("no untouched gel"), "{found}");
    // Mirrored, and far too dark: left out by name.
    image::imageops::flip_horizontal(&good).save(at("mirrored.png")).expect("saved");
    let mut dark = good;
    dark.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|value| value / 3));
    dark.save(at("dark.png")).expect("saved");
    let (_, told) = reconstructed(&images, 1);
    for named in ["2 of 5 images left out", "mirrored.png", "mirrored left to right", "dark.png", "times as bright"] {
        assert!(told.contains(named), "{named}: {told}");
    }
}

/// An MP4 file is decoded by a program of the computer's; where there is none, the error says how to go on.
#[cfg(unix)]
#[test]
fn a_video_is_read_by_frames_or_the_missing_decoder_is_named() {
    use std::os::unix::fs::PermissionsExt as _;
    let made = made();
    let programs = made.at("programs");
    fs::create_dir(&programs).expect("made");
    let video = made.at("press.mp4");
    fs::write(&video, b"stands for a film").expect("written");
    let reconstruct = || {
        let arguments = ["optics", "reconstruct", text(&video), "--sensor"];
        let sensor = made.at("fitted.toml");
        let mut command = ftac(&[&arguments[..], &[text(&sensor), "--json"]].concat());
        command.env("PATH", &programs).output().expect("started")
    };
    let output = reconstruct();
    assert_eq!(output.status.code(), Some(2));
    for named in ["press.mp4", "ffmpeg", "install"] {
        assert!(stderr(&output).contains(named), "{}", stderr(&output));
    }
    // A decoder that shows an untouched gel and then a press.
    let mut frames = Vec::new();
    for name in ["background", "03"] {
        let image = image::open(made.at("presses").join(name).with_extension("png")).expect("read").to_rgb8();
        frames.extend(format!("P6\n{COLUMNS} {ROWS}\n255\n").into_bytes());
        frames.extend(image.into_raw());
    }
    fs::write(made.at("frames.ppm"), frames).expect("written");
    let decoder = programs.join("ffmpeg");
    fs::write(&decoder, format!("#!/bin/sh\nexec /bin/cat '{}'\n", text(&made.at("frames.ppm")))).expect("written");
    fs::set_permissions(&decoder, fs::Permissions::from_mode(0o755)).expect("set");
    let output = reconstruct();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let touched: Vec<_> = found["images"].as_array().expect("rows").iter().map(|row| &row["touched"]).collect();
    assert_eq!((touched[0], touched[1]), (&serde_json::json!(false), &serde_json::json!(true)), "{found}");
    // A decoder that fails says why.
    fs::write(&decoder, "#!/bin/sh\necho 'moov atom not found' >&2\nexit 1\n").expect("written");
    let output = reconstruct();
    assert!(output.status.code() == Some(2) && stderr(&output).contains("moov atom not found"), "{}", stderr(&output));
}

#[test]
fn the_former_name_of_the_sensors_option_is_taken_with_a_notice() {
    let made = made();
    let (sensor, mesh, out) = (made.at("known.toml"), made.at("ball.obj"), made.at("views/former.png"));
    let output = run(&[
        "optics",
        "render",
        text(&mesh),
        "--calibration",
        text(&sensor),
        "--depth-mm",
        "0.5",
        "--out",
        text(&out),
        "--json",
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("--calibration is now called --sensor"), "{}", stderr(&output));
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
            "--sensor",
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
