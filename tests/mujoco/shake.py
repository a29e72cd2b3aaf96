#!/usr/bin/env python3
"""Closes and shakes the grasps of `ftac grasps export OBJECT --mjcf DIR` in MuJoCo and says how many hold.

    python3 tests/mujoco/shake.py DIR [--json FILE]

Needs MuJoCo from PyPI, for this comparison only. Exit code 0: shaken; 77: skipped, MuJoCo is not there. Commands and limits are those
of the JSON files: the tensions rise, the object is damped while the digits close and then let go of, and a force pulls along each of
six directions, every time from the closed grasp.
"""

import argparse
import json
import pathlib
import sys

try:
    import mujoco
    import numpy as np
except ImportError as error:
    print(f"skipped: {error}; `pip install mujoco` brings it", file=sys.stderr)
    sys.exit(77)

# MuJoCo's steps a second.
RATE = 960.0


def angle(a, b):
    """Angle between two unit quaternions, rad."""
    return 2.0 * np.arccos(min(1.0, abs(float(np.dot(a, b)))))


def shake(path):
    """Whether a grasp holds, and by how much it moved: closing and shaken; m and rad."""
    test = json.loads(path.read_text())
    model = mujoco.MjModel.from_xml_path(str(path.with_name(test["model"])))
    model.opt.timestep = 1.0 / RATE
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    body = model.body("object")
    first = model.joint("object").dofadr[0]
    at = model.joint("object").qposadr[0]
    opened, tensions = np.array(test["open_tensions"]), np.array(test["tensions"])
    if "opposition" in test:
        data.ctrl[len(tensions)] = test["opposition"]
    rise, damped = test["rise"], test["rise"] + test["settle_damped"]
    # Damping is a rate here and a force there.
    inertia = np.concatenate([np.full(3, test["mass"]), body.inertia])
    model.dof_damping[first : first + 6] = test["damping"] * inertia
    for step in range(round((damped + test["settle_free"]) * RATE)):
        time = step / RATE
        data.ctrl[: len(tensions)] = opened + (tensions - opened) * min(1.0, time / rise)
        if step == round(damped * RATE):
            model.dof_damping[first : first + 6] = 0.0
        mujoco.mj_step(model, data)
    closed = data.qpos.copy(), data.qvel.copy(), data.act.copy()
    place, turn = closed[0][at : at + 3], closed[0][at + 3 : at + 7]
    ours = np.array(test["closed"]["object"])
    apart = float(np.linalg.norm(place - ours[:3]))
    limits, worst = test["shake"], (0.0, 0.0)
    for axis in range(3):
        for sign in (1.0, -1.0):
            data.qpos[:], data.qvel[:], data.act[:] = closed
            mujoco.mj_forward(model, data)
            for _ in range(round(limits["time"] * RATE)):
                data.xfrc_applied[body.id, :] = 0.0
                data.xfrc_applied[body.id, axis] = sign * limits["force"]
                mujoco.mj_step(model, data)
                moved = float(np.linalg.norm(data.qpos[at : at + 3] - place))
                turned = float(angle(data.qpos[at + 3 : at + 7], turn))
                worst = max(worst[0], moved), max(worst[1], turned)
                if worst[0] > limits["most_distance"] or worst[1] > limits["most_angle"]:
                    data.xfrc_applied[body.id, :] = 0.0
                    return False, apart, worst
            data.xfrc_applied[body.id, :] = 0.0
    return True, apart, worst


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    arguments = parser.parse_args()
    rows = []
    for path in sorted(arguments.folder.glob("*.json")):
        held, apart, (moved, turned) = shake(path)
        rows.append({"grasp": path.stem, "held": held, "apart_mm": 1e3 * apart, "moved_mm": 1e3 * moved, "turned_deg": np.degrees(turned)})
        print(f"{path.stem:28} {'held' if held else 'lost':5} closed {1e3 * apart:5.1f} mm from ours; shaken {1e3 * moved:5.1f} mm, {np.degrees(turned):5.1f} deg")
    print(f"{sum(row['held'] for row in rows)} of {len(rows)} held")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
