//! Settings of a run: everything besides policy, seeds and size on which the outcomes depend.
//!
//! An entry holds them as values and texts, so that its trials can be run again without any other file.

use std::path::{Path, PathBuf};

use bench::journal::{RecordingSelection, RunRequest};
use ftac_platform::digest::sha256;
use hand_model::robot_model::RobotSources;
use scenarios::effects::Effect;
use scenarios::record::Condition;
use scenarios::scenario::BENCHMARK_TOML;
use serde::{Deserialize, Serialize};

use crate::error::BoardError;

/// Robot backend of all rows: its trials can be repeated bit by bit.
const BACKEND: &str = "sim";

/// Settings of the runs of an entry.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name of the robot model.
    pub robot_model: String,
    /// Factor of the scenario's noise.
    pub noise_scale: f64,
    /// Effects of the scenario that are switched off.
    pub without: Vec<Effect>,
    /// True if deciding policies simulate second grasps before they choose one.
    pub look_ahead: bool,
    /// Effort of the verification of pairs outside the grasp pair table; none for the scenario's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effort: Option<u32>,
    /// Number of the simulated robot instance, unknown to the control stack.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plant_instance: Option<u64>,
    /// Text of the scenario; none for the benchmark's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenario: Option<String>,
    /// Text of the errors that the controller expects; none for the built-in ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<String>,
    /// Text of the file of an identified robot; none for the nominal one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_instance: Option<String>,
    /// Text of the calibration of the pads; none for the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pads: Option<String>,
    /// Texts of the robot's files; none for the built-in robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_files: Option<RobotSources>,
}

impl Settings {
    /// Returns the settings of the run in `folder`. Refuses a run that cannot be repeated bit by bit.
    pub fn from_request(request: &RunRequest, folder: &Path) -> Result<Self, BoardError> {
        let refused = |field: &str, found: String, expected: &str| {
            Err(BoardError::Unsuitable {
                folder: folder.to_owned(),
                field: field.to_owned(),
                found,
                expected: expected.to_owned(),
            })
        };
        if request.robot != BACKEND {
            return refused("robot", request.robot.clone(), "sim: trials of a row are run again");
        }
        if request.gpu {
            return refused("gpu", "true".to_owned(), "false: the bits of its images depend on the GPU");
        }
        if request.places != Default::default() {
            return refused("places", "a registered base or a detector".to_owned(), "the scenario's poses");
        }
        let robot = request.robot_model(folder).map_err(BoardError::Run)?;
        // The path of a robot file is of no use elsewhere.
        let bare = |sources: &RobotSources| RobotSources {
            name: sources.name.file_name().map_or_else(PathBuf::new, PathBuf::from),
            ..sources.clone()
        };
        Ok(Self {
            robot_model: robot.name,
            noise_scale: request.noise_scale,
            without: request.without.clone(),
            look_ahead: request.looks_ahead,
            effort: request.effort,
            plant_instance: request.plant_instance,
            scenario: (request.scenario != BENCHMARK_TOML).then(|| request.scenario.clone()),
            uncertainty: request.uncertainty.clone(),
            robot_instance: request.robot_instance.clone(),
            pads: request.pads.clone(),
            robot_files: request.robot_model.as_ref().map(bare),
        })
    }

    /// Returns the request for a run of one seed with these settings, without an external policy.
    pub fn to_request(
        &self,
        seed: u64,
        (combinations, trials): (usize, usize),
        conditions: &[Condition],
    ) -> RunRequest {
        RunRequest {
            combos: combinations,
            trials,
            seed,
            robot: BACKEND.to_owned(),
            driver: None,
            shard: (1, 1),
            conditions: conditions.to_vec(),
            ablations: Vec::new(),
            without: self.without.clone(),
            uncertainty: self.uncertainty.clone(),
            policy: None,
            noise_scale: self.noise_scale,
            effort: self.effort,
            scenario: self.scenario_text().to_owned(),
            robot_model: self.robot_files.clone(),
            robot_instance: self.robot_instance.clone(),
            pads: self.pads.clone(),
            plant_instance: self.plant_instance,
            looks_ahead: self.look_ahead,
            detects_faults: false,
            notes: Vec::new(),
            left_out: Vec::new(),
            places: Default::default(),
            gpu: false,
            record: RecordingSelection::None,
            provenance: Vec::new(),
        }
    }

