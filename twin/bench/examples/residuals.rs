//! Residuals between the reference model and the simulated robot of a blind trial, as comma-separated values, with an
//! optional injected fault.
//!
//! `residuals COMBINATION TRIAL PLANT FAULT PHASE PROGRESS FILE` runs trial TRIAL (seed 1, all effects) with the
//! nominal robot (PLANT 0) or with robot instance PLANT, unknown to the controller. FAULT is injected once phase PHASE
//! has reached PROGRESS (0 to 1), and the trial ends 1.5 s later. FAULT is one of `none`, `break N`, `slip N` (2 mm)
//! and `weak N` (0.6 of the torque), where N is a digit counted from the thumb's 0; `stick J` (finger joint J); `heavy`
//! (the first object, by 0.4 kg); and `push` (15 N on the palm for half a second). A fault and its number are one
//! argument.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use bench::builtin::{make_scene_bench, set_plant_instance};
use bench::trial::setup::InitialConditions;
use fault_detection::reference_model::ReferenceModel;
use hand_model::RobotModel;
use nalgebra::Vector3;
use robot_backends::Backend;
use scenarios::Scenario;
use sim::SimulatedRobot;

/// Duration of the trial after the fault, s.
const TIME_AFTER_FAULT: f64 = 1.5;
/// Force on the palm, world axes, N, and its duration, s.
const PUSH_FORCE_AND_DURATION: (Vector3<f64>, f64) = (Vector3::new(10.6, 10.6, 0.0), 0.5);

/// Injects the fault that `fault` names.
fn inject_fault(robot: &mut SimulatedRobot, fault: &str) -> anyhow::Result<()> {
    let (what, number) = fault.split_once(' ').unwrap_or((fault, ""));
    let below = |end: usize| -> anyhow::Result<usize> {
        let n = number.parse().with_context(|| format!("FAULT: a number after \"{what}\", not \"{number}\""))?;
        ensure!(n < end, "FAULT: {n} after \"{what}\", expected a number below {end}");
        Ok(n)
    };
    match what {
        "none" | "push" => {}
        "break" => robot.break_cable(below(5)?),
        "slip" => robot.slip_cable(below(5)?, 0.002),
        "weak" => robot.weaken_servo(below(5)?, 0.6),
        "stick" => robot.stick_joint(below(15)?),
        "heavy" => robot.add_mass(0, 0.4),
        _ => bail!("FAULT: \"{fault}\", expected none, break N, slip N, weak N, stick J, heavy or push"),
    }
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [combination, trial, plant, fault, phase, progress, file] = &arguments[..] else {
        bail!("expected COMBINATION TRIAL PLANT FAULT PHASE PROGRESS FILE, found {} arguments", arguments.len());
    };
    let (combination, trial): (usize, usize) = (combination.parse()?, trial.parse()?);
    let (plant, progress): (u64, f64) = (plant.parse()?, progress.parse()?);
    let mut bench = make_scene_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), combination + 1, 1, true)?;
    if plant > 0 {
        set_plant_instance(&mut bench, plant)?;
    }
    let (setup, _) = InitialConditions::noisy(&bench, combination, trial)?;
    let start = setup.begin(&bench, None, true)?;
    let mut finished = start.run.snapshot;
    let Backend::Simulated(robot) = &mut finished.robot else { bail!("the backend is not the simulated one") };
    let executor = &mut finished.executor;
    let mut out = BufWriter::new(File::create(file).with_context(|| file.clone())?);
    writeln!(out, "time_s,phase,struck,loads_n,opposition_nm,twin_tensions_n,arm_torques_nm,servos_rad")?;
    let mut twin: Option<ReferenceModel> = None;
    let mut struck: Option<f64> = None;
    let (mut spent, mut ticks) = (Duration::ZERO, 0u32);
    while !executor.phase().is_done() {
        executor.continue_as_planned()?;
        let seen = robot.observe();
        let command = executor.tick(&seen)?;
        let sent = robot.send(&command);
        let name = executor.phase().name();
        if struck.is_none() && name == *phase && executor.motion().progress() >= progress {
            inject_fault(robot, fault)?;
            struck = Some(seen.time);
        }
        if fault == "push" && struck.is_some_and(|at| seen.time < at + PUSH_FORCE_AND_DURATION.1) {
            robot.apply_force(None, PUSH_FORCE_AND_DURATION.0);
        }
        let begun = Instant::now();
        let twin = twin.get_or_insert_with(|| ReferenceModel::new(&bench.world, &seen.arm.position));
        let innovation = twin.correct(&seen.servos, &seen.arm, false);
        twin.advance_with(&sent);
        spent += begun.elapsed();
        ticks += 1;
        let row = |values: &[f64]| values.iter().map(|value| format!("{value:.4}")).collect::<Vec<_>>().join(" ");
        writeln!(
            out,
            "{:.4},{name},{},{},{:.4},{},{},{}",
            seen.time,
            u8::from(struck.is_some()),
            row(&innovation.loads),
            innovation.opposition,
            row(&innovation.tensions),
            row(&innovation.arm_torque),
            row(&seen.servos.iter().map(|servo| servo.position).collect::<Vec<_>>()),
        )?;
        robot.wait_for_tick();
        if struck.is_some_and(|at| seen.time > at + TIME_AFTER_FAULT) {
            break;
        }
    }
    out.flush()?;
    println!("{ticks} ticks, {:.3} ms a tick", 1e3 * spent.as_secs_f64() / f64::from(ticks.max(1)));
    Ok(())
}
