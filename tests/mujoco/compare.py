#!/usr/bin/env python3
"""Runs the scenes of `ftac hand export --mjcf DIR` in MuJoCo and prints both engines beside each other.

    python3 tests/mujoco/compare.py DIR [--json FILE]

Needs MuJoCo from PyPI, for this comparison only. Exit code 0: compared; 77: skipped, MuJoCo is not there; 1: a figure is
outside its tolerance. The cables are MuJoCo's own spatial tendons; the servo that winds them is ours, stepped here as in
`sim/src/servo.rs`, because MuJoCo has no one-sided cable on a spool.

MuJoCo runs at its own time step: at ours its contacts are soft enough for a finger to sink 0.7 mm into a light ball. A prop that
is held in place is given the inertia of a wall, not only put back after each step: put back alone, a light one gives way within
the step, and the fingers close into other grasps than on a fixed one.
"""

import argparse
import json
import pathlib
import sys
import time

try:
    import mujoco
    import numpy as np
except ImportError as error:
    print(f"skipped: {error}; `pip install mujoco` brings it", file=sys.stderr)
    sys.exit(77)

SUBSTEPS = 8
POSITION_GAIN, POSITION_DAMPING = 6.0, 0.25
# MuJoCo's steps a second. The time constant of its contacts is two steps, the stiffest it allows.
RATE = 960.0
# Steps a second among which the lowest is looked for at which MuJoCo holds a thing as still as ours does.
RATES = (240.0, 480.0, 960.0, 1920.0)
# Slips below this count as none, mm.
NO_SLIP = 0.05
# Added inertia of a prop that is held in place, kg and kg m2.
WALL = 1e6
# Free motion may differ by this at any sampled moment and at rest, degrees. Under way, at up to 400 deg/s, the engines treat
# the stiff springs differently (ours implicitly); at rest nothing but the model counts.
FREE_MOTION, FREE_REST = 25.0, 0.1


class Servo:
    """An XC330 that winds a cable, which can only pull, or turns the thumb through a shaft."""

    def __init__(self, servo, cable):
        self.servo, self.cable = servo, cable
        self.angle = self.speed = 0.0

    def advance(self, amps, load, h):
        servo = self.servo
        amps = min(max(amps, -servo["current_limit"]), servo["current_limit"])
        if amps * self.speed > 0.0:
            left = max(0.0, 1.0 - abs(self.speed) / servo["no_load_speed"])
            cap = servo["stall_torque"] * left / servo["torque_constant"]
            amps = min(max(amps, -cap), cap)
        torque = servo["torque_constant"] * amps - load - servo["damping"] * self.speed
        self.speed += torque / servo["rotor_inertia"] * h
        self.angle += self.speed * h

    def wind(self, current, excursion, rate, dt):
        """Current control; returns the mean tension."""
        cable = self.cable
        h, total = dt / SUBSTEPS, 0.0
        for n in range(SUBSTEPS):
            tension = max(0.0, cable["stiffness"] * (cable["spool_radius"] * self.angle - excursion - rate * h * n))
            self.advance(current, cable["spool_radius"] * tension, h)
            total += tension
        if self.angle < 0.0:
            self.angle, self.speed = 0.0, max(0.0, self.speed)
        return total / SUBSTEPS

    def turn(self, goal, load, dt):
        """Position control against the shaft's torque."""
        for _ in range(SUBSTEPS):
            self.advance(POSITION_GAIN * (goal - self.angle) - POSITION_DAMPING * self.speed, load, dt / SUBSTEPS)
        return self.angle


