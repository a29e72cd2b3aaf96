//! `instance.toml`: the parameters identified for one robot, their uncertainty, and the sessions they come from.
//!
//! The file contains a digest of its own content, because an estimate with a covariance must not be edited by hand.

use std::path::Path;

use ftac_platform::data::{DataError, parse_toml};
use ftac_platform::digest::sha256;
use hand_model::RobotModel;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::prior::{PlantParameter, Prior, PriorKind};
use crate::robot::RobotInstance;

/// Version of the file format.
const VERSION: u32 = 1;

/// A session from which an estimate was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SessionSource {
    /// Name of its file, as it was given.
    pub file: String,
    /// SHA-256 of the file in hexadecimal digits.
    pub sha256: String,
    /// Kind of robot: `sim`, `emulated`, `direct`, `hardware`.
    pub robot: String,
    /// Duration, s.
    pub seconds: f64,
}

/// Estimate of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterEstimate {
    /// Name, as in [`super::prior::PlantParameter::name`].
    pub name: String,
    /// Effect of the deviation on the nominal value.
    pub kind: PriorKind,
    /// Best estimate; the prior mean if nothing was learnt.
    pub deviation: f64,
    /// Standard deviation of the estimate; that of the prior if nothing was learnt.
    pub sigma: f64,
    /// True if the sessions contain more information than the prior.
    pub identified: bool,
}

impl ParameterEstimate {
    /// Returns the prior of a parameter about which nothing was learnt.
    pub fn from_prior(parameter: &PlantParameter, deviation: f64) -> Self {
        let Prior { kind, sigma, .. } = parameter.prior;
        Self { name: parameter.name.clone(), kind, deviation, sigma, identified: false }
    }
}

/// Covariance matrix of some parameters' deviations, row by row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CovarianceBlock {
    pub parameters: Vec<String>,
    pub rows: Vec<Vec<f64>>,
}

/// Content of an estimate's file, with its provenance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileContents {
    version: u32,
    /// Name of the nominal hand.
    hand: String,
    /// Program and version that wrote it.
    program: String,
    session: Vec<SessionSource>,
    parameter: Vec<ParameterEstimate>,
    covariance: Vec<CovarianceBlock>,
}

#[derive(Serialize, Deserialize)]
struct DigestedFile {
    digest: String,
    #[serde(flatten)]
    contents: FileContents,
}

/// A robot as identified from its sessions.
#[derive(Debug, Clone, PartialEq)]
pub struct IdentifiedRobot {
    /// Best estimate of every parameter.
    pub instance: RobotInstance,
    /// Estimate of every parameter, in the instance's order.
    pub estimates: Vec<ParameterEstimate>,
    pub covariances: Vec<CovarianceBlock>,
    pub sessions: Vec<SessionSource>,
}

impl IdentifiedRobot {
    /// Creates it from an estimate of every parameter of `robot`'s instances, in their order.
    pub fn new(
        robot: &RobotModel,
        estimates: Vec<ParameterEstimate>,
        covariances: Vec<CovarianceBlock>,
        sessions: Vec<SessionSource>,
    ) -> Self {
        let mut individual = RobotInstance::nominal(robot);
        for (place, estimate) in estimates.iter().enumerate() {
            individual.set(place, estimate.deviation);
        }
        Self { instance: individual, estimates, covariances, sessions }
    }

    /// Writes the text of the file.
    pub fn to_toml(&self, robot: &RobotModel, program: &str) -> Result<String, toml::ser::Error> {
        let contents = FileContents {
            version: VERSION,
            hand: robot.hand.parameters.name.clone(),
            program: program.to_owned(),
            session: self.sessions.clone(),
            parameter: self.estimates.clone(),
            covariance: self.covariances.clone(),
        };
        let body = toml::to_string(&contents)?;
        Ok(format!("digest = \"{}\"\n{body}", sha256(body.as_bytes())))
    }

    /// Reads and checks the text of a file; `path` is used in errors.
    pub fn parse(text: &str, path: &Path, robot: &RobotModel) -> Result<Self, DataError> {
        let DigestedFile { digest: found, contents } = parse_toml(text, path)?;
        let fault = |field: String, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if contents.version != VERSION {
            return fault("version".into(), contents.version.to_string(), "1");
        }
        if contents.hand != robot.hand.parameters.name {
            return fault("hand".into(), format!("`{}`", contents.hand), &format!("`{}`", robot.hand.parameters.name));
        }
        let designed = RobotInstance::nominal(robot);
        for (parameter, estimate) in designed.parameters().iter().zip(&contents.parameter) {
            let field = |what: &str| format!("parameter[{}].{what}", estimate.name);
            if estimate.name != parameter.name {
                return fault(field("name"), format!("`{}`", estimate.name), &format!("`{}`", parameter.name));
            }
            if estimate.kind != parameter.prior.kind {
                let expected = format!("{:?}", parameter.prior.kind).to_lowercase();
                return fault(field("kind"), format!("{:?}", estimate.kind).to_lowercase(), &expected);
            }
            // No hand built from this design deviates by a factor of e or by a radian.
            if !(estimate.deviation.is_finite() && estimate.deviation.abs() < 1.0) {
                return fault(field("deviation"), estimate.deviation.to_string(), "a number between -1 and 1");
            }
            if !(estimate.sigma.is_finite() && estimate.sigma > 0.0) {
                return fault(field("sigma"), estimate.sigma.to_string(), "a positive number");
            }
        }
        if contents.parameter.len() != designed.parameters().len() {
            let expected = format!("all {} of this robot", designed.parameters().len());
            return fault("parameter".into(), format!("{} parameters", contents.parameter.len()), &expected);
        }
        for block in &contents.covariance {
            check_covariance(block, &designed, path)?;
        }
        let body = toml::to_string(&contents).map_err(|error| DataError::field(path, "file", error, "a table"))?;
        if sha256(body.as_bytes()) != found {
            let expected = "the digest of the file's content: it was changed after `ftac sysid identify` wrote it; identify the robot again";
            return fault("digest".into(), format!("`{found}`"), expected);
        }
        Ok(Self::new(robot, contents.parameter, contents.covariance, contents.session))
    }
}

