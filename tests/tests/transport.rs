//! `ftac transport`: balls to one place, together and one by one, and refused input.

use std::fs;
use std::path::Path;

use e2e::{root, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

fn utf8(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

fn carried(args: &[&str]) -> Value {
    let output = run(&[&["-q", "--json", "transport"], args].concat());
    // Exit code 1 is a result that falls short.
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("JSON on stdout")
}

/// Touch carries two at once, one-by-one a single ball per trip; the story is complete, and the recording is written.
#[test]
fn more_than_one_at_once() {
    let folder = tempdir().expect("a folder");
    let result = carried(&["--trials", "1", "--policy", "one-by-one,touch", "--out", utf8(folder.path())]);
    let most = |n: usize| result["policies"][n]["max_per_trip"].as_u64().expect("a number");
    assert_eq!(most(0), 1);
    assert!(most(1) >= 2, "{result}");
    let trace = result["transports"][1]["events"].to_string();
    assert!(trace.contains("plan: ball_") && trace.contains("is felt by") && trace.contains("trip 1:"), "{trace}");
    assert!(folder.path().join("touch.rrd").is_file() && folder.path().join("one_by_one.rrd").is_file());
    let kept: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("transports.json")).expect("kept")).expect("JSON");
    assert_eq!(kept, result);
    let again = run(&["transport", "--trials", "1", "--policy", "blind", "--out", utf8(folder.path())]);
    assert_eq!(again.status.code(), Some(2));
    assert!(stderr(&again).contains("--out: found the results of another run"), "{}", stderr(&again));
}

/// The plan: the golf ball with the little finger, and the softball with thumb, index and middle finger. The push takes
/// the golf ball out of the little finger. Touch feels nothing there, and other balls are picked, among them the yoga
/// ball by thumb, index and middle finger.
#[test]
fn four_balls_one_pushed() {
    let file = root().join("scenarios/data/transport/four_balls.toml");
    let result = carried(&["--trials", "1", "--policy", "touch", "--scenario", utf8(&file)]);
    let trace = result["transports"][0]["events"].to_string();
    let mut rest = trace.as_str();
    let plan = "plan: golf_ball with little finger (holds";
    for next in [
        plan,
        "softball with thumb, index and middle finger (holds",
        "on golf_ball",
        "nothing felt of golf_ball",
        "yoga_ball with thumb, index and middle finger",
    ] {
        rest = rest.split_once(next).unwrap_or_else(|| panic!("no {next:?} in what is left of {trace}")).1;
    }
    assert!(result["policies"][0]["max_per_trip"].as_u64() >= Some(2), "{result}");
}

/// A short search reports the stage that each pick reached, and keeps the skills that hold.
#[test]
fn a_search_of_skills() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("skills.json");
    let result = carried(&["--search-skills", utf8(&file), "--pick", "ball_1=ring+little", "--n", "8"]);
    assert_eq!(result["picks"][0]["ball"], "ball_1");
    assert!(result["picks"][0]["tried"].as_u64() >= Some(4), "{result}");
    let kept: Value = serde_json::from_str(&fs::read_to_string(&file).expect("kept")).expect("JSON");
    let found = result["picks"][0]["skills"].as_array().expect("a list").len();
    assert_eq!(kept["skills"].as_array().expect("a list").len(), found);
}

#[test]
fn what_cannot_be_run_is_refused() {
    let folder = tempdir().expect("a folder");
    let (mine, out) = (folder.path().join("mine.toml"), folder.path().join("out"));
    let good = fs::read_to_string(root().join("scenarios/data/transport/small_balls.toml")).expect("a scenario");
    let refused = |text: &str, extra: &[&str]| {
        fs::write(&mine, text).expect("written");
        let fixed = ["transport", "--trials", "1", "--scenario", utf8(&mine)];
        let output = run(&[&fixed[..], extra].concat());
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(!out.exists(), "left something behind");
        stderr(&output)
    };
    let out = ["--out", utf8(&out)];
    let wide = refused(&good.replacen("diameter = 0.0427", "diameter = 0.5", 1), &out);
    assert!(wide.contains("ball[0].diameter: found 0.5, expected 0.02 to 0.12 m"), "{wide}");
    let unknown = refused(&good.replace("friction =", "stickiness ="), &out);
    assert!(unknown.contains("mine.toml:") && unknown.contains("stickiness"), "{unknown}");
    let pick = refused(&good, &["--search-skills", "x.json", "--pick", "ball_9=ring"]);
    assert!(pick.contains("ball_9") && pick.contains("ball_1"), "{pick}");
    let digit = run(&["transport", "--search-skills", "x.json", "--pick", "ball_1=toe"]);
    assert!(digit.status.code() == Some(2) && stderr(&digit).contains("toe"), "{}", stderr(&digit));
}