class Run:
    """One MJCF model with its five cable servos and the opposition servo."""

    def __init__(self, folder, scene, setup, rate=RATE):
        self.model = mujoco.MjModel.from_xml_path(str(folder / scene["model"]))
        self.model.opt.timestep = 1.0 / rate
        self.model.geom_solref[:, 0] = 2.0 / rate
        self.data = mujoco.MjData(self.model)
        if self.model.nkey:
            mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        mujoco.mj_forward(self.model, self.data)
        self.setup = setup
        self.servos = [Servo(setup["servo"], setup["cable"]) for _ in setup["cables"]]
        self.thumb = Servo(setup["servo"], setup["cable"])
        self.rest = self.data.ten_length.copy()
        self.joints = [self.model.joint(name).qposadr[0] for name in setup["joints"]]
        self.seconds = 0.0
        self.steps = 0
        self.held = None

    def hold(self, name):
        """Keeps the free body `name` where it is until let go."""
        joint = self.model.joint(name)
        self.held = (joint.qposadr[0], joint.dofadr[0], self.data.qpos[joint.qposadr[0] :][:7].copy())
        self.model.dof_armature[joint.dofadr[0] :][:6] = WALL

    def let_go(self):
        """Lets go of what is held."""
        self.model.dof_armature[self.held[1] :][:6] = 0.0
        self.held = None

    def advance(self, phase, seconds, angles=None):
        model, data, setup = self.model, self.data, self.setup
        per_newton = setup["cable"]["spool_radius"] / setup["servo"]["torque_constant"]
        count = round(seconds / model.opt.timestep)
        every = round(setup["sample"] / model.opt.timestep)
        for n in range(count):
            for index, servo in enumerate(self.servos):
                excursion = self.rest[index] - data.ten_length[index]
                rate = -data.ten_velocity[index]
                current = phase["tensions"][index] * per_newton
                data.ctrl[index] = servo.wind(current, excursion, rate, model.opt.timestep)
            twist = self.thumb.angle - data.qpos[self.joints[0]]
            data.ctrl[5] = self.thumb.turn(phase["opposition"], setup["shaft_stiffness"] * twist, model.opt.timestep)
            begin = time.perf_counter()
            mujoco.mj_step(model, data)
            self.seconds += time.perf_counter() - begin
            self.steps += 1
            if self.held:
                where, rate, pose = self.held
                data.qpos[where : where + 7] = pose
                data.qvel[rate : rate + 6] = 0.0
            if angles is not None and (n + 1) % every == 0:
                angles.append([float(data.qpos[joint]) for joint in self.joints])

    def force_sum(self, prop):
        """Sum of normal forces between the prop and the hand, and the deepest overlap (m)."""
        body = self.model.body(prop).id
        total, deepest, wrench = 0.0, 0.0, np.zeros(6)
        for n in range(self.data.ncon):
            contact = self.data.contact[n]
            if body in (self.model.geom_bodyid[contact.geom1], self.model.geom_bodyid[contact.geom2]):
                mujoco.mj_contactForce(self.model, self.data, n, wrench)
                total += wrench[0]
                deepest = max(deepest, -contact.dist)
        return total, deepest


def compare(folder, scene, setup, rate=RATE):
    run = Run(folder, scene, setup, rate)
    prop = scene["prop"]
    angles = [[0.0] * len(setup["joints"])]
    if prop:
        run.hold(prop)
    for phase in scene["phases"]:
        run.advance(phase, phase["seconds"], angles)
    closed = len(angles)
    row = {"name": scene["name"], "ours": dict(scene["ours"]["result"]), "mujoco": {}}
    ours, theirs = np.degrees(scene["ours"]["angles"][:closed]), np.degrees(angles)
    fine = np.degrees(scene["fine"]["angles"][closed - 1])
    row["fine"] = dict(scene["fine"]["result"])
    row["angle_deg"] = {
        "fine_rest": float(np.abs(fine - theirs[-1]).max()),
        "fine_mean": float(np.abs(fine - theirs[-1]).mean()),
        "fine": [round(float(angle), 2) for angle in fine],
        "most": float(np.abs(ours - theirs).max()),
        "rest": float(np.abs(ours[-1] - theirs[-1]).max()),
        "rest_mean": float(np.abs(ours[-1] - theirs[-1]).mean()),
        "ours": [round(float(angle), 2) for angle in ours[-1]],
        "mujoco": [round(float(angle), 2) for angle in theirs[-1]],
    }
    if prop:
        row["mujoco"]["closing_force_n"] = run.force_sum(prop)[0]
    if prop and scene["let_go"]:
        run.let_go()
        for phase in scene["gripping"]:
            run.advance(phase, phase["seconds"])
        run.model.opt.gravity[:] = scene["gravity"]
        last = scene["phases"][-1]
        run.advance(last, scene["settle"])
        body = run.model.body(prop).id
        before = run.data.xpos[body].copy()
        run.advance(last, scene["hold"])
        slip = float(np.linalg.norm(run.data.xpos[body] - before) * 1e3)
        total, deepest = run.force_sum(prop)
        row["mujoco"].update(holding_force_n=total, slip_mm=slip, held=slip < 20.0, penetration_mm=deepest * 1e3)
    row["ours"].update(speed(scene["ours"]["step_us"], setup["rate"]))
    row["mujoco"].update(speed(run.seconds / run.steps * 1e6, rate))
    return row


def equal_slip(folder, scene, setup, known):
    """The coarsest steps with which MuJoCo lets the thing slip no more than ours does, and its speed with them. `known` is the row at RATE."""
    for rate in RATES:
        row = known if rate == RATE else compare(folder, scene, setup, rate)
        ours, theirs = row["ours"], row["mujoco"]
        if theirs["held"] and theirs["slip_mm"] <= max(ours["slip_mm"], NO_SLIP):
            return {"name": scene["name"], "rate": rate, "ours": ours, "mujoco": theirs}
    return {"name": scene["name"], "rate": None, "ours": ours, "mujoco": theirs}


def speed(step_us, rate):
    """Cost of a step, and simulated over wall time."""
    return {"step_us": step_us, "real_time": 1e6 / (step_us * rate)}


