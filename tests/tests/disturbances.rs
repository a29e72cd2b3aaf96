//! Every kind of disturbance, run from its file as by a user: it changes the outcome of the same trial without it, the
//! table of trials names it, and touch copes with it if it can be known beforehand.

use std::fs;
use std::path::Path;

use e2e::{root, run, stderr};
use tempfile::{TempDir, tempdir};

/// `trials.csv` of a short run of a scenario file with its text changed by `edit`; rows by column name.
struct ShortRun {
    rows: Vec<csv::StringRecord>,
    header: csv::StringRecord,
    _folder: TempDir,
}

impl ShortRun {
    fn of(name: &str, edit: impl Fn(String) -> String, size: &[&str]) -> Self {
        let folder = tempdir().expect("a folder");
        let text = fs::read_to_string(root().join("scenarios/data").join(format!("{name}.toml"))).expect("a scenario");
        let (scenario, out) = (folder.path().join("mine.toml"), folder.path().join("out"));
        fs::write(&scenario, edit(text)).expect("written");
        let fixed = ["bench", "--record", "none", "--seed", "4", "--scenario", utf8(&scenario), "--out", utf8(&out)];
        let output = run(&[&fixed[..], &["--conditions", "ideal,blind,touch"], size].concat());
        // Exit code 1 means that the rates fall short, which is possible under a disturbance.
        assert!(matches!(output.status.code(), Some(0 | 1)), "{name}: {:?}: {}", output.status, stderr(&output));
        let mut table = csv::Reader::from_path(out.join("trials.csv")).expect("trials.csv");
        let rows = table.records().map(|row| row.expect("a row")).collect();
        Self { rows, header: table.headers().expect("a header").clone(), _folder: folder }
    }

    fn short(name: &str) -> Self {
        Self::of(name, one_pair, &["--combos", "1", "--trials", "1"])
    }

    /// Runs the same trial without the disturbance.
    fn undisturbed(name: &str) -> Self {
        let cut = |text: String| one_pair(text[..text.find("[disturbance").expect("a disturbance")].to_owned());
        Self::of(name, cut, &["--combos", "1", "--trials", "1"])
    }

    /// Returns the number in `column` of the only row of `condition`.
    fn number(&self, condition: &str, column: &str) -> f64 {
        let values = self.values(condition, column);
        values.first().and_then(|value| value.parse().ok()).unwrap_or_else(|| panic!("{column}: {values:?}"))
    }

    /// Returns the values of `column` in the rows of `condition`, in order.
    fn values(&self, condition: &str, column: &str) -> Vec<&str> {
        let at = |name: &str| self.header.iter().position(|title| title == name).expect("a column");
        let (which, what) = (at("condition"), at(column));
        self.rows.iter().filter(|row| &row[which] == condition).map(|row| &row[what]).collect()
    }

    /// Checks that the ideal run is undisturbed, and that the disturbance of every other run mentions `happened`.
    fn disturbed(&self, happened: &str) {
        assert!(self.values("ideal", "disturbance").iter().all(|what| what.is_empty()), "ideal is disturbed");
        for condition in ["blind", "touch"] {
            let what = self.values(condition, "disturbance");
            assert!(!what.is_empty() && what.iter().all(|what| what.contains(happened)), "{condition}: {what:?}");
        }
    }
}

/// Reduces the scenario to two objects that are held well.
fn one_pair(text: String) -> String {
    let benchmark = "extends = \"benchmark\"";
    assert!(text.contains(benchmark), "{text}");
    text.replace(benchmark, &format!("{benchmark}\nfirst = [\"tennis_ball\"]\nsecond = [\"pawn\"]"))
}

