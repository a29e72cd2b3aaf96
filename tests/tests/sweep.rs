//! Sweeps on one machine: killed and resumed, joined by other processes, refused on wrong input, and read by other programs.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use e2e::{ftac, root, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

const SWEEP_TOML: &str = "version = 1\nname = \"noise\"\ncombos = 1\ntrials = 1\nunit_minutes = 0.01\n[axes]\nseed = [41, 42]\n\
                     policy = [\"ideal\", \"blind\"]\n\"scenario.noise.perception.xy_sigma\" = [0.0, 0.0065]\n";

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

fn json(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {output:?}"))
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let listed = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut found: Vec<PathBuf> =
        listed.filter(|path| path.extension().is_some_and(|ending| ending == "parquet")).collect();
    found.sort();
    found
}

/// Checks that a command is refused with exit code 2 and these words.
fn refused(arguments: &[&str], words: &[&str]) {
    let output = run(arguments);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    assert!(words.iter().all(|word| said.contains(word)), "{arguments:?}: {said}");
}

#[test]
fn a_sweep_goes_on_after_a_kill_and_others_read_it() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("noise.toml");
    fs::write(&file, SWEEP_TOML).expect("written");
    let planned = json(&run(&["sweep", "plan", text(&file), "--json"]));
    assert_eq!((&planned["points"], &planned["trials"]), (&Value::from(2), &Value::from(8)));

    // Killed as soon as one unit is finished.
    let out = folder.path().join("killed");
    let mut child = ftac(&["sweep", "run", text(&file), "--out", text(&out), "--jobs", "1"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    while files(&out.join("units/trials")).is_empty() {
        assert!(child.try_wait().expect("ours").is_none(), "it ended before a unit was finished");
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().expect("killed");
    child.wait().expect("ours");
    let first = files(&out.join("units/trials"))[0].clone();
    let written = fs::metadata(&first).and_then(|data| data.modified()).expect("a time");
    let resumed = run(&["sweep", "run", text(&file), "--out", text(&out), "--json"]);
    assert!(resumed.status.success(), "{}", stderr(&resumed));
    let merged = json(&resumed)["merged"].clone();
    assert_eq!((&merged["trials"], &merged["missing"]), (&Value::from(8), &Value::from(0)));
    assert_eq!(fs::metadata(&first).and_then(|data| data.modified()).expect("a time"), written, "it ran twice");

    // Another sweep in that folder is refused; nothing is lost.
    let other = folder.path().join("other.toml");
    fs::write(&other, SWEEP_TOML.replace("[41, 42]", "[41, 43]")).expect("written");
    refused(&["sweep", "run", text(&other), "--out", text(&out)], &["holds another sweep", "name another folder"]);

    // A broken file is named and kept, and its unit is run again with the same results.
    let whole = fs::read(&first).expect("read");
    fs::write(&first, &whole[..whole.len() / 2]).expect("written");
    let broken = run(&["sweep", "merge", text(&out), "--json"]);
    assert_eq!(broken.status.code(), Some(1), "{}", stderr(&broken));
    let reason = json(&broken)["broken"][0]["reason"].as_str().unwrap_or_default().to_owned();
    assert!(reason.contains("no whole Parquet file"), "{reason}");
    assert_eq!(files(&out.join("corrupt")).len(), 2);
    let again = run(&["sweep", "run", text(&out), "--jobs", "2", "--json"]);
    assert_eq!(json(&again)["run"], 1);
    assert_eq!(json(&again)["merged"]["digest"], merged["digest"]);

    let report = run(&["report", text(&out), "--json"]);
    assert!(report.status.success(), "{}", stderr(&report));
    let curves = json(&report)["curves"].as_array().expect("curves").clone();
    // Two levels, two policies, three outcomes.
    assert_eq!(curves.len(), 12);
    let page = fs::read_to_string(out.join("report.html")).expect("a page");
    assert!(page.contains("<svg") && page.contains("xy_sigma"));
    read_by_others(&out);
}

/// Checks that pandas, Polars and DuckDB find the trials and their columns.
fn read_by_others(out: &Path) {
    let folder = tempdir().expect("a folder");
    let python = folder.path().join("venv/bin/python");
    let made = Command::new("python3").args(["-m", "venv", text(&folder.path().join("venv"))]).output();
    let install =
        ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "pandas", "pyarrow", "polars", "duckdb"];
    let made = made.and_then(|_| Command::new(&python).args(install).output());
    if !made.as_ref().is_ok_and(|output| output.status.success()) {
        let why = made.map_or_else(|error| error.to_string(), |output| stderr(&output));
        assert!(std::env::var("FTAC_PYTHON").as_deref() != Ok("required"), "FTAC_PYTHON=required, but {why}");
        let told =
            writeln!(std::io::stderr(), "LEFT OUT: no other program reads the Parquet files in this test:\n{why}");
        return told.expect("stderr");
    }
    let script = "import sys, pandas, polars, duckdb\n\
        out = sys.argv[1]\n\
        for path in [out + '/merged/trials', out + '/units/trials']:\n\
        \x20   frame = pandas.read_parquet(path)\n\
        \x20   assert frame.shape[0] == 8, frame\n\
        \x20   assert sorted(frame.axis_xy_sigma.unique()) == [0.0, 0.0065], frame\n\
        \x20   assert set(frame.policy) == {'ideal', 'blind'} and frame.success.dtype == bool or frame.success.notna().all()\n\
        \x20   lazy = polars.scan_parquet(path + '/*.parquet').group_by('policy', 'seed').len().collect()\n\
        \x20   assert lazy.height == 4 and lazy['len'].sum() == 8, lazy\n\
        \x20   rows = duckdb.sql(f\"select policy, avg(clean_success::int), count(*) from '{path}/*.parquet' group by all order by 1\").fetchall()\n\
        \x20   assert [row[0] for row in rows] == ['blind', 'ideal'] and [row[2] for row in rows] == [4, 4], rows\n\
        tries = pandas.read_parquet(out + '/merged/tries')\n\
        assert len(tries) >= 8 and 'cov_rz_rz' in tries.columns and tries['try'].min() == 0, tries\n";
    let output = Command::new(&python).args(["-c", script, text(out)]).output().expect("python runs");
    assert!(output.status.success(), "{}", stderr(&output));
}

/// The workflow runs a sweep file of this repository, which amounts to the whole table.
#[test]
fn the_whole_table_is_a_sweep_file() {
    let file = "twin/sweep/data/benchmark.toml";
    let planned = json(&run(&["sweep", "plan", file, "--json"]));
    assert_eq!((&planned["points"], &planned["trials"]), (&Value::from(1), &Value::from(60 + 3 * 60 * 10)));
    let workflow = fs::read_to_string(root().join(".github/workflows/benchmark.yml")).expect("the workflow");
    assert!(workflow.contains(file), "{workflow}");
}

#[test]
fn bad_input_is_named() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("s.toml");
    let out = folder.path().join("out");
    let head = "version = 1\nname = \"s\"\ncombos = 1\ntrials = 1\n[axes]\n";
    for (axes, words) in [
        (
            "\"scenario.noise.xy_sgima\" = [0.1]",
            &["s.toml: axes.scenario.noise.xy_sgima", "noise.perception.xy_sigma"][..],
        ),
        ("noise_skale = [1.0]", &["axes.noise_skale", "near it: noise_scale"]),
        ("seed = []", &["axes.seed", "an empty sweep"]),
        ("seed = [1, 1]", &["axes.seed: found 1 twice"]),
        ("seed = [-1]", &["axes.seed: found -1"]),
        ("policy = [\"psychic\"]", &["axes.policy: found psychic", "ideal, blind, reflex, touch"]),
        ("robot = [\"hardware\"]", &["axes.robot: found hardware", "sim, emulated, direct"]),
        ("scenario = [\"nowhere.toml\"]", &["nowhere.toml"]),
        ("\"scenario.referee.slip\" = [-1.0]", &["axes.scenario.referee.slip", "referee.slip: found -1"]),
    ] {
        fs::write(&file, format!("{head}{axes}\n")).expect("written");
        refused(&["sweep", "run", text(&file), "--out", text(&out)], words);
        assert!(!out.exists(), "{axes}");
    }
    fs::write(&file, head.replace("combos = 1", "combos = 0")).expect("written");
    refused(&["sweep", "plan", text(&file)], &["combos: found 0: an empty sweep"]);
    fs::write(&file, head).expect("written");
    refused(&["sweep", "run", text(&file)], &["--out: found nothing"]);
    refused(&["sweep", "status", text(folder.path())], &["found no sweep"]);
    let without =
        ftac(&["sweep", "submit", text(&file), "--out", text(&out)]).env("PATH", folder.path()).output().expect("runs");
    assert_eq!(without.status.code(), Some(2));
    assert!(stderr(&without).contains("found no `sbatch` on the path"), "{}", stderr(&without));
}
