//! Client of the configured arm.

use std::io::ErrorKind;
use std::net::ToSocketAddrs as _;
use std::time::Duration;

use anyhow::{Context as _, Result};
use hand_model::{ArmVector, RobotModel};
use hardware_bridge::arm_link::{ArmLink, LoopbackArm};
use hardware_bridge::config::secrets::Password;
use hardware_bridge::config::{ArmConfig, BridgeConfig};
use hardware_bridge::kortex_link::{KortexLink, to_gen3};
use hardware_bridge::supported_robot::check_supported;
use kinova_kortex::link::LinkError;
use kinova_kortex::refusal::Reason;
use kinova_kortex::{Address, Credentials, KortexError, Timeouts};

/// Connects the client of the configured arm of `robot`. `near` is the posture in which the arm is expected, rad.
pub fn connect_arm_link(config: &BridgeConfig, robot: &RobotModel, near: ArmVector) -> Result<Box<dyn ArmLink>> {
    check_supported(robot)?;
    Ok(match connect_arm(config, near)? {
        None => Box::new(LoopbackArm::at(near)),
        Some(arm) => {
            let tick = Duration::from_secs_f64(1.0 / config.servos.rate);
            Box::new(KortexLink::new(arm, &robot.arm, tick, Duration::from_secs_f64(config.limits.arm_watchdog)))
        }
    })
}

/// Connects the configured arm itself, if there is one.
pub fn connect_arm(config: &BridgeConfig, near: ArmVector) -> Result<Option<kinova_kortex::Arm>> {
    let ArmConfig::Kortex { host, tcp_port, udp_port, user, password, .. } = &config.arm else { return Ok(None) };
    let resolved = |port: u16| {
        let mut found = (host.as_str(), port).to_socket_addrs().with_context(|| format!("arm at {host}"))?;
        found.next().with_context(|| format!("arm at {host}: the name has no address"))
    };
    let address = Address { tcp: resolved(*tcp_port)?, udp: resolved(*udp_port)? };
    let password = password.as_ref().map(Password::reveal).unwrap_or_default().to_owned();
    let credentials = Credentials { user: user.clone(), password };
    let arm = kinova_kortex::Arm::connect(address, &credentials, Timeouts::default(), to_gen3(&near))
        .map_err(|error| anyhow::anyhow!("arm at {host}, port {tcp_port}: {error}; {}", advice(&error)))?;
    Ok(Some(arm))
}

/// Returns advice on an arm that cannot be connected.
fn advice(error: &KortexError) -> &'static str {
    match error {
        KortexError::Link(LinkError::Io(error)) if error.kind() == ErrorKind::ConnectionRefused => {
            "something answers at this address, but no arm at this port: check address and port, and whether the arm has started"
        }
        KortexError::Link(_) | KortexError::Timeout { .. } | KortexError::Silent { .. } => {
            "check the network cable, the address and the arm's supply"
        }
        KortexError::Refused { refusal, .. } => match refusal.reason {
            Reason::Login => "check `user` and the password",
            Reason::NotInControl => "end the other client: the arm's web page, or another program",
            Reason::NotReady => "wait until it has started",
            _ => "see the arm's web page",
        },
        _ => "see the arm's web page",
    }
}