fn utf8(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

#[test]
fn a_push_during_the_first_grasp() {
    let pushed = ShortRun::short("push");
    pushed.disturbed("N on the first object at ");
    // A push of 6 N knocks the object out of the closing hand; without it the object stays.
    let hard = |text: String| one_pair(text.replace("-2.0", "-6.0"));
    let hard = ShortRun::of("push", hard, &["--combos", "1", "--trials", "1"]);
    let undisturbed = ShortRun::undisturbed("push");
    for condition in ["blind", "touch"] {
        assert_eq!(hard.values(condition, "cause"), ["first_not_picked"], "{condition}");
        assert_ne!(undisturbed.values(condition, "cause"), ["first_not_picked"], "{condition}");
    }
    // The same seed gives the same bits.
    let again = ShortRun::short("push");
    let of = |run: &ShortRun| ["blind", "touch"].map(|c| run.values(c, "sim_seconds").concat());
    assert_eq!(of(&pushed), of(&again));
}

#[test]
fn slipping_while_carried() {
    ShortRun::short("slip").disturbed("the first object becomes slippery");
    // At the friction of ice and a pull of 40 N the object is lost; without them it is not.
    let ice = |text: String| one_pair(text.replace("friction = 0.5", "friction = 0.02").replace("-4.0", "-40.0"));
    let lost = ShortRun::of("slip", ice, &["--combos", "1", "--trials", "1"]);
    assert_eq!(lost.values("blind", "success"), ["false"]);
    let cause = lost.values("blind", "cause").concat();
    assert!(["first_dropped", "both_dropped"].contains(&cause.as_str()), "{cause}");
    assert_ne!(ShortRun::undisturbed("slip").values("blind", "cause"), [cause.as_str()]);
}

#[test]
fn an_object_that_is_not_where_it_is_seen() {
    ShortRun::short("wrong_position").disturbed("off its pose until it is touched");
    // The object is far from its seen place: the blind hand closes on nothing.
    let far = ShortRun::of(
        "wrong_position",
        |text| text.replace("0.010, 0.011", "0.0, 0.090"),
        &["--combos", "1", "--trials", "1"],
    );
    assert_eq!(far.values("blind", "success"), ["false"]);
    assert_eq!(far.values("ideal", "success"), ["true"]);
}

#[test]
fn an_object_of_another_size() {
    let larger = ShortRun::short("wrong_size");
    larger.disturbed("1.150 times as large as its model");
    let place = |run: &ShortRun| run.number("touch", "prior_error_mm");
    let moved = (place(&larger) - place(&ShortRun::undisturbed("wrong_size"))).abs();
    assert!(moved > 0.2, "a larger object sits only {moved} mm elsewhere in the hand");
}

#[test]
fn balls_of_other_sizes() {
    let one_pair = |text: String| {
        let text = text.replace("first = [\"golf_ball\", \"ball_50\"]", "first = [\"golf_ball\"]");
        text.replace("second = [\"golf_ball\", \"ball_50\", \"tennis_ball\"]", "second = [\"golf_ball\"]")
    };
    let sweep = ShortRun::of("size_sweep", one_pair, &["--combos", "1", "--trials", "2"]);
    assert_eq!(sweep.values("touch", "first"), ["golf_ball_as_36.0_mm", "golf_ball_as_39.0_mm"]);
    assert_eq!(sweep.values("ideal", "first"), ["golf_ball"]);
}

#[test]
fn failed_cameras() {
    ShortRun::short("blind_pads").disturbed("cameras failed: ring_distal, little_distal");
    // With most of the pads in contact failed, the first grasp is nearly the same; its pose estimate is not.
    let most = r#""ring_middle", "little_middle", "palm_ulnar", "palm_radial", "ring_distal""#;
    let most = |text: String| one_pair(text.replace("\"ring_distal\"", most));
    let missing = ShortRun::of("blind_pads", most, &["--combos", "1", "--trials", "1"]);
    let intact = ShortRun::undisturbed("blind_pads");
    let apart = |column: &str| (missing.number("touch", column) - intact.number("touch", column)).abs();
    let (prior, pose) = (apart("prior_error_mm"), apart("pose_error_mm"));
    assert!(prior < 0.2 && pose > 2.0 * prior, "prior {prior} mm, pose {pose} mm");
    let black = |text: String| one_pair(text.replace("frames = \"missing\"", "frames = \"black\""));
    ShortRun::of("blind_pads", black, &["--combos", "1", "--trials", "1"]).disturbed("cameras failed");
}

/// Without ring and little finger no grasp holds the first object: touch reports it and does not begin. Blind closes
/// on it as planned, with digits that do not move.
#[test]
fn digits_without_power() {
    let both = |text: String| text.replace("[\"index\"]", "[\"ring\", \"little\"]");
    let run = ShortRun::of("disabled_digits", both, &["--combos", "1", "--trials", "1"]);
    run.disturbed("no power: ring, little");
    assert_eq!(run.values("touch", "cause"), ["no_strategy"]);
    let why = run.values("touch", "reason").concat();
    assert!(why.starts_with("no grasp holds") && why.ends_with("without ring and little"), "{why}");
    assert_eq!(run.values("blind", "cause"), ["first_not_picked"]);
    assert_eq!(run.values("ideal", "success"), ["true"]);
}

/// A disturbance that cannot be run is refused with file, line and field, and leaves nothing behind.
#[test]
fn a_wrong_disturbance_is_refused() {
    let folder = tempdir().expect("a folder");
    let (scenario, out) = (folder.path().join("mine.toml"), folder.path().join("out"));
    let good = fs::read_to_string(root().join("scenarios/data/push.toml")).expect("a scenario");
    let bench = |text: &str, extra: &[&str]| {
        fs::write(&scenario, text).expect("written");
        let fixed = ["bench", "--combos", "1", "--trials", "1", "--scenario", utf8(&scenario), "--out", utf8(&out)];
        let output = run(&[&fixed[..], extra].concat());
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(!out.exists(), "left a result folder behind");
        stderr(&output)
    };
    let unknown = bench(&good.replace("duration =", "for_so_long ="), &[]);
    assert!(unknown.contains("mine.toml:") && unknown.contains("for_so_long"), "{unknown}");
    let strong = bench(&good.replace("-2.0", "-2000.0"), &[]);
    assert!(strong.contains("disturbance.push.force") && strong.contains("at most 100 N"), "{strong}");
    let refused = bench(&good, &["--robot", "direct"]);
    assert!(refused.contains("--robot: found direct") && refused.contains("[disturbance]"), "{refused}");
}
