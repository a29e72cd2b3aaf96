//! `ftac optics calibrate`: presses that are fitted, left out, and refused.

use std::fs;
use std::path::Path;

use e2e::stderr;

use super::synthetic_sensor::{calibrate, press, some_presses, synthetic_sensor, text};

const GOOD_ARGS: [&str; 4] = ["--ball-diameter-mm", "4", "--pixel-mm", "0.08"];

/// Checks that a failed calibration names these things and leaves no file behind.
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
    // In the folder of the presses the background image would count as a press.
    let output = calibrate(&folder, &GOOD_ARGS, &folder.join("inside.toml"));
    assert!(
        output.status.code() == Some(2) && stderr(&output).contains("folder of the presses"),
        "{}",
        stderr(&output)
    );
    assert!(!folder.join("inside.toml").exists());
    // Too few presses for an evaluation.
    refused(&some_presses("three", 0..3), 2, &GOOD_ARGS, &["found 3 usable presses of 3", "at least 4"]);
}

/// Six of eighteen presses are wrong, each in its own way: the others calibrate, and each wrong one is named with its
/// fault. The sheet is written even if nothing can be fitted.
#[test]
fn presses_out_of_line_are_left_out_by_name_and_the_others_calibrate() {
    let made = synthetic_sensor();
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
    let output = calibrate(&folder, &[&GOOD_ARGS[..], &["--sheet", text(&sheet)]].concat(), &out);
    let told = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{told}");
    for named in [
        "00.png left out: labels.csv, line 2, center_x_px: found 9",
        "04.png left out: found a grey image; expected colours",
        // The image does not change where the label puts the ball's edge.
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
    // Most labels are wrong: the fault is not in single presses. The sheet shows which.
    let rows: Vec<String> = rows.iter().map(|row| row.replace(".png,", ".png,9")).collect();
    fs::write(at("labels.csv"), rows.join("\n")).expect("written");
    fs::remove_file(&sheet).expect("removed");
    refused(&folder, 2, &[&GOOD_ARGS[..], &["--sheet", text(&sheet)]].concat(), &["00.png"]);
}

/// Images unrelated to the labelled balls: the errors on held-out presses lead to refusal of the calibration.
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
                // A tint whose direction changes from press to press.
                for c in 0..3 {
                    let turn = 0.8 * n as f64 * (c + 1) as f64;
                    let change = 60.0 * (u * turn.cos() + v * turn.sin());
                    pixel.0[c] = (f64::from(pixel.0[c]) + change).clamp(0.0, 255.0) as u8;
                }
            }
        }
        image.save(folder.join(format!("{n:02}.png"))).expect("saved");
    }
    refused(&folder, 1, &GOOD_ARGS, &["held out"]);
}

/// Six presses of one ball suffice to reconstruct held-out presses within a quarter of their depth. The label file may
/// name more.
#[test]
fn six_presses_calibrate() {
    let made = synthetic_sensor();
    let folder = some_presses("six", [0, 3, 6, 9, 12, 16]);
    fs::copy(made.at("presses/labels.csv"), folder.join("labels.csv")).expect("copied");
    let sensor = made.at("six.toml");
    let output = calibrate(&folder, &GOOD_ARGS, &sensor);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    for method in ["look_up", "network"] {
        let accuracy = &found["reconstruction"][method];
        assert_eq!(accuracy["presses"], 6);
        assert!(accuracy["depth_relative"].as_f64().is_some_and(|error| error < 0.25), "{method}: {accuracy}");
    }
}