/// Checks that a block names parameters, and that it is a covariance matrix.
fn check_covariance(block: &CovarianceBlock, robot: &RobotInstance, path: &Path) -> Result<(), DataError> {
    let n = block.parameters.len();
    let field = format!("covariance[{}].rows", block.parameters.first().map_or("", String::as_str));
    if let Some(unknown) = block.parameters.iter().find(|name| robot.find(name).is_none()) {
        let expected = "names of parameters";
        return Err(DataError::field(path, "covariance.parameters", format!("`{unknown}`"), expected));
    }
    if block.rows.len() != n || block.rows.iter().any(|row| row.len() != n) {
        return Err(DataError::field(path, field, "another shape", format!("{n} rows of {n} numbers")));
    }
    let matrix = nalgebra::DMatrix::from_fn(n, n, |row, column| block.rows[row][column]);
    let symmetric = (&matrix - matrix.transpose()).amax() <= 1e-9 * matrix.amax();
    if !symmetric || matrix.cholesky().is_none() {
        return Err(DataError::field(path, field, "no covariance", "a symmetric, positive definite matrix"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identified() -> (RobotModel, IdentifiedRobot) {
        let drawn = RobotModel::ftac_gen3();
        let robot = RobotInstance::sample(&drawn, 2);
        let estimates: Vec<ParameterEstimate> = robot
            .parameters()
            .iter()
            .zip(robot.deviations())
            .map(|(parameter, deviation)| ParameterEstimate {
                identified: true,
                ..ParameterEstimate::from_prior(parameter, *deviation)
            })
            .collect();
        let names = vec!["index_1.spring".to_owned(), "index_2.spring".to_owned()];
        let block = CovarianceBlock { parameters: names, rows: vec![vec![2e-4, 1e-4], vec![1e-4, 3e-4]] };
        let source = SessionSource { file: "a.mcap".into(), sha256: "00".into(), robot: "sim".into(), seconds: 1.5 };
        let robot = IdentifiedRobot::new(&drawn, estimates, vec![block], vec![source]);
        (drawn, robot)
    }

    #[test]
    fn a_file_is_read_back_to_the_last_bit() {
        let (drawn, robot) = identified();
        let text = robot.to_toml(&drawn, "ftac test").unwrap();
        assert_eq!(IdentifiedRobot::parse(&text, Path::new("instance.toml"), &drawn).unwrap(), robot);
    }

    /// Each invalid file is refused with an error that names file and field.
    #[test]
    fn a_changed_file_is_refused() {
        let (drawn, robot) = identified();
        let text = robot.to_toml(&drawn, "ftac test").unwrap();
        let number = text.lines().find(|line| line.starts_with("deviation")).unwrap().to_owned();
        for (from, to, says) in [
            (number.as_str(), "deviation = 0.01", "instance.toml: digest: found `"),
            (number.as_str(), "deviation = 4.0", "parameter[thumb_1.spring].deviation: found 4"),
            (number.as_str(), "deviation = nan", "parameter[thumb_1.spring].deviation: found NaN"),
            ("hand = \"ftac\"", "hand = \"other\"", "instance.toml: hand: found `other`, expected `ftac`"),
            ("name = \"thumb_2.spring\"", "name = \"thumb_9.spring\"", "expected `thumb_2.spring`"),
            ("[0.0001, 0.0003]", "[0.0001]", "covariance[index_1.spring].rows"),
            ("[0.0001, 0.0003]", "[0.0001, -0.0003]", "positive definite"),
            ("version = 1", "version = 7", "version: found 7, expected 1"),
        ] {
            assert!(text.contains(from), "{from}");
            let changed = text.replacen(from, to, 1);
            let error = IdentifiedRobot::parse(&changed, Path::new("instance.toml"), &drawn).unwrap_err().to_string();
            assert!(error.contains(says), "{says}: {error}");
        }
        let torn = &text[..text.len() / 2];
        assert!(IdentifiedRobot::parse(torn, Path::new("instance.toml"), &drawn).is_err());
    }
}
