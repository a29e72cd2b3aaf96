//! Both interfaces of one arm: calls and cyclic exchange.

use std::net::{IpAddr, SocketAddr};

use crate::base::Base;
use crate::call;
use crate::cyclic::Cyclic;
use crate::error::KortexError;
use crate::joints::JOINTS;
use crate::session::{Credentials, Timeouts};
use crate::tap::Tap;

/// The arm's port for calls.
pub const TCP_PORT: u16 = 10_000;
/// The arm's port for the cyclic exchange.
pub const UDP_PORT: u16 = 10_001;

/// Addresses of both interfaces.
///
/// # Example
/// ```
/// use kinova_kortex::Address;
///
/// let address = Address::of("192.168.1.10".parse()?);
/// assert_eq!(address.tcp.to_string(), "192.168.1.10:10000");
/// assert_eq!(address.udp.to_string(), "192.168.1.10:10001");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Address {
    /// Address for calls.
    pub tcp: SocketAddr,
    /// Address for the cyclic exchange.
    pub udp: SocketAddr,
}

impl Address {
    /// Returns the address of an arm on its usual ports.
    pub fn of(host: IpAddr) -> Self {
        Self { tcp: (host, TCP_PORT).into(), udp: (host, UDP_PORT).into() }
    }
}

/// An arm with a session on each interface.
///
/// # Example
/// ```
/// # use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
/// # use kinova_kortex::{Arm, Timeouts, gen3};
/// # let settings = Settings { cyclic_deadline: 60_000, ..Settings::default() };
/// # let credentials = settings.credentials.clone();
/// # let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
/// # let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
/// let angles = arm.cyclic.feedback()?.motion.position;
/// assert!((angles[3] - gen3::HOME[3]).abs() < 1e-5);
/// // While nothing else is done with the arm, both sessions are kept alive.
/// for _ in 0..3 {
///     arm.keep_up()?;
///     std::thread::sleep(std::time::Duration::from_millis(5));
/// }
/// arm.close()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Arm {
    /// Interface for calls.
    pub base: Base,
    /// Interface of the cyclic exchange.
    pub cyclic: Cyclic,
}

impl Arm {
    /// Logs in on both interfaces and checks that the arm has seven joints. Nothing moves and no mode changes. `near` (rad)
    /// selects the turn in which the first angles are read.
    ///
    /// # Errors
    /// The link's and the login's; [`KortexError::Answer`] for another arm.
    pub fn connect(
        address: Address,
        credentials: &Credentials,
        timeouts: Timeouts,
        near: [f64; JOINTS],
    ) -> Result<Self, KortexError> {
        let mut base = Base::connect(address.tcp, credentials, timeouts)?;
        let count = base.actuator_count()?;
        if count as usize != JOINTS {
            return Err(KortexError::Answer {
                call: call::GET_ACTUATOR_COUNT,
                field: "number of actuators",
                found: count.to_string(),
                expected: JOINTS.to_string(),
            });
        }
        let cyclic = Cyclic::connect(address.udp, credentials, timeouts, near)?;
        Ok(Self { base, cyclic })
    }

    /// Copies everything that crosses the two links from now on: calls into `tcp`, the cyclic exchange into `udp`.
    pub fn tap(&mut self, tcp: Tap, udp: Tap) {
        self.base.tap(tcp);
        self.cyclic.tap(udp);
    }

    /// Keeps both sessions alive without waiting. Call it every few milliseconds while not servoing.
    ///
    /// # Errors
    /// As [`crate::session::Session::keep_up`].
    pub fn keep_up(&mut self) -> Result<(), KortexError> {
        self.base.keep_up()?;
        self.cyclic.keep_up()
    }

    /// Logs out on both interfaces.
    ///
    /// # Errors
    /// The first of the two that fails; both are tried.
    pub fn close(self) -> Result<(), KortexError> {
        let cyclic = self.cyclic.close();
        self.base.close()?;
        cyclic
    }
}
