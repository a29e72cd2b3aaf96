//! The client of the arm that a configuration names.

use std::time::Duration;

use anyhow::{Context as _, Result};
use hand_model::ARM_JOINTS;
use hardware_bridge::arm_link::{ArmLink, LoopbackArm};
use hardware_bridge::config::{ArmConfig, BridgeConfig};
use hardware_bridge::kortex_link::KortexLink;
use kortex::{Address, Credentials, Timeouts};

/// The client of the configured arm, connected. `near` is the posture it is expected in, rad.
pub fn arm_link(config: &BridgeConfig, near: [f64; ARM_JOINTS]) -> Result<Box<dyn ArmLink>> {
    match &config.arm {
        ArmConfig::Loopback => Ok(Box::new(LoopbackArm::at(near))),
        ArmConfig::Kortex { host, tcp_port, udp_port, user, password } => {
            let address = Address { tcp: (*host, *tcp_port).into(), udp: (*host, *udp_port).into() };
            let credentials = Credentials { user: user.clone(), password: password.clone() };
            let arm = kortex::Arm::connect(address, &credentials, Timeouts::default(), near)
                .with_context(|| format!("arm at {host}"))?;
            let tick = Duration::from_secs_f64(1.0 / config.servos.rate);
            Ok(Box::new(KortexLink::new(arm, tick, Duration::from_secs_f64(config.limits.arm_watchdog))))
        }
    }
}
