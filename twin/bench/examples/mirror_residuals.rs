//! Residuals of a twin beside a simulated robot in a blind trial, as a table in a file; with a fault of the plant on request.
//!
//! `mirror_residuals COMBO TRIAL PLANT FAULT PHASE PROGRESS FILE`; FAULT is none, break1, break3, slip1, slip3, stick, heavy, weak1, weak3, push or
//! lose (digits are counted from the thumb, 0). What stands in the file of the true scene is for the reader alone.
use bench::body::Body;
use bench::builtin::{hide_plant, make_scenes};
use bench::mirror::twin::Twin;
use bench::trial::setup::Setup;
use control::executive::Phase;
use hand_model::robot::*;
use scenarios::Scenario;
use std::io::Write;

fn main() -> anyhow::Result<()> {
    let a: Vec<String> = std::env::args().collect();
    let (combo, trial, plant, fault, phase, at): (usize, usize, u64, &str, &str, f64) =
        (a[1].parse()?, a[2].parse()?, a[3].parse()?, &a[4], &a[5], a[6].parse()?);
    let mut out = std::fs::File::create(&a[7])?;
    let mut bench = make_scenes(Scenario::benchmark(), combo + 1, 1, true)?;
    if plant > 0 {
        hide_plant(&mut bench, plant);
    }
    let (setup, _) = Setup::noisy(&bench, combo, trial)?;
    let start = setup.begin(&bench, None, true)?;
    let second = start.grasps.second[0].grasp.clone();
    let mut snap = start.run.snapshot;
    let Body::Simulated(robot) = &mut snap.robot else { unreachable!() };
    let ex = &mut snap.executive;
    let hand = bench.world.cell.hand.clone();
    let mut twin: Option<Twin> = None;
    let mut struck = None;
    let mut spent = std::time::Duration::ZERO;
    let mut n = 0;
    writeln!(
        out,
        "t phase fault | l0..4 | T0..4 | cmd0..4 | x0..4 mm | arm torque | twin angles middle | truth middle | opp"
    )?;
    while ex.phase() < Phase::Done {
        match ex.phase() {
            Phase::Decide => ex.decide(second.clone())?,
            Phase::Confirm => ex.confirm()?,
            _ => {}
        }
        let obs = robot.observe();
        let cmd = ex.tick(&obs)?;
        let sent = robot.send(&cmd);
        let name = ex.phase().name();
        if struck.is_none() && name == phase && ex.progress() >= at {
            struck = Some(obs.time);
            println!("fault at {}", obs.time);
            match fault {
                "break1" => robot.break_cable(1),
                "break3" => robot.break_cable(3),
                "slip1" => robot.slip_cable(1, 0.002),
                "slip3" => robot.slip_cable(3, 0.002),
                "stick" => robot.stick_joint(7),
                "heavy" => robot.add_mass(0, 0.4),
                "weak1" => robot.weaken_servo(1, 0.6),
                "weak3" => robot.weaken_servo(3, 0.6),
                _ => {}
            }
        }
        if let Some(t0) = struck {
            if fault == "push" && obs.time < t0 + 0.5 {
                robot.pull(None, nalgebra::Vector3::new(10.6, 10.6, 0.0));
            }
            if fault == "lose" && obs.time < t0 + 0.5 {
                robot.set_friction(0, 0.05);
                robot.pull(Some(0), nalgebra::Vector3::new(0.0, 0.0, -6.0));
            }
        }
        let begun = std::time::Instant::now();
        let twin = twin.get_or_insert_with(|| Twin::new(&bench.world, &obs.arm.position));
        let i = twin.correct(&obs.servos, &obs.arm);
        twin.follow(&sent);
        spent += begun.elapsed();
        n += 1;
        let f = |v: &[f64], s: f64| v.iter().map(|x| format!("{:.3}", x * s)).collect::<Vec<_>>().join(" ");
        let c: Vec<f64> = (0..5)
            .map(|n| match sent.servos[n] {
                ServoGoal::Current(c) => c * hand.servos[n].torque_constant / hand.cables[n].spool_radius,
                _ => 0.0,
            })
            .collect();
        let x: Vec<f64> = (0..5).map(|n| obs.servos[n].position * hand.cables[n].spool_radius * 1e3).collect();
        let truth = robot.truth();
        writeln!(
            out,
            "{:.4} {} {} {} {} {} {} {} {} {} {:.4} {} {}",
            obs.time,
            name.replace(' ', "_"),
            u8::from(struck.is_some()),
            f(&i.loads, 1.0),
            f(&i.tensions, 1.0),
            f(&c, 1.0),
            f(&x, 1.0),
            f(&i.arm_torque, 1.0),
            f(&twin.robot().finger_angles()[6..9], 1.0),
            f(&truth.hand[6..9], 1.0),
            i.opposition,
            truth.touched_by[0],
            truth.touched_by[1],
        )?;
        robot.wait_for_tick();
        if struck.is_some_and(|t| obs.time > t + 1.5) {
            break;
        }
    }
    println!("{n} ticks, {:.3} ms a tick", 1e3 * spent.as_secs_f64() / n as f64);
    Ok(())
}
