//! Trials with one object and with three, by the same command as those with two.

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use e2e::{ftac, stderr};
use tempfile::tempdir;

/// Runs one trial of a scenario with these lists of objects. Returns the rows of `trials.csv` by column.
fn trials(folder: &Path, lists: &str, conditions: &str) -> Vec<HashMap<String, String>> {
    let (scenario, out) = (folder.join("lists.toml"), folder.join("out"));
    let text = format!("version = 1\nname = \"lists\"\nextends = \"benchmark\"\n{lists}");
    fs::write(&scenario, text).expect("written");
    let mut command = ftac(&["bench", "--trials", "1", "--conditions", conditions, "--record", "none", "--scenario"]);
    let output = command.arg(&scenario).arg("--out").arg(&out).output().expect("runs");
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
    let mut table = csv::Reader::from_path(out.join("trials.csv")).expect("trials.csv");
    table.deserialize().collect::<Result<_, _>>().expect("rows")
}

#[test]
fn one_object_is_taken_alone() {
    let folder = tempdir().expect("a folder");
    let rows = trials(folder.path(), "first = [\"golf_ball\"]\nsecond = []\n", "ideal,touch");
    assert_eq!(rows.len(), 2);
    for row in rows {
        assert_eq!((&row["second"][..], &row["success"][..], &row["contact"][..]), ("", "true", "false"), "{row:?}");
    }
}

/// The little finger, the ring finger, and thumb with index and middle finger each hold one object to the end of the trial.
#[test]
fn three_objects_are_held_in_one_hand() {
    let folder = tempdir().expect("a folder");
    let lists = "first = [\"golf_ball\"]\nsecond = [\"golf_ball\"]\nthird = [\"pear\"]\n\
                 [layout]\nfirst = { x = 0.62, y = 0.14, yaw = 0.0 }\nsecond = { x = 0.62, y = 0.0, yaw = 0.0 }\n\
                 third = { x = 0.62, y = -0.145, yaw = 0.0 }\n";
    let rows = trials(folder.path(), lists, "ideal,touch");
    assert_eq!(rows.len(), 2);
    assert_eq!((&rows[0]["third"][..], &rows[0]["success"][..]), ("pear", "true"), "{:?}", rows[0]);
    // The pose of the ball held by the little finger is estimated; each later object has two pose errors.
    let touch = &rows[1];
    let off: f64 = touch["pose_error_mm"].parse().expect("a pose error");
    assert!(off < 5.0 && touch["later_pose_errors"].split(' ').count() == 4, "{touch:?}");
}
