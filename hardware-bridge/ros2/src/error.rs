//! Errors of the ROS 2 connection.

use std::net::IpAddr;

use robot_ros2_messages::CdrError;
use robot_ros2_messages::names::NameError;

/// Error of a node or one of its topics.
#[derive(Debug, thiserror::Error)]
pub enum Ros2Error {
    /// The domain does not exist.
    #[error("domain: found {0}, expected 0 to {max}", max = crate::node::MAX_DOMAIN)]
    Domain(u16),
    /// This computer does not have the address.
    #[error("interface: found {address}, expected an address of this computer ({source})")]
    Interface {
        /// The address.
        address: IpAddr,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The topic's name is not one of ROS 2.
    #[error(transparent)]
    Name(#[from] NameError),
    /// The DDS library refuses.
    #[error("{item} on domain {domain}: {reason}")]
    Dds {
        /// Part that could not be made or used, such as a topic.
        item: String,
        /// Number of the domain.
        domain: u16,
        /// Reason of the library.
        reason: String,
    },
    /// No message arrived within the time limit.
    #[error("{topic} on domain {domain}: found no message within {seconds} s ({found}), expected one of {kind}")]
    Silent {
        /// Name of the topic.
        topic: String,
        /// Number of the domain.
        domain: u16,
        /// Time limit, s.
        seconds: f64,
        /// Publishers of the topic that were discovered, in words.
        found: String,
        /// Type of the message, `package/msg/Type`.
        kind: &'static str,
    },
    /// A message could not be read.
    #[error("{topic} on domain {domain}: {source}")]
    Message {
        /// Name of the topic.
        topic: String,
        /// Number of the domain.
        domain: u16,
        /// Field at fault.
        source: CdrError,
    },
}
