//! The twin beside a simulated robot: residuals of a sound one are small in free motion, those of a broken one are not.

use bench::mirror::twin::Twin;
use hand_model::robot::{Command, Robot, ServoGoal};
use hand_model::{Arm, Digit};
use proving::world::World;
use scenarios::Scenario;
use sim::tactile::TactileBoard;
use sim::{SceneSetup, SimulatedRobot};

/// What the residual of a taut cable of a sound robot in free motion stays within, N (recordings/log/mirror.md, rounded up).
const SOUND: f64 = 0.1;
/// Time over which the cables are wound, and of the whole motion, s.
const WINDING: f64 = 1.0;
const END: f64 = 2.0;
/// When the cable breaks, s.
const BREAK: f64 = 1.5;

/// Residuals of the five cables, N, mean of each four ticks, with the time of the last (s), of a robot as drawn that closes its hand on
/// nothing while its arm moves; cable `broken` breaks at [`BREAK`].
fn residuals(broken: Option<usize>) -> Vec<(f64, [f64; 5])> {
    let world = World::new(Scenario::benchmark()).expect("the world");
    let cell = &world.cell;
    let setup = SceneSetup { cables: world.cable_losses(), ..SceneSetup::ideal(cell.world_from_base, Arm::home()) };
    let mut robot = SimulatedRobot::new(cell.hand.clone(), cell.arm.clone(), &setup, TactileBoard::blank());
    let mut twin = Twin::new(&world, &robot.observe().arm.position);
    let mut broken = broken;
    let mut all = Vec::new();
    while robot.time() < END {
        let seen = robot.observe();
        if let Some(n) = broken.take_if(|_| seen.time >= BREAK) {
            robot.break_cable(n);
        }
        let innovation = twin.correct(&seen.servos, &seen.arm);
        all.push((seen.time, innovation.loads));
        let mut arm = Arm::home();
        arm[0] += 0.1 * seen.time;
        let mut servos = [ServoGoal::Current(0.05 * (seen.time / WINDING).min(1.0)); 6];
        servos[5] = ServoGoal::Current(0.0);
        let sent = robot.send(&Command { arm, servos, capture: false });
        twin.follow(&sent);
        robot.wait_for_tick();
    }
    let mean = |ticks: &[(f64, [f64; 5])]| {
        let loads = std::array::from_fn(|n| ticks.iter().map(|(_, loads)| loads[n]).sum::<f64>() / ticks.len() as f64);
        (ticks[ticks.len() - 1].0, loads)
    };
    all.chunks_exact(4).map(mean).collect()
}

/// Of a sound robot every residual is small, of a broken cable it is a pull that lasts; the other cables show nothing of it.
#[test]
fn a_broken_cable_leaves_what_a_sound_one_stays_within() {
    let ring = Digit::Ring.index();
    for (time, loads) in residuals(None) {
        assert!(loads.iter().all(|load| load.abs() < SOUND), "at {time} s: {loads:?}");
    }
    for (time, loads) in residuals(Some(ring)) {
        for (n, load) in loads.iter().enumerate().filter(|(n, _)| *n != ring || time < BREAK) {
            assert!(load.abs() < SOUND, "cable {n} at {time} s: {load}");
        }
        assert!(time < BREAK + 0.1 || loads[ring] < -10.0 * SOUND, "at {time} s: {loads:?}");
    }
}
