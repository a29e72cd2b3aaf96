//! `ftac optics` as a user runs it: its files, and the input that it refuses.

use std::fs;
use std::path::Path;

use e2e::{root, run, stderr};
use tempfile::tempdir;

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

/// Returns a pyramid of this size (OBJ), apex down.
fn pyramid(size: f64) -> String {
    let corners = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [1.0, -1.0, 1.0]];
    let vertices: String =
        corners.iter().map(|[x, y, z]| format!("v {} {} {}\n", x * size, y * size, z * size)).collect();
    format!("{vertices}f 1 2 3\nf 1 3 4\nf 1 4 5\nf 1 5 2\nf 2 4 3\nf 2 5 4\n")
}

#[test]
fn a_mesh_is_rendered_into_all_formats() {
    let folder = tempdir().expect("a folder");
    let (mesh, out) = (folder.path().join("thing.obj"), folder.path().join("image.png"));
    fs::write(&mesh, pyramid(0.01)).expect("written");
    let output = run(&["optics", "render", text(&mesh), "--out", text(&out), "--force", "1", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let size = |ending: &str| fs::metadata(out.with_extension(ending)).map_or(0, |file| file.len());
    for ending in
        ["png", "npy", "exr", "height.png", "height.npy", "height.exr", "normals.png", "normals.npy", "normals.exr"]
    {
        assert!(size(ending) > 1000, "{ending}");
    }
    // Uncompressed floats: header, table and lines.
    assert!((240 * 240 * 12..240 * 240 * 12 + 8192).contains(&(size("normals.exr") as usize)));
}

#[test]
fn a_shipped_calibration_renders_and_another_is_refused() {
    let folder = tempdir().expect("a folder");
    let (mesh, out) = (folder.path().join("thing.obj"), folder.path().join("image.png"));
    fs::write(&mesh, pyramid(0.01)).expect("written");
    let pads = folder.path().join("pads");
    assert_eq!(run(&["optics", "pads", "--out", text(&pads)]).status.code(), Some(0));
    let shipped = root().join("sim/optics/data/pads");
    for entry in fs::read_dir(&pads).expect("files") {
        let path = entry.expect("a file").path();
        let name = path.file_name().expect("a name");
        assert_eq!(fs::read(&path).expect("read"), fs::read(shipped.join(name)).expect("shipped"), "{name:?}");
    }
    let good = pads.join("index_distal.toml");
    let render = |calibration: &Path| {
        run(&["optics", "render", text(&mesh), "--sensor", text(calibration), "--out", text(&out)])
    };
    assert_eq!(render(&good).status.code(), Some(0));
    fs::remove_file(&out).expect("an image");
    let other = folder.path().join("other.toml");
    fs::write(&other, fs::read_to_string(&good).expect("read").replace("version = 1", "version = 9")).expect("written");
    for (path, named) in [(other, "found 9; expected 1"), (pads.join("palm_ulnar.toml"), "palm_ulnar")] {
        let output = render(&path);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(named), "{}", stderr(&output));
        assert!(!out.exists(), "left an image behind");
    }
}

#[test]
fn a_mesh_in_millimetres_is_refused() {
    let folder = tempdir().expect("a folder");
    let (mesh, out) = (folder.path().join("thing.obj"), folder.path().join("image.png"));
    fs::write(&mesh, pyramid(10.0)).expect("written");
    let output = run(&["optics", "render", text(&mesh), "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("millimetres") && stderr(&output).contains("thing.obj"), "{}", stderr(&output));
    assert!(!out.exists(), "left an image behind");
}

#[test]
fn calibration_folders_that_cannot_be_used() {
    let (folder, elsewhere) = (tempdir().expect("a folder"), tempdir().expect("a folder"));
    let out = elsewhere.path().join("made.toml");
    let calibrate = |diameter: &str| {
        let arguments = [
            "optics",
            "calibrate",
            text(folder.path()),
            "--ball-diameter-mm",
            diameter,
            "--pixel-mm",
            "0.03",
            "--out",
            text(&out),
        ];
        let output = run(&arguments);
        assert_eq!(output.status.code(), Some(2));
        assert!(!out.exists(), "left a file behind");
        stderr(&output)
    };
    let no_background = calibrate("4");
    assert!(no_background.contains("background.png"), "{no_background}");
    let no_diameter = calibrate("0");
    assert!(no_diameter.contains("ball diameter"), "{no_diameter}");
}

#[test]
fn calibration_images_that_cannot_be_used_are_told_by_name() {
    let folder = tempdir().expect("a folder");
    let here = |name: &str| folder.path().join(name);
    fs::write(here("thing.obj"), pyramid(0.01)).expect("written");
    // Two images of different sizes.
    let image = here("background.png");
    let render = run(&["optics", "render", text(&here("thing.obj")), "--out", text(&image)]);
    assert_eq!(render.status.code(), Some(0), "{}", stderr(&render));
    for more in ["height.png", "normals.png"] {
        fs::remove_file(image.with_extension(more)).expect("a view");
    }
    let sheet = here("sheet");
    fs::create_dir(&sheet).expect("a folder");
    let sheet = sheet.join("sheet.png");
    assert_eq!(run(&["optics", "shapes", "--out", text(&sheet)]).status.code(), Some(0));
    let elsewhere = tempdir().expect("a folder");
    let out = elsewhere.path().join("made.toml");
    let refused = |named: &[&str]| {
        let arguments = [
            "optics",
            "calibrate",
            text(folder.path()),
            "--ball-diameter-mm",
            "4",
            "--pixel-mm",
            "0.03",
            "--out",
            text(&out),
        ];
        let output = run(&arguments);
        assert_eq!(output.status.code(), Some(2));
        assert!(named.iter().all(|part| stderr(&output).contains(part)), "{}", stderr(&output));
        assert!(!out.exists(), "left a file behind");
    };
    refused(&["no press images"]);
    fs::copy(&sheet, here("press.png")).expect("copied");
    refused(&["press.png", "240 x 240"]);
    fs::copy(&image, here("press.png")).expect("copied");
    refused(&["press.png", "no contact"]);
    fs::write(here("labels.csv"), "file,center_x_px,center_y_px,contact_radius_px\npress.png,120,120,20\n")
        .expect("written");
    fs::create_dir(here("lamps")).expect("a folder");
    fs::copy(&image, here("lamps/red.png")).expect("copied");
    refused(&["lamps", "found 1 images", "at least 2"]);
    fs::copy(&image, here("lamps/blue.png")).expect("copied");
    refused(&["blue.png", "all lamps"]);
    fs::remove_dir_all(here("lamps")).expect("removed");
    fs::create_dir(here("checkerboards")).expect("a folder");
    refused(&["board.toml", "columns"]);
    fs::write(here("checkerboards/board.toml"), "columns = 9\nrows = 6\n").expect("written");
    for name in ["a", "b", "c"] {
        fs::copy(&image, here("checkerboards").join(name).with_extension("png")).expect("copied");
    }
    refused(&["a.png", "9 x 6 inner corners"]);
    fs::write(here("lens.toml"), "").expect("written");
    let (lens, folder) = (here("lens.toml"), folder.path());
    let both = run(&["optics", "calibrate", text(folder), "--ball-diameter-mm", "4", "--lens", text(&lens)]);
    assert!(both.status.code() == Some(2) && stderr(&both).contains("checkerboards"), "{}", stderr(&both));
}

#[test]
fn a_curved_pad_is_pressed_along_its_normals() {
    let folder = tempdir().expect("a folder");
    let (mesh, out) = (folder.path().join("thing.obj"), folder.path().join("image.png"));
    // A plate larger than the pad.
    let plate = "v -0.05 -0.05 0\nv 0.05 -0.05 0\nv 0.05 0.05 0\nv -0.05 0.05 0\n\
                 v -0.05 -0.05 0.01\nv 0.05 -0.05 0.01\nv 0.05 0.05 0.01\nv -0.05 0.05 0.01\n\
                 f 1 3 2\nf 1 4 3\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 2 3 7\nf 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8\n";
    fs::write(&mesh, plate).expect("written");
    let render = |radius: &str| {
        let radius = format!("--cover-radius-mm={radius}");
        run(&["optics", "render", text(&mesh), &radius, "--out", text(&out), "--json"])
    };
    let output = render("20");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let shift = value["shift_mm"].as_f64().expect("a number");
    // The contact stripe is the chord of the cylinder at this depth, except for the rows at the ends, where the cover
    // is rounded off.
    let chord = 2.0 * (2.0 * 20.0 * shift - shift * shift).sqrt();
    let columns = value["cameras"][0]["contact_pixels"].as_f64().expect("a number") / 240.0;
    let found = columns * 20.0 / 240.0;
    assert!(found < chord && found > 0.65 * chord, "{found} mm, chord {chord} mm: {value}");
    fs::remove_file(&out).expect("an image");
    for radius in ["0", "-3", "5"] {
        let output = render(radius);
        assert!(
            output.status.code() == Some(2) && stderr(&output).contains("--cover-radius-mm"),
            "{}",
            stderr(&output)
        );
        assert!(!out.exists(), "left an image behind");
    }
}

#[test]
fn an_edited_pad_is_not_replaced() {
    let folder = tempdir().expect("a folder");
    let pads = folder.path().join("pads");
    let write = ["optics", "pads", "--out", text(&pads)];
    assert_eq!(run(&write).status.code(), Some(0));
    // The same files once more are no loss.
    assert_eq!(run(&write).status.code(), Some(0));
    let edited = pads.join("index_distal.toml");
    let own = fs::read_to_string(&edited).expect("a pad") + "# mine\n";
    fs::write(&edited, &own).expect("written");
    let refused = run(&write);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("index_distal.toml with another content, expected none"), "{}", stderr(&refused));
    assert_eq!(fs::read_to_string(&edited).expect("a pad"), own);
}
