"""A robot of one's own behind a driver: a trial on it, its replay, and drivers that are refused or fail."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

from ftac.robot import Axis, Command, from_lerobot
from ftac.robot_host import Host

EXAMPLE = Path(__file__).parent.parent / "examples/my_robot.py"
DRIVERS = """
import os

import numpy as np

from ftac.robot import Command, Description, Measurement
from my_robot import SimulatedHand


class Short(SimulatedHand):
    def describe(self):
        whole = super().describe()
        return Description(whole.joints, whole.servos[:-1])


class Blind(SimulatedHand):
    def __init__(self):
        super().__init__(images=False)


class Fails(Blind):
    ticks = 0

    def step(self):
        super().step()
        self.ticks += 1
        if self.ticks == 50:
            self.fail()


class Dies(Fails):
    def fail(self):
        os._exit(7)


class Raises(Fails):
    def fail(self):
        raise OSError("the bus is gone")


class NotANumber(Fails):
    def fail(self):
        self.measured["servos"][2, 2] = np.nan


class Speechless:
    def describe(self):
        return {"joints": [], "servos": []}


class Half(Blind):
    judge = None


def made(port):
    raise OSError(f"nothing at {port}")
"""


class Follower:
    """A robot with LeRobot's interface: joints in degrees that go where they are told, but no farther than 40."""

    observation_features = {"pan.pos": float, "grip.pos": float, "spare.pos": float, "cam": (240, 240, 3)}
    action_features = {"pan.pos": float, "grip.pos": float, "spare.pos": float}

    def __init__(self):
        self.is_connected, self.is_calibrated = False, True
        self.at = {"pan.pos": 10.0, "grip.pos": 0.0, "spare.pos": 5.0}

    def connect(self, calibrate=True):
        assert not calibrate
        self.is_connected = True

    def disconnect(self):
        self.is_connected = False

    def get_observation(self):
        return {**self.at, "cam": np.full((240, 240, 3), 9, dtype=np.uint8)}

    def send_action(self, action):
        self.at = {key: min(value, 40.0) for key, value in action.items()}
        return dict(self.at)


