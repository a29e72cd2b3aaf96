//! Pictures and films without a display: `ftac hand picture`, `ftac demo`.

use std::fs;
use std::path::Path;

use e2e::{ftac, stderr};
use tempfile::tempdir;

#[test]
fn the_hand_is_drawn_in_any_posture() {
    let folder = tempdir().expect("a folder");
    let draw = |name: &str, pose: &str| {
        let file = folder.path().join(name);
        let path = file.to_str().expect("UTF-8");
        let output = ftac(&[
            "hand",
            "picture",
            "--pose",
            pose,
            "--view",
            "palm,back",
            "--size",
            "128",
            "--plain",
            "--out",
            path,
        ])
        .output()
        .expect("runs");
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        image::open(&file).expect("a picture").to_rgb8()
    };
    let (open, fist) = (draw("open.png", "open"), draw("fist.png", "85"));
    assert_eq!((open.width(), open.height()), (256, 128));
    // Width and height of what is drawn in the first view, pixels.
    let extent = |image: &image::RgbImage| -> [u32; 2] {
        let drawn = || image.enumerate_pixels().filter(|(x, _, pixel)| *x < 128 && pixel.0[0] < 240);
        let span = |low: Option<u32>, high: Option<u32>| high.expect("a hand") - low.expect("a hand");
        [
            span(drawn().map(|(x, ..)| x).min(), drawn().map(|(x, ..)| x).max()),
            span(drawn().map(|(_, y, _)| y).min(), drawn().map(|(_, y, _)| y).max()),
        ]
    };
    // Every posture fills its picture; stretched fingers make it the higher one.
    for image in [&open, &fist] {
        let [width, height] = extent(image);
        assert!((104..=118).contains(&width.max(height)), "{width} {height}");
    }
    let slimness = |image: &image::RgbImage| f64::from(extent(image)[1]) / f64::from(extent(image)[0]);
    assert!(slimness(&open) > 1.08 * slimness(&fist), "{} {}", slimness(&open), slimness(&fist));
    let wrong = ftac(&["hand", "picture", "--pose", "claw", "--out", "x.png"]).output().expect("runs");
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("--pose: found `claw`"), "{}", stderr(&wrong));
}

/// Checks the folder of a demo without a viewer: a page that needs nothing else, a film, pictures and recordings.
pub(crate) fn check_demo(folder: &Path) {
    let page = fs::read_to_string(folder.join("index.html")).expect("a page");
    let film = fs::read(folder.join("film.webp")).expect("a film");
    // Chunks of the container: an animation, and a frame for every picture that differs from the one before.
    assert_eq!((&film[..4], &film[8..12]), (b"RIFF".as_slice(), b"WEBP".as_slice()));
    let frames = film.windows(4).filter(|chunk| chunk == b"ANMF").count();
    assert!(frames > 100, "{frames} frames");
    assert_eq!(page.matches("data:image/webp;base64,").count(), 1);
    assert!(page.matches("<h2>").count() == 2 && page.contains("touched from above to locate it"), "the notes");
    assert!(!page.contains("src=\"http"), "one file, nothing fetched");
    for name in ["blind.png", "touch.png", "blind.rrd", "touch.rrd"] {
        assert!(fs::metadata(folder.join(name)).expect(name).len() > 10_000, "{name}");
    }
}
