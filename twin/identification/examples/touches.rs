use hand_model::robot::Robot;
use hand_model::transmission::friction::CableLosses;
use hand_model::{Arm, Hand};
use identification::Script;
use identification::evaluation::*;
use identification::excitation::{Means, Progress, play};
use identification::kinematic_calibration::calibrate;
use identification::touches::touches;
use identification::trace::Kept;
use nalgebra::{Isometry3, Translation3};
use scenarios::Scenario;
use scenarios::individuals::robot::RobotIndividual;
use sim::tactile::TactileBoard;

static LOG: std::sync::Mutex<Vec<([f64; 7], Vec<f64>)>> = std::sync::Mutex::new(vec![]);
struct Probe {
    robot: sim::SimulatedRobot,
}
impl Robot for Probe {
    fn observe(&mut self) -> hand_model::robot::Observation {
        let o = self.robot.observe();
        if std::env::var("FORCES").is_ok() {
            let t = self.robot.truth();
            if o.time < 40.0 && t.pad_forces.iter().any(|f| *f > 0.0) {
                let (n, f) = t.pad_forces.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
                println!("F {:.4} pad {n} {f:.4} captured {}", o.time, !o.tactile.is_empty());
            }
        }
        if !o.tactile.is_empty() {
            let t = self.robot.truth();
            LOG.lock().unwrap().push((o.arm.position, t.hand.to_vec()));
        }
        o
    }
    fn send(&mut self, c: &hand_model::robot::Command) -> hand_model::robot::Command {
        self.robot.send(c)
    }
    fn wait_for_tick(&mut self) -> hand_model::robot::Tick {
        self.robot.wait_for_tick()
    }
    fn tick_length(&self) -> f64 {
        self.robot.tick_length()
    }
}
fn main() {
    let number: u64 = std::env::args().nth(1).unwrap().parse().unwrap();
    let (hand, arm) = (Hand::ftac(), Arm::gen3());
    let losses = CableLosses { friction: hand.parameters.cable.friction, backlash: 0.0044 };
    let pads: touch::PhotometricCalibration =
        serde_json::from_str(include_str!("../../bench/data/calibration.json")).unwrap();
    let script = Script::standard();
    let ball = script.ball.clone().unwrap();
    let truth = RobotIndividual::draw(&hand, number);
    let own = (truth.hand(&hand), truth.arm(&arm));
    let place = true_place(&ball, number);
    let surroundings = Surroundings {
        board: TactileBoard::unit(&own.0, RobotIndividual::cameras(number).unwrap_or(7)).with_noise(1),
        gel: Scenario::benchmark().effects.gel,
        ball: Some((Isometry3::from(Translation3::from(place)), ball.radius)),
    };
    let robot = excited_body(&truth, (&hand, &arm), losses, Arm::home(), &surroundings).unwrap();
    let probe = Probe { robot };
    let mut kept = Kept::new(probe);
    let means = Means { hand: &hand, arm: &arm, pads: &pads, script: &script, ready: Arm::home() };
    let first = script.posture.len() * script.motion.len();
    let begun = std::time::Instant::now();
    let heard = |progress| {
        match progress {
            Progress::OutOfReach(n) => println!("step {n}: out of reach"),
            Progress::Done(n) if n % 10 == 0 => eprintln!("{n} {:?}", begun.elapsed()),
            _ => {}
        }
        Ok::<(), ()>(())
    };
    play(&mut kept, &means, first, heard, |_| true).unwrap();
    println!("sim time {}", kept.observe().time);
    let trace = kept.trace("sim", &script);
    println!("{} images in {:?}", trace.pressed.len(), begun.elapsed());
    let felt = touches(&hand, &pads, ball.radius, &trace.pressed);
    for touch in &felt {
        println!("S {} {}", hand.cameras[touch.camera].name, touch.is_on_stops(&hand, &ball));
    }
    println!("{} touches {:?}", felt.len(), begun.elapsed());
    let designed = RobotIndividual::designed(&hand);
    let found = calibrate((&hand, &arm), &ball, &designed, &felt);
    println!("{:?} residuals {:?} ball off {:?}", begun.elapsed(), found.residuals, (found.ball - place));
    // By the truth: where each touch has the ball, pad frame.
    for touch in &felt {
        let pad = &own.0.pads[own.0.cameras[touch.camera].pad];
        let palm = own.1.tool_pose(&touch.arm) * own.0.palm_from_flange.inverse();
        let pose = palm * identification::ball::palm_from_pad(&own.0, own.0.cameras[touch.camera].pad);
        let off = touch.center - pose.inverse() * place;
        let joints: Vec<String> = pad
            .link
            .map_or(vec![], |link| hand.tree.chain(link))
            .iter()
            .map(|j| {
                LOG.lock()
                    .unwrap()
                    .iter()
                    .filter(|l| l.0 == touch.arm)
                    .map(|l| format!("{:.4}", l.1[*j]))
                    .next()
                    .unwrap_or_default()
            })
            .collect();
        let name = &hand.cameras[touch.camera].name;
        println!(
            "{name:20} center {:6.2} {:6.2} {:6.2} off by {:6.2} {:6.2} {:6.2} mm opp {:.4} {:?}",
            1e3 * touch.center.x,
            1e3 * touch.center.y,
            1e3 * touch.center.z,
            1e3 * off.x,
            1e3 * off.y,
            1e3 * off.z,
            touch.opposition,
            joints
        );
    }
    for (n, place) in found.places.iter().enumerate() {
        let parameter = &truth.parameters()[*place];
        let (t, f, s) =
            (truth.deviations()[*place], found.individual.deviations()[*place], found.covariance[(n, n)].sqrt());
        println!(
            "{:24} truth {:9.5} found {:9.5} sigma {:9.5} z {:6.2} spread {:.5}",
            parameter.name,
            t,
            f,
            s,
            (f - t) / s,
            parameter.spread.sigma
        );
    }
    for own in [&designed, &found.individual] {
        println!("reach {:.3} mm", 1e3 * median(&reach(&truth, own, (&hand, &arm), &Arm::home(), 0.4)));
    }
}
