//! `ftac optics render` with the file of a real sensor.

use e2e::{run, stderr};

use super::synthetic_sensor::{synthetic_sensor, text};

#[test]
fn the_former_name_of_the_sensors_option_is_taken_with_a_notice() {
    let made = synthetic_sensor();
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
    let made = synthetic_sensor();
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