def refine(folder, scene, setup):
    """Closings with ever shorter steps: steps a second, and for each engine where it comes to rest (degrees) and its closing force (N)."""
    rows = []
    for entry in scene["refined"]:
        run = Run(folder, scene, setup, entry["rate"])
        run.hold(scene["prop"])
        for phase in scene["phases"]:
            run.advance(phase, phase["seconds"])
        angles = np.degrees([run.data.qpos[joint] for joint in run.joints])
        ours, theirs = (np.degrees(entry["angles"]), entry["closing_force_n"]), (angles, run.force_sum(scene["prop"])[0])
        rows.append((entry["rate"], ours, theirs))
    return rows


def print_refined(scene, rows):
    rate, ours_at_last, theirs_at_last = rows[-1]
    print(f"\n{scene['name']}: largest joint difference from the same engine at {rate:.0f} Hz, and between the engines (most, mean)")
    print(f"{'Hz':>6} {'ours deg':>9} {'MuJoCo deg':>11} {'apart deg':>15} {'closing N':>15}")
    for rate, (ours, force), (theirs, their_force) in rows:
        own, its = np.abs(ours - ours_at_last[0]).max(), np.abs(theirs - theirs_at_last[0]).max()
        apart = np.abs(ours - theirs)
        print(f"{rate:6.0f} {own:9.1f} {its:11.1f} {apart.max():8.1f} {apart.mean():6.1f} {force:7.1f} {their_force:7.1f}")


def whole(folder, scene, setup):
    run = Run(folder, scene, setup)
    run.advance(scene, scene["seconds"])
    theirs = np.degrees([run.data.qpos[joint] for joint in run.joints])
    apart = float(np.abs(theirs - np.degrees(scene["ours"]["angles"])).max())
    return {
        "name": "whole",
        "angle_deg": {"most": apart, "rest": apart, "rest_mean": apart, "fine_rest": None, "fine_mean": None},
        "fine": {},
        "ours": speed(scene["ours"]["step_us"], setup["rate"]),
        "mujoco": speed(run.seconds / run.steps * 1e6, RATE),
    }


def number(value, digits=1):
    return "-" if value is None else f"{value:.{digits}f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    arguments = parser.parse_args()
    setup = json.loads((arguments.folder / "scenes.json").read_text())
    rows = [compare(arguments.folder, scene, setup) for scene in setup["scenes"]]
    rows.append(whole(arguments.folder, setup["whole"], setup))
    print(f"MuJoCo {mujoco.__version__} at {RATE:.0f} Hz; each cell ours / MuJoCo, the first three ours / ours with four outer iterations / MuJoCo")
    print("angles: difference at rest, most and mean, ours as hands without an arm are simulated; the same with four outer iterations")
    print(f"{'scene':18} {'angles deg':>23} {'closing N':>21} {'holding N':>21} {'slip 5 s mm':>21} {'overlap mm':>13} {'us/step':>13} {'x real time':>15}")
    for row in rows:
        pair = lambda key, digits=1: f"{number(row['ours'].get(key), digits)} / {number(row['mujoco'].get(key), digits)}"
        three = lambda key, digits=1: " / ".join(number(row[who].get(key), digits) for who in ("ours", "fine", "mujoco"))
        angle = row["angle_deg"]
        print(
            f"{row['name']:18} {number(angle['rest']):>5} {number(angle['rest_mean']):>5}; {number(angle['fine_rest']):>4} {number(angle['fine_mean']):>4} "
            f"{three('closing_force_n'):>21} {three('holding_force_n'):>21} {three('slip_mm', 2):>21} {pair('penetration_mm', 2):>13} {pair('step_us', 0):>13} {pair('real_time'):>15}"
        )
    held = [(scene, row) for scene, row in zip(setup["scenes"], rows) if scene["prop"] and scene["let_go"]]
    equal = [equal_slip(arguments.folder, scene, setup, row) for scene, row in held]
    print(f"\nMuJoCo at the lowest of {', '.join(f'{rate:.0f}' for rate in RATES)} Hz at which it slips no more than ours (below {NO_SLIP} mm: not at all)")
    print(f"{'scene':18} {'ours mm':>8} {'MuJoCo mm':>10} {'MuJoCo Hz':>10} {'ours x real':>12} {'MuJoCo x real':>14} {'ratio':>6}")
    for row in equal:
        ours, theirs = row["ours"], row["mujoco"]
        found = f"{row['rate']:10.0f}" if row["rate"] else f"{'none':>10}"
        ratio = ours["real_time"] / theirs["real_time"]
        print(
            f"{row['name']:18} {ours['slip_mm']:8.2f} {theirs['slip_mm']:10.2f} {found} {ours['real_time']:12.1f} {theirs['real_time']:14.1f} {ratio:6.2f}"
        )
    for scene in setup["scenes"]:
        if scene["refined"]:
            print_refined(scene, refine(arguments.folder, scene, setup))
    if arguments.json:
        arguments.json.write_text(json.dumps({"scenes": rows, "equal_slip": equal}, indent=1))
    free = rows[0]["angle_deg"]
    if free["most"] > FREE_MOTION or free["rest"] > FREE_REST:
        print(f"free motion differs: found {free}, expected at most {FREE_MOTION} and {FREE_REST} deg", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
