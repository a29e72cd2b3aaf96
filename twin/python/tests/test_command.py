"""The command that the package brings: a policy of one's own as a condition, and what was recorded as a data set."""

import csv
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

POLICY = """
import os
import subprocess
import time

import numpy as np

class Lowers:
    images = 16

    def reset(self, info):
        self.steps = 0
        print("a policy may print")

    def act(self, observation):
        assert observation["tactile"].shape == (17, 16, 16, 3)
        self.steps += 1
        return None if self.steps > 20 else np.array([0, 0, -0.2, 0, 0, 0, -1, -1, -1, -1, -1, 0.0])

class Keeps:
    def choose(self, situation):
        return None

class Ends:
    def act(self, observation):
        raise SystemExit(3)

class Begins:
    def __init__(self):
        raise OSError("no weights here")

    act = None

class Hangs:
    def act(self, observation):
        helper = subprocess.Popen(["sleep", "600"])
        with open("processes.part", "w") as file:
            file.write(f"{os.getpid()} {helper.pid}")
        os.rename("processes.part", "processes")
        time.sleep(600)

class Takes:
    def __init__(self, gain, *, deep=False, layers=None):
        self.taken = gain, deep, layers

    def choose(self, situation):
        raise RuntimeError(f"made with {self.taken}")

class Tells:
    def choose(self, situation):
        raise RuntimeError(f"told {os.environ.get('FTAC_ARM_PASSWORD')} of {len(os.environ)} variables")
"""


