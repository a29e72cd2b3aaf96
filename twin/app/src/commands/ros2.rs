//! `ftac ros2`: publishes recorded sessions on ROS 2 topics.

use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clap::{Args, Subcommand};
use hand_model::RobotModel;
use nalgebra::Isometry3;
use progress::interrupt::Interrupt;
use robot_ros2::{RobotPublisher, Ros2Node};
use robot_session_log::{RobotSizes, SessionEvent, SessionReader};
use schemars::JsonSchema;
use serde::Serialize;

use super::export::robot_of_session;
use crate::options::ros2::{hand_angles, wall_time};
use crate::terminal::{Outcome, Terminal};

/// Longest wait for subscribers to acknowledge the last messages.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(2);

/// `ros2` commands.
#[derive(Debug, Subcommand)]
pub enum Ros2Command {
    /// Publish a session (MCAP) at its own pace: joint states, frames, robot description, commands and tactile images, as
    /// RViz shows them. Needs no ROS installation.
    Publish(PublishArgs),
}

/// Arguments of `ros2 publish`.
#[derive(Debug, Args)]
pub struct PublishArgs {
    /// Session file.
    session: PathBuf,
    #[command(flatten)]
    network: NetworkArgs,
    /// Playing speed: 2 is twice as fast as the robot was.
    #[arg(long, default_value_t = 1.0)]
    speed: f64,
    /// Wait up to this time for a subscriber of /joint_states before the session begins, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 0)]
    wait: u32,
    /// Begin again at the end, until interrupted.
    #[arg(long)]
    repeat: bool,
}

/// Options for the ROS 2 network.
#[derive(Debug, Clone, Args)]
pub struct NetworkArgs {
    /// ROS 2 domain (ROS_DOMAIN_ID of the subscribers).
    #[arg(long, value_name = "N", default_value_t = 0)]
    domain: u16,
    /// Address of this computer whose network alone is used; default: all networks.
    #[arg(long, value_name = "ADDRESS")]
    interface: Option<IpAddr>,
}

/// JSON output of `ros2 publish`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PublishOutput {
    /// Number of the domain.
    domain: u16,
    /// True if a subscriber of /joint_states was found before the session began; null without --wait.
    subscriber: Option<bool>,
    /// Number of published observations.
    observations: u64,
    /// Number of published images.
    images: u64,
    /// Number of messages left out because a subscriber was too slow.
    left_out: u64,
}

pub fn run(terminal: &Terminal, command: &Ros2Command) -> Outcome {
    match command {
        Ros2Command::Publish(args) => publish(terminal, args),
    }
}

fn publish(terminal: &Terminal, args: &PublishArgs) -> Outcome {
    if !(args.speed.is_finite() && args.speed > 0.0) {
        bail!("--speed: found {}, expected a number above 0", args.speed);
    }
    // A session that cannot be read is refused before anything is announced.
    let robot = robot_of_session(&SessionReader::open(&args.session, RobotSizes::Any)?)?;
    let node = Ros2Node::new(args.network.domain, args.network.interface)?;
    let mut publisher = RobotPublisher::new(&node, &robot, &Isometry3::identity(), wall_time())?;
    let found = (args.wait > 0).then(|| publisher.wait_for_subscriber(Duration::from_secs(args.wait.into())));
    if found == Some(false) && !terminal.quiet {
        eprintln!("no subscriber of /joint_states on domain {} within {} s", node.domain(), args.wait);
    }
    let interrupt = Interrupt::catch()?;
    let mut done = Published::default();
    loop {
        play(&mut publisher, &robot, args, &interrupt, &mut done)?;
        if !args.repeat || interrupt.happened() {
            break;
        }
    }
    publisher.flush(FLUSH_TIMEOUT);
    let output = PublishOutput {
        domain: node.domain(),
        subscriber: found,
        observations: done.observations,
        images: done.images,
        left_out: publisher.unsent(),
    };
    let text = format!(
        "{} observations and {} images published on domain {}, {} messages left out\n",
        output.observations, output.images, output.domain, output.left_out
    );
    terminal.print(&output, &text)?;
    Ok((output.observations == 0)
        .then(|| format!("{}: found no measurements, expected a session that began", args.session.display())))
}

/// Counts of published messages.
#[derive(Default)]
struct Published {
    observations: u64,
    images: u64,
}

/// Publishes the session once, each observation at its time on the robot's clock.
fn play(
    publisher: &mut RobotPublisher,
    robot: &RobotModel,
    args: &PublishArgs,
    interrupt: &Interrupt,
    done: &mut Published,
) -> Result<()> {
    let mut reader = SessionReader::open(&args.session, RobotSizes::from_robot(robot))?;
    let (start, mut first) = (Instant::now(), None);
    while let Some((_, event)) = reader.next_event()? {
        if interrupt.happened() {
            return Ok(());
        }
        match event {
            SessionEvent::Observation(readings) => {
                let elapsed = (readings.time - *first.get_or_insert(readings.time)) / args.speed;
                let due = Duration::try_from_secs_f64(elapsed)
                    .ok()
                    .with_context(|| backwards(&args.session, readings.time))?;
                std::thread::sleep(due.saturating_sub(start.elapsed()));
                let fingers = hand_angles(&robot.hand, &readings);
                publisher.send_readings(wall_time(), &readings, fingers.as_deref())?;
                done.observations += 1;
                done.images += readings.tactile.len() as u64;
            }
            SessionEvent::SentCommand(command) => publisher.send_command(wall_time(), &command)?,
            _ => {}
        }
    }
    Ok(())
}

fn backwards(session: &Path, time: f64) -> String {
    format!("{}: time: found {time} s, expected a time after that of the first observation", session.display())
}
