//! File of the result of a registration.

use std::path::Path;

use ftac_platform::data::{DataError, parse_toml, read_text};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

/// Registered pose of the arm's base, as a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegistrationFile {
    /// Version of this format: 1.
    pub version: u32,
    /// Position of `world_from_base`, m.
    pub position: [f64; 3],
    /// Rotation of `world_from_base` as a quaternion, i, j, k, w.
    pub quaternion: [f64; 4],
    /// Standard deviations of the position of the marks' centre (m) and of the rotation (rad), world axes.
    pub sigma: [f64; 6],
    /// Residual distance of each touched point from its known position, m.
    pub residuals: Vec<f64>,
}

/// Largest plausible offset of the base from its nominal pose: m and rad.
const MAX_BASE_OFFSET: (f64, f64) = (0.1, 0.2);

impl RegistrationFile {
    /// Creates the file of a registration.
    pub fn new(found: &control::registration::Registration) -> Self {
        let (t, q) = (found.world_from_base.translation.vector, found.world_from_base.rotation.coords);
        Self {
            version: 1,
            position: t.into(),
            quaternion: q.into(),
            sigma: std::array::from_fn(|n| found.covariance[(n, n)].sqrt()),
            residuals: found.residuals.clone(),
        }
    }

    /// Reads and checks a file.
    pub fn read(path: &Path) -> Result<Self, DataError> {
        let read: Self = parse_toml(&read_text(path)?, path)?;
        let bad = |field: &str, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if read.version != 1 {
            return bad("version", read.version.to_string(), "1");
        }
        if !read.position.iter().all(|value| value.abs() <= MAX_BASE_OFFSET.0) {
            return bad("position", format!("{:?}", read.position), "at most 0.1 m from the base's nominal position");
        }
        let norm = read.quaternion.iter().map(|value| value * value).sum::<f64>().sqrt();
        if !(1.0 - 1e-6..1.0 + 1e-6).contains(&norm) {
            return bad("quaternion", format!("{:?}", read.quaternion), "four numbers of norm 1");
        }
        let angle = read.world_from_base().rotation.angle();
        if angle > MAX_BASE_OFFSET.1 {
            return bad("quaternion", format!("a rotation of {:.3} rad", angle), "at most 0.2 rad");
        }
        if !read.sigma.iter().all(|value| *value > 0.0 && value.is_finite()) {
            return bad("sigma", format!("{:?}", read.sigma), "six numbers more than 0");
        }
        Ok(read)
    }

    /// Formats the file as TOML.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }

    /// Returns the pose of the arm's base.
    pub fn world_from_base(&self) -> Isometry3<f64> {
        let [i, j, k, w] = self.quaternion;
        Isometry3::from_parts(
            Translation3::from(self.position),
            UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k)),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_as_it_was_written_and_checked() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("registration.toml");
        let pose = Isometry3::new([0.01, -0.004, 0.002].into(), [0.01, 0.0, -0.02].into());
        let q: [f64; 4] = pose.rotation.coords.into();
        let file = RegistrationFile {
            version: 1,
            position: pose.translation.vector.into(),
            quaternion: q,
            sigma: [0.001; 6],
            residuals: vec![0.0005; 3],
        };
        let text = file.to_toml().expect("TOML");
        std::fs::write(&path, &text).expect("written");
        let read = RegistrationFile::read(&path).expect("good");
        assert_eq!(read, file);
        assert!((read.world_from_base().inverse() * pose).rotation.angle() < 1e-12);
        let error = |from: &str, to: &str| {
            assert!(text.contains(from), "{text}");
            std::fs::write(&path, text.replace(from, to)).expect("written");
            RegistrationFile::read(&path).expect_err("bad").to_string()
        };
        for (from, to, words) in [
            ("version = 1", "version = 2", "version: found 2, expected 1"),
            ("position = [0.01,", "position = [1.01,", "expected at most 0.1 m"),
            ("position = [0.01,", "position = [nan,", "position: found"),
            ("quaternion = [", "quaternion = [0.3, ", "expected"),
            ("sigma", "sigmas", "sigmas"),
            ("sigma = [0.001", "sigma = [-0.001", "more than 0"),
        ] {
            let message = error(from, to);
            assert!(message.contains(words) && message.contains("registration.toml"), "{message}");
        }
    }
}