    /// Returns in words what differs from a run without options, except for the scenario and the robot's files.
    pub fn changes(&self) -> Vec<String> {
        let effects: Vec<&str> = self.without.iter().map(|effect| effect.name()).collect();
        let given = |is_given: bool, words: &str| is_given.then(|| words.to_owned());
        let all = [
            (self.noise_scale != 1.0).then(|| format!("noise x {}", self.noise_scale)),
            (!effects.is_empty()).then(|| format!("without {}", effects.join(", "))),
            given(self.look_ahead, "with look-ahead"),
            self.effort.map(|effort| format!("effort {effort}")),
            self.plant_instance.map(|number| format!("robot instance {number}")),
            given(self.uncertainty.is_some(), "other expected errors"),
            given(self.robot_instance.is_some(), "an identified robot"),
            given(self.pads.is_some(), "another calibration of the pads"),
        ];
        all.into_iter().flatten().collect()
    }

    /// Returns the text of the scenario.
    pub fn scenario_text(&self) -> &str {
        self.scenario.as_deref().unwrap_or(BENCHMARK_TOML)
    }

    /// Returns the SHA-256 of the scenario's text.
    pub fn scenario_digest(&self) -> String {
        sha256(self.scenario_text().as_bytes())
    }

    /// Returns the SHA-256 of the settings as JSON, with `scenario_digest` in place of the scenario's text.
    pub fn digest(&self, scenario_digest: &str) -> Result<String, serde_json::Error> {
        let hashed = Self { scenario: Some(scenario_digest.to_owned()), ..self.clone() };
        Ok(sha256(&serde_json::to_vec(&hashed)?))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::test_runs::request;

    fn settings(changes: &serde_json::Value) -> Result<Settings, BoardError> {
        Settings::from_request(&request(changes), Path::new("run"))
    }

    /// The settings lead to the same run again.
    #[test]
    fn a_request_comes_back() {
        let asked = request(&json!({ "noise_scale": 0.5, "without": ["gel"], "conditions": ["blind"] }));
        let settings = Settings::from_request(&asked, Path::new("run")).expect("settings");
        let made = settings.to_request(asked.seed, (asked.combos, asked.trials), &asked.conditions);
        assert_eq!(made.first_difference(&asked).expect("compared"), None);
    }

    #[test]
    fn everything_that_counts_changes_the_hash() {
        let digest = |changes: &serde_json::Value| {
            let settings = settings(changes).expect("settings");
            settings.digest(&settings.scenario_digest()).expect("a digest")
        };
        let plain = digest(&json!({}));
        assert_eq!(plain, digest(&json!({ "seed": 5, "combos": 2, "conditions": ["touch"], "detects_faults": true })));
        let scenario = scenarios::scenario::BENCHMARK_TOML.to_owned() + "\n# another\n";
        for changes in [
            json!({ "noise_scale": 0.5 }),
            json!({ "without": ["gel"] }),
            json!({ "looks_ahead": true }),
            json!({ "plant_instance": 3 }),
            json!({ "scenario": scenario }),
            json!({ "uncertainty": "x" }),
        ] {
            assert_ne!(plain, digest(&changes), "{changes}");
        }
    }

    #[test]
    fn a_run_that_cannot_be_repeated_is_refused() {
        for (changes, words) in [
            (json!({ "robot": "emulated" }), "run: robot: found emulated, expected sim"),
            (json!({ "gpu": true }), "run: gpu: found true"),
            (json!({ "detector": true }), "run: places: found"),
        ] {
            let error = settings(&changes).expect_err("refused").to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
