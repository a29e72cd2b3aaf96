//! `ftac optics reconstruct`: from images, videos and watched folders to heights and points.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use e2e::{ftac, run, stderr};

use super::synthetic_sensor::{COLUMNS, PIXEL_SIZE, ROWS, ball, press, synthetic_sensor, text};

/// Deeper and shallower presses of another ball are reconstructed to their known depth with the calibration from the
/// first ball.
#[test]
fn what_presses_is_reconstructed_to_scale() {
    let made = synthetic_sensor();
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
    // Contact area of a ball of 6 mm at a depth of 0.6 mm.
    let area = std::f64::consts::PI * (3.0f64.powi(2) - 2.4f64.powi(2)) / (1e3 * PIXEL_SIZE).powi(2);
    assert!((contact as f64 / area - 1.0).abs() < 0.4, "{contact} {area}");
}

#[test]
fn images_of_a_live_folder_are_taken_as_they_come() {
    let made = synthetic_sensor();
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
    let made = synthetic_sensor();
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
    // A calibration without the trained models beside it.
    refused(&made.at("known.toml"), &["known.normals.json"]);
    // One bad image among good ones is left out and named.
    fs::copy(made.at("presses/03.png"), images.join("03.png")).expect("copied");
    let output = reconstruct(&fitted);
    assert!(output.status.code() == Some(1) && stderr(&output).contains("grey.png"), "{}", stderr(&output));
}

/// Reconstructs a folder's images with the sensor calibrated from all presses. Returns JSON output and stderr.
fn reconstructed(images: &Path, code: i32) -> (serde_json::Value, String) {
    let sensor = synthetic_sensor().at("fitted.toml");
    let output = run(&["optics", "reconstruct", text(images), "--sensor", text(&sensor), "--json"]);
    assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
    (serde_json::from_slice(&output.stdout).expect("JSON"), stderr(&output))
}

/// A cube's edge is steeper than any press of a ball: either its depth is within three times the stated error, or no
/// error is stated.
#[test]
fn an_edge_steeper_than_the_balls_has_no_narrow_error() {
    let made = synthetic_sensor();
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

/// Encodes a 24-bit BMP file.
fn bitmap(image: &image::RgbImage) -> Vec<u8> {
    let mut bytes = [&b"BM"[..], &[0; 8], &54u32.to_le_bytes(), &40u32.to_le_bytes()].concat();
    bytes.extend([image.width(), image.height(), 24 << 16 | 1].map(u32::to_le_bytes).concat());
    bytes.extend([0; 24]);
    // 160 columns of three bytes need no padding.
    bytes.extend(image.rows().rev().flatten().flat_map(|pixel| [pixel.0[2], pixel.0[1], pixel.0[0]]));
    bytes
}

/// Unusual images: each is either handled or reported.
#[test]
fn images_of_another_kind_are_told() {
    let made = synthetic_sensor();
    let images = made.at("kinds");
    fs::create_dir(&images).expect("made");
    let at = |name: &str| images.join(name);
    let good = image::open(made.at("presses/03.png")).expect("read").to_rgb8();
    fs::write(at("good.bmp"), bitmap(&good)).expect("written");
    fs::write(at("._good.bmp"), b"no image").expect("written");
    // Twelve-bit data in a sixteen-bit file.
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
    // A mirrored image and one far too dark are left out and named.
    image::imageops::flip_horizontal(&good).save(at("mirrored.png")).expect("saved");
    let mut dark = good;
    dark.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|value| value / 3));
    dark.save(at("dark.png")).expect("saved");
    let (_, told) = reconstructed(&images, 1);
    for named in ["2 of 5 images left out", "mirrored.png", "mirrored left to right", "dark.png", "times as bright"] {
        assert!(told.contains(named), "{named}: {told}");
    }
}

/// An MP4 file is decoded by an installed program; if there is none, the error says how to proceed.
#[cfg(unix)]
#[test]
fn a_video_is_read_by_frames_or_the_missing_decoder_is_named() {
    use std::os::unix::fs::PermissionsExt as _;
    let made = synthetic_sensor();
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
