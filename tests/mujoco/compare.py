#!/usr/bin/env python3
"""Runs the scenes of `ftac hand export --mjcf DIR` in MuJoCo and prints both engines beside each other.

    python3 tests/mujoco/compare.py DIR [--json FILE]

Needs MuJoCo from PyPI, for this comparison only. Exit code 0: compared; 77: skipped, MuJoCo is not there; 1: a figure is
outside its tolerance. The cables are MuJoCo's own spatial tendons; the servo that winds them is ours, stepped here as in
`sim/src/servo.rs`, because MuJoCo has no one-sided cable on a spool.
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

    def __init__(self, folder, scene, setup):
        self.model = mujoco.MjModel.from_xml_path(str(folder / scene["model"]))
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


def compare(folder, scene, setup):
    run = Run(folder, scene, setup)
    prop = scene["prop"]
    angles = [[0.0] * len(setup["joints"])]
    if prop:
        run.hold(prop)
    for phase in scene["phases"]:
        run.advance(phase, phase["seconds"], angles)
    closed = len(angles)
    row = {"name": scene["name"], "ours": dict(scene["ours"]["result"]), "mujoco": {}}
    ours, theirs = np.degrees(scene["ours"]["angles"][:closed]), np.degrees(angles)
    row["angle_deg"] = {
        "most": float(np.abs(ours - theirs).max()),
        "rest": float(np.abs(ours[-1] - theirs[-1]).max()),
        "rest_mean": float(np.abs(ours[-1] - theirs[-1]).mean()),
    }
    if prop:
        row["mujoco"]["closing_force_n"] = run.force_sum(prop)[0]
        run.held = None
        run.model.opt.gravity[:] = scene["gravity"]
        last = scene["phases"][-1]
        run.advance(last, scene["settle"])
        body = run.model.body(prop).id
        before = run.data.xpos[body].copy()
        run.advance(last, scene["hold"])
        slip = float(np.linalg.norm(run.data.xpos[body] - before) * 1e3)
        total, deepest = run.force_sum(prop)
        row["mujoco"].update(holding_force_n=total, slip_mm=slip, held=slip < 20.0, penetration_mm=deepest * 1e3)
    row["ours"]["step_us"] = scene["ours"]["step_us"]
    row["mujoco"]["step_us"] = run.seconds / run.steps * 1e6
    return row


def whole(folder, scene, setup):
    run = Run(folder, scene, setup)
    run.advance(scene, scene["seconds"])
    theirs = np.degrees([run.data.qpos[joint] for joint in run.joints])
    apart = float(np.abs(theirs - np.degrees(scene["ours"]["angles"])).max())
    return {
        "name": "whole",
        "angle_deg": {"most": apart, "rest": apart, "rest_mean": apart},
        "ours": {"step_us": scene["ours"]["step_us"]},
        "mujoco": {"step_us": run.seconds / run.steps * 1e6},
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
    print(f"MuJoCo {mujoco.__version__}; each cell ours / MuJoCo")
    print(f"{'scene':10} {'angles most, rest':>18} {'closing N':>15} {'holding N':>15} {'slip 5 s mm':>17} {'overlap mm':>13} {'us/step':>13}")
    for row in rows:
        pair = lambda key, digits=1: f"{number(row['ours'].get(key), digits)} / {number(row['mujoco'].get(key), digits)}"
        angle = row["angle_deg"]
        print(
            f"{row['name']:10} {angle['most']:8.2f}, {angle['rest']:5.2f} dg {pair('closing_force_n'):>15} "
            f"{pair('holding_force_n'):>15} {pair('slip_mm', 2):>17} {pair('penetration_mm', 2):>13} {pair('step_us', 0):>13}"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))
    free = rows[0]["angle_deg"]
    if free["most"] > FREE_MOTION or free["rest"] > FREE_REST:
        print(f"free motion differs: found {free}, expected at most {FREE_MOTION} and {FREE_REST} deg", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
