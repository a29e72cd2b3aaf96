//! Names of ROS 2 topics and types in DDS.

/// Prefix of topics; services and actions have others.
const TOPIC_PREFIX: &str = "rt";

/// Error of a name that is not one of ROS 2.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("topic: found `{found}`, expected {expected}")]
pub struct NameError {
    /// Name found.
    pub found: String,
    /// Form of a valid name.
    pub expected: &'static str,
}

/// Returns the DDS topic of an absolute ROS 2 topic, such as `rt/joint_states` of `/joint_states`.
///
/// # Errors
/// [`NameError`] for a name that does not begin with `/`, or has other characters than letters, digits, `_` and `/`.
///
/// ```
/// use robot_ros2_messages::names::dds_topic;
///
/// assert_eq!(dds_topic("/arm/joint_states")?, "rt/arm/joint_states");
/// assert!(dds_topic("joint_states").is_err());
/// # Ok::<(), robot_ros2_messages::names::NameError>(())
/// ```
pub fn dds_topic(topic: &str) -> Result<String, NameError> {
    let fault = |expected| NameError { found: topic.to_owned(), expected };
    let Some(tokens) = topic.strip_prefix('/') else {
        return Err(fault("an absolute name, which begins with `/`"));
    };
    for token in tokens.split('/') {
        let starts = token.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
        if !starts || !token.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
            return Err(fault("names of letters, digits and `_` between `/`, none of which begins with a digit"));
        }
    }
    Ok(format!("{TOPIC_PREFIX}{topic}"))
}

/// Returns the DDS type of a ROS 2 type, such as `sensor_msgs::msg::dds_::Image_` of `sensor_msgs/msg/Image`.
///
/// ```
/// use robot_ros2_messages::names::dds_type;
///
/// assert_eq!(dds_type("sensor_msgs/msg/JointState"), "sensor_msgs::msg::dds_::JointState_");
/// ```
pub fn dds_type(name: &str) -> String {
    let (package, kind) = name.rsplit_once('/').unwrap_or(("", name));
    format!("{}::dds_::{kind}_", package.replace('/', "::"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_ros_refuses_are_refused() {
        for bad in ["joint_states", "/", "/a//b", "/a/", "/1a", "/a b", "/a/{b}", ""] {
            let error = dds_topic(bad).expect_err("refused").to_string();
            assert!(error.starts_with(&format!("topic: found `{bad}`, expected ")), "{error}");
        }
        assert_eq!(dds_topic("/tactile/palm_1/image_raw").as_deref(), Ok("rt/tactile/palm_1/image_raw"));
    }
}