def ended(process):
    """Whether a process is over; one that nobody has waited for is."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def wait_until(what, seconds=120.0):
    until = time.monotonic() + seconds
    while not what():
        if time.monotonic() > until:
            raise AssertionError(f"not within {seconds} s")
        time.sleep(0.05)


class Command(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        (self.folder / "mine.py").write_text(POLICY)
        (self.folder / "typo.py").write_text("class Keeps\n    pass\n")
        (self.folder / "needs.py").write_text("import nobody_has_this\n\nclass Keeps:\n    pass\n")

    def run_ftac(self, *arguments, code=0):
        environment = {**os.environ, "FTAC_LOG": ""}
        done = subprocess.run(
            [sys.executable, "-m", "ftac", *arguments], cwd=self.folder, env=environment, capture_output=True, text=True
        )
        self.assertEqual(done.returncode, code, done.stderr)
        return done

    def trials(self, name):
        with open(self.folder / name / "trials.csv", newline="") as file:
            return list(csv.DictReader(file))

    def bench(self, name, policy, *more, trials=2):
        short = ["--combos", "1", "--trials", str(trials), "--conditions", "external", "--quiet", "--json", "--out", name]
        return json.loads(self.run_ftac("bench", "--policy", f"mine.py:{policy}", *short, *more).stdout)

    def test_a_class_of_ones_own_plays_as_one_more_condition(self):
        summary = self.bench("chosen", "Keeps", "--record", "none", "--jobs", "2")
        self.assertEqual(summary["conditions"]["external"]["trials"], 2)
        # Left alone before it was tried.
        self.assertEqual({row["condition"] for row in self.trials("chosen")}, {"external"})
        self.assertEqual({row["reason"] for row in self.trials("chosen")}, {"the second object is left alone"})
        self.assertIn("mine.py:Keeps", (self.folder / "chosen/report.html").read_text())

    def test_a_process_that_ends_fails_its_trial_and_no_other(self):
        self.bench("ends", "Ends", "--record", "none")
        rows = self.trials("ends")
        self.assertEqual([row["cause"] for row in rows], ["policy_failed"] * 2)
        self.assertTrue(all("SystemExit: 3" in row["reason"] for row in rows), rows)

    def processes(self):
        """Of a policy that hangs: its own and its helper's."""
        return [int(number) for number in (self.folder / "processes").read_text().split()]

    def test_a_policy_that_hangs_fails_its_trial_and_leaves_no_process(self):
        self.bench("hangs", "Hangs", "--record", "none", "--policy-timeout", "2", trials=1)
        (row,) = self.trials("hangs")
        self.assertEqual((row["cause"], row["success"]), ("policy_failed", "false"))
        self.assertIn("the policy has not answered within 2 s (--policy-timeout)", row["reason"])
        wait_until(lambda: all(map(ended, self.processes())))

    def hanging(self):
        """The program, with a policy that hangs."""
        arguments = ["--combos", "1", "--trials", "1", "--conditions", "external", "--record", "none", "--quiet", "--out", "stopped"]
        started = subprocess.Popen(
            [sys.executable, "-m", "ftac", "bench", "--policy", "mine.py:Hangs", *arguments],
            cwd=self.folder,
            env={**os.environ, "FTAC_LOG": ""},
            stderr=subprocess.PIPE,
            text=True,
        )
        self.addCleanup(started.stderr.close)
        wait_until((self.folder / "processes").exists)
        return started

    def test_ctrl_c_once_ends_a_run_whose_policy_hangs(self):
        started = self.hanging()
        started.send_signal(signal.SIGINT)
        self.assertEqual(started.wait(timeout=120), 130)
        self.assertIn("interrupted while the policy thought", started.stderr.read())
        wait_until(lambda: all(map(ended, self.processes())))
        self.assertEqual((self.folder / "stopped/journal.jsonl").read_text(), "", "a trial that was interrupted is none")

    def test_a_policy_ends_with_the_program_that_was_killed(self):
        started = self.hanging()
        started.kill()
        started.wait()
        wait_until(lambda: all(map(ended, self.processes())))

    def test_a_policy_takes_arguments(self):
        given = ["--policy-arg", "gain=0.5", "--policy-arg", "deep=true", "--policy-arg", "layers=[2, 3]"]
        self.bench("taken", "Takes", "--record", "none", *given, trials=1)
        (row,) = self.trials("taken")
        self.assertIn("made with (0.5, True, [2, 3])", row["reason"])
        self.assertIn("mine.py:Takes deep=true gain=0.5 layers=[2,3]", (self.folder / "taken/report.html").read_text())
        run = json.loads((self.folder / "taken/run.json").read_text())
        self.assertEqual(run["policy"]["arguments"], {"gain": 0.5, "deep": True, "layers": [2, 3]})

    def test_a_policy_is_not_told_the_arm_s_password(self):
        os.environ["FTAC_ARM_PASSWORD"] = "hunter2"
        self.addCleanup(os.environ.pop, "FTAC_ARM_PASSWORD")
        self.bench("tells", "Tells", "--record", "none", trials=1)
        self.assertIn("told None of ", self.trials("tells")[0]["reason"])

    def test_a_folder_does_not_choose_what_runs(self):
        # Modules of a stranger's folder.
        (self.folder / "json.py").write_text("open('owned', 'w')\n")
        environment = {**os.environ, "FTAC_LOG": ""}
        asked = [Path(sys.executable).with_name("ftac"), "bench", "--combos", "1", "--policy", "mine.py:Nobody"]
        done = subprocess.run(asked, cwd=self.folder, env=environment, capture_output=True, text=True)
        self.assertIn("found no class Nobody", done.stderr)
        self.assertFalse((self.folder / "owned").exists())
        (self.folder / "json.py").unlink()
        # The policy that its results name.
        self.bench("theirs", "Keeps", "--record", "none", trials=1)
        refused = self.run_ftac("bench", "--resume", "theirs", code=2)
        self.assertIn("expected --policy mine.py:Keeps, which the run was begun with", refused.stderr)
        self.run_ftac("bench", "--resume", "theirs", "--policy", "mine.py:Keeps")

    def test_what_cannot_play_is_refused_before_anything_is_written(self):
        needs = ["--policy", "mine.py:Takes"]
        for arguments, words in [
            (needs, "--policy-arg: found no gain, expected gain=VALUE, without which Takes cannot be made"),
            ([*needs, "--policy-arg", "gain=1", "--policy-arg", "wide=1"], "found wide, which Takes does not take, expected one of: gain, deep, layers"),
            (["--policy", "mine.py:Keeps", "--policy-arg", "a=1"], "found a, which Keeps does not take, expected none: it takes no arguments"),
            ([*needs, "--policy-arg", "gain"], "--policy-arg: found `gain`, expected KEY=VALUE"),
            ([*needs, "--policy-timeout", "0"], "0 is not in 1..=86400"),
            (["--policy", "mine.py:Nobody"], "found no class Nobody, expected one of: Lowers, Keeps, Ends, Begins, Hangs, Takes, Tells"),
            (["--policy", "nowhere.py:Keeps"], "cannot read nowhere.py"),
            (["--policy", "typo.py:Keeps"], "SyntaxError"),
            (["--policy", "needs.py:Keeps"], "No module named 'nobody_has_this'"),
            (["--policy", "mine.py:Begins"], "no weights here"),
            (["--policy", "mine.py"], "found `mine.py`, expected FILE.py:CLASS"),
            (["--conditions", "external"], "expected --policy FILE.py:CLASS with it"),
        ]:
            refused = self.run_ftac("bench", "--combos", "1", "--out", "none", *arguments, code=2)
            self.assertIn(words, refused.stderr)
            self.assertFalse((self.folder / "none").exists())

    def test_recorded_trials_become_a_data_set(self):
        try:
            import av
            import pyarrow.parquet as pq
        except ImportError as error:
            self.skipTest(f"LEFT OUT: the LeRobot data set is NOT tested: {error}")
        self.bench("lowered", "Lowers", "--robot", "rounded", "--record", "all")
        told = json.loads(self.run_ftac("export", "lerobot", "lowered", "--images", "32", "--json").stdout)
        root = self.folder / "lowered/lerobot"
        info = json.loads((root / "meta/info.json").read_text())
        self.assertEqual((info["codebase_version"], info["fps"], info["total_episodes"]), ("v3.0", 20, 2))
        table = pq.read_table(root / "data/chunk-000/file-000.parquet")
        self.assertEqual((table.num_rows, told["frames"]), (info["total_frames"],) * 2)
        names = [name for name, feature in info["features"].items() if feature["dtype"] != "video"]
        self.assertEqual(set(table.column_names), set(names))
        self.assertEqual(table["index"].to_pylist(), list(range(table.num_rows)))
        self.assertEqual(table["next.done"].to_pylist().count(True), 2)
        episodes = pq.read_table(root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
        self.assertEqual(episodes[1]["dataset_from_index"], episodes[0]["length"])
        self.assertEqual(episodes[0]["tasks"], ["pick up the salt mill, then the lemon beside it"])
        with av.open(str(root / "videos/observation.images.thumb_distal/chunk-000/file-000.mp4")) as video:
            frames = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
        self.assertEqual((len(frames), frames[0].shape), (table.num_rows, (32, 32, 3)))
        again = self.run_ftac("export", "lerobot", "lowered", code=2)
        self.assertIn("it is there already", again.stderr)
        bags = json.loads(self.run_ftac("export", "mcap", "lowered", "--out", "bags", "--json").stdout)["bags"]
        self.assertEqual(len(bags), 2)
        self.assertTrue(all(bag["messages"] > 0 and Path(self.folder, bag["bag"]).exists() for bag in bags))
        # A session whose end is missing is named.
        session = next((self.folder / "lowered").glob("**/*.mcap"))
        (self.folder / "cut").mkdir()
        (self.folder / "cut" / session.name).write_bytes(session.read_bytes()[: session.stat().st_size // 2])
        cut = self.run_ftac("export", "lerobot", "cut", "--images", "32")
        self.assertIn(f"exported as no success: {session.name}", cut.stderr)


if __name__ == "__main__":
    unittest.main()