class Lerobot(unittest.TestCase):
    def driver(self, **changes):
        servos = {"thumb": Axis("grip.pos", stiffness=2.0)}
        return from_lerobot(Follower(), **{"joints": {"joint_1": Axis("pan.pos", offset=0.1)}, "servos": servos, "cameras": {"eye": "cam"}, **changes})

    def test_keys_become_joints_servos_and_cameras(self):
        driver = self.driver()
        host = Host(driver)
        told = host.introduction()
        self.assertEqual((told["joints"], told["servos"], told["cameras"]), (["joint_1"], ["thumb"], [("eye", [240, 240])]))
        seen, images = host.answer({"ask": "observe"}, [])
        self.assertAlmostEqual(seen["arm"][0][0], np.radians(10.0) + 0.1)
        self.assertEqual(images, [])
        # 0.2 A at 2 A/rad: the goal stays within 0.1 rad of the servo.
        command = {"ask": "send", "arm": [0.3], "servos": [[1.0, 0.2]], "capture": True}
        sent = host.answer(command, [])
        self.assertAlmostEqual(sent["arm"][0], 0.3)
        self.assertAlmostEqual(sent["servos"][0][0], 0.1)
        self.assertAlmostEqual(driver.robot.at["pan.pos"], np.degrees(0.2))
        self.assertEqual(driver.robot.at["spare.pos"], 5.0)
        seen, images = host.answer({"ask": "observe"}, [])
        self.assertEqual((len(images), seen["images"]), (1, [(0, 0.0)]))
        # The robot's own limit is reported.
        self.assertAlmostEqual(host.answer({**command, "arm": [2.0]}, [])["arm"][0], np.radians(40.0) + 0.1)
        host.answer({"ask": "close"}, [])
        self.assertFalse(driver.robot.is_connected)

    def test_wrong_keys_and_unlimited_servos_are_refused(self):
        for changes, words in [
            ({"joints": {"joint_1": Axis("lift.pos")}}, "joint_1: found no lift.pos among the observations"),
            ({"servos": {"thumb": Axis("grip.pos")}}, "thumb: found neither limit nor stiffness"),
            ({"servos": {"thumb": Axis("grip.pos", stiffness=0.0)}}, "thumb: found the stiffness 0.0, expected more than 0"),
            ({"servos": {"thumb": Axis("grip.pos", stiffness=-2.0)}}, "thumb: found the stiffness -2.0"),
            ({"servos": {"thumb": Axis("grip.pos", scale=0.0, stiffness=2.0)}}, "thumb: found the scale 0.0"),
            ({"travel": {"index": 1.0}}, "travel: found none of thumb"),
            ({"cameras": {"eye": "webcam"}}, "eye: found no webcam among the observations"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                self.driver(**changes)

    def test_an_action_whose_position_nobody_knows_is_refused(self):
        robot = Follower()
        robot.action_features = {**robot.action_features, "speed": float}
        with self.assertRaisesRegex(ValueError, "speed: found an action that no axis names"):
            from_lerobot(robot, joints={"joint_1": Axis("pan.pos")}, servos={"thumb": Axis("grip.pos", stiffness=2.0)})
        self.assertFalse(robot.is_connected)


class Trials(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        shutil.copy(EXAMPLE, self.folder)
        (self.folder / "drivers.py").write_text(DRIVERS)

    def run_ftac(self, *arguments, code=0):
        environment = {**os.environ, "FTAC_LOG": ""}
        done = subprocess.run(
            [sys.executable, "-m", "ftac", *arguments],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
        )
        self.assertEqual(done.returncode, code, done.stderr)
        return done

    def test_a_trial_is_played_and_replayed(self):
        record = json.loads(self.run_ftac("trial", "1", "--robot", "my_robot.py:SimulatedHand", "--session", "s", "--out", "t.rrd", "--json").stdout)
        self.assertTrue(record["success"], record)
        (session,) = (self.folder / "s").glob("*_touch_python.mcap")
        replayed = json.loads(self.run_ftac("replay", str(session), "--json").stdout)
        self.assertTrue(replayed["complete"] and replayed["same_decisions"] and replayed["difference"] is None, replayed)
        self.assertEqual(replayed["robot"], "python")
        # The same trial gives the same bits.
        self.run_ftac("trial", "1", "--robot", "my_robot.py:SimulatedHand", "--session", "again", "--out", "t.rrd", "--quiet")
        self.run_ftac("replay", str(session), "--against", str(self.folder / "again" / session.name))

    def test_a_benchmark_is_resumed_with_the_same_driver_only(self):
        short = ["--combos", "1", "--trials", "1", "--conditions", "blind", "--record", "none", "--quiet", "--json", "--out", "run"]
        summary = json.loads(self.run_ftac("bench", "--robot", "drivers.py:Blind", "--jobs", "2", *short).stdout)
        self.assertEqual((summary["robot"], summary["conditions"]["blind"]["trials"]), ("python", 1))
        self.assertIn("drivers.py:Blind", (self.folder / "run/report.html").read_text())
        refused = self.run_ftac("bench", "--resume", "run", code=2)
        self.assertIn("expected --robot drivers.py:Blind, which the run was begun with", refused.stderr)
        self.run_ftac("bench", "--resume", "run", "--robot", "drivers.py:Blind", "--quiet")
        (self.folder / "drivers.py").write_text(DRIVERS + "\n")
        refused = self.run_ftac("bench", "--resume", "run", "--robot", "drivers.py:Blind", code=2)
        self.assertIn("with which the run began", refused.stderr)

    def test_drivers_that_cannot_be_used_are_refused_before_anything_is_written(self):
        for robot, more, words in [
            ("drivers.py:Short", [], "describe: servos: found 5, expected 6, those of"),
            ("drivers.py:Blind", [], "describe: cameras: found none, expected those of the hand for the condition touch"),
            ("drivers.py:Speechless", [], "found Speechless without observe and send, expected an object with the methods"),
            ("drivers.py:Half", ["--policy", "blind"], "found Half with lay_out and detect, expected all or none of lay_out, detect, judge"),
            ("drivers.py:Nobody", [], "found no class Nobody, expected one of:"),
            ("drivers.py:made", [], "--robot-arg: found no port, expected port=VALUE, without which made cannot be made"),
            ("drivers.py:made", ["--robot-arg", "port=/dev/x"], "OSError: nothing at /dev/x"),
            ("nowhere.py:Mine", [], "--robot: cannot read nowhere.py"),
            ("drivers.py", [], "--robot: found `drivers.py`, expected FILE.py:CLASS, such as my_robot.py:MyRobot"),
            ("sim", ["--robot-arg", "a=1"], "--robot-arg: found --robot sim, expected --robot FILE.py:CLASS"),
            ("my_robot.py:SimulatedHand", ["--config", "limits.toml"], "limits.toml: limits.current: found 2, expected 0.01 to 0.91"),
        ]:
            (self.folder / "limits.toml").write_text("version = 1\n[limits]\ncurrent = 2.0\n")
            refused = self.run_ftac("trial", "1", "--robot", robot, *more, "--session", "s", "--out", "t.rrd", code=2)
            self.assertIn(words, refused.stderr)
            self.assertEqual([], list(self.folder.glob("s/*")) + list(self.folder.glob("*.rrd")))

    def test_a_driver_that_fails_stops_the_trial(self):
        for robot, words in [
            ("Dies", "the robot's driver has failed (step: its process has ended (exit status: 7))"),
            ("Raises", "OSError: the bus is gone"),
            ("NotANumber", "ValueError: observe: servos[middle]: current: found nan, expected a finite number"),
        ]:
            asked = ["trial", "1", "--robot", f"drivers.py:{robot}", "--policy", "blind", "--session", robot, "--out", f"{robot}.rrd"]
            # It ran, and has no result.
            stopped = self.run_ftac(*asked, code=1)
            self.assertIn(words, stopped.stderr)
            # What was recorded until then is a session.
            self.assertIn("identical", self.run_ftac("replay", robot).stdout)


class HostOfCommands(unittest.TestCase):
    def test_a_command_of_the_wrong_kind_is_refused(self):
        class Odd(Follower):
            def describe(self):
                return {"joints": ["joint_1"], "servos": ["thumb"]}

            def observe(self):
                return {"servos": []}

            def send(self, command):
                return Command(command.arm[:0], command.servos)

        host = Host(Odd())
        self.assertIn("observe: found dict, expected a Measurement", host.answer({"ask": "observe"}, [])["error"])
        command = {"ask": "send", "arm": [0.0], "servos": [[0.0, 0.1]], "capture": False}
        self.assertIn("send: arm: found shape (0,), expected (1,)", host.answer(command, [])["error"])


if __name__ == "__main__":
    unittest.main()
