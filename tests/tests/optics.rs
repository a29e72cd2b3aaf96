//! `ftac optics` as a user runs it: what it writes, and what it refuses.

use std::fs;
use std::path::Path;

use e2e::{root, run, stderr};
use tempfile::tempdir;

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

/// A pyramid of this size, point down.
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
    // Float, not compressed: header, table and lines.
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
        run(&["optics", "render", text(&mesh), "--calibration", text(calibration), "--out", text(&out)])
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
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("made.toml");
    let calibrate = |diameter: &str| {
        let arguments =
            ["optics", "calibrate", text(folder.path()), "--ball-diameter-mm", diameter, "--out", text(&out)];
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
