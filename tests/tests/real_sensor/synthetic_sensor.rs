//! A sensor with known lamps, response and gel, and its presses of a ball.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use e2e::{run, stderr};
use tempfile::{TempDir, tempdir};

pub(crate) const COLUMNS: usize = 160;
pub(crate) const ROWS: usize = 120;
/// Pixel size on the gel, m.
pub(crate) const PIXEL_SIZE: f64 = 0.08e-3;
/// Radius of the ball, m.
pub(crate) const BALL_RADIUS: f64 = 2e-3;
/// Positions (m), directions and colours of the lamps.
pub(crate) const LAMPS: [([f64; 3], [f64; 3], [f64; 3]); 3] = [
    ([12e-3, 1e-3, -6e-3], [-0.894, 0.0, 0.447], [3.0, 0.2, 0.1]),
    ([-7e-3, 11e-3, -7e-3], [0.48, -0.768, 0.424], [0.1, 3.2, 0.3]),
    ([-6e-3, -11e-3, -6e-3], [0.48, -0.768, 0.424], [0.2, 0.3, 3.1]),
];

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

pub(crate) fn unit([x, y, z]: [f64; 3]) -> [f64; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

/// Returns the direction of a lamp aimed at the image centre.
pub(crate) fn direction(position: [f64; 3]) -> [f64; 3] {
    unit(position.map(|part| -part))
}

/// Returns the RGB values of a pixel of the untouched gel: diffuse light and three lamps on a level, matt surface, with
/// a linear response.
pub(crate) fn flat(column: usize, row: usize) -> [u8; 3] {
    let point = [(column as f64 - 79.5) * PIXEL_SIZE, (59.5 - row as f64) * PIXEL_SIZE, 0.0];
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

pub(crate) fn known_sensor(folder: &Path) -> PathBuf {
    let background =
        image::RgbImage::from_fn(COLUMNS as u32, ROWS as u32, |x, y| image::Rgb(flat(x as usize, y as usize)));
    background.save(folder.join("known.background.png")).expect("saved");
    let mut file = format!(
        "version = 1\ncolumns = {COLUMNS}\nrows = {ROWS}\npixel_mm = {}\ncontact_over_visible = 1.0\n\
         background = \"known.background.png\"\n[model]\ngain = [1.0, 1.0, 1.0]\nnoise = 0.0\ntexture = [0.0, 0.0]\n\
         ambient = [0.25, 0.25, 0.25]\n[model.camera]\nposition = [0.0, 0.0, -0.025]\n[model.reflectance]\n\
         albedo = [1.0, 1.0, 1.0]\nroughness = 0.0\n[model.elastomer]\nkernels = [0.3e-3]\ncoating = 0.0\n",
        1e3 * PIXEL_SIZE
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

/// Returns a ball as a mesh (OBJ), m: two poles and rings between them.
pub(crate) fn ball(radius: f64) -> String {
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
            // At a pole one side of the facet has no length.
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

/// Returns a triangular prism along y (OBJ), with an edge down.
pub(crate) fn prism(size: f64) -> String {
    let corners = [[0.0, 0.0], [1.0, 1.0], [-1.0, 1.0]];
    let mut mesh = String::new();
    for y in [-1.0, 1.0] {
        for [x, z] in corners {
            let _ = writeln!(mesh, "v {} {} {}", x * size, y * size, z * size);
        }
    }
    mesh + "f 1 2 3\nf 4 6 5\nf 1 4 5\nf 1 5 2\nf 2 5 6\nf 2 6 3\nf 3 6 4\nf 3 4 1\n"
}

/// Renders the known sensor's image of a mesh at (x, y) mm, `depth` mm deep.
pub(crate) fn press(sensor: &Path, mesh: &Path, [x, y]: [f64; 2], depth: f64, out: &Path) -> Output {
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

/// A folder with eighteen labelled presses and the known sensor.
pub(crate) struct SyntheticSensor {
    folder: TempDir,
}

impl SyntheticSensor {
    pub(crate) fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

pub(crate) fn synthetic_sensor() -> &'static SyntheticSensor {
    static SYNTHETIC_SENSOR: OnceLock<SyntheticSensor> = OnceLock::new();
    SYNTHETIC_SENSOR.get_or_init(|| {
        let made = SyntheticSensor { folder: tempdir().expect("a folder") };
        let sensor = known_sensor(made.folder.path());
        fs::write(made.at("ball.obj"), ball(BALL_RADIUS)).expect("written");
        fs::write(made.at("larger.obj"), ball(1.5 * BALL_RADIUS)).expect("written");
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
            let radius = (BALL_RADIUS * BALL_RADIUS - (BALL_RADIUS - 1e-3 * depth).powi(2)).sqrt() / PIXEL_SIZE;
            let (column, row) = (79.5 + 1e-3 * place[0] / PIXEL_SIZE, 59.5 - 1e-3 * place[1] / PIXEL_SIZE);
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

pub(crate) fn calibrate(folder: &Path, more: &[&str], out: &Path) -> Output {
    run(&[&["optics", "calibrate", text(folder), "--out", text(out), "--json"], more].concat())
}

/// Copies the presses with numbers `which` and their labels into a separate folder.
pub(crate) fn some_presses(name: &str, which: impl IntoIterator<Item = usize>) -> PathBuf {
    let (made, folder) = (synthetic_sensor(), synthetic_sensor().at(name));
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
