"""The worked examples at small size. Reinforcement learning needs torch and is left out."""

import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

EXAMPLES = Path(__file__).parent.parent / "examples"


class Examples(unittest.TestCase):
    def test_the_scripted_pick_up_is_cloned(self):
        with tempfile.TemporaryDirectory() as folder:

            def run(*arguments):
                command = [sys.executable, str(EXAMPLES / "clone_pick_one.py"), "--jobs", "2", *arguments]
                done = subprocess.run(command, cwd=folder, env={**os.environ, "FTAC_LOG": ""}, capture_output=True, text=True)
                self.assertEqual(done.returncode, 0, done.stderr)
                return done.stdout

            self.assertIn("of 3 episodes", run("collect", "--episodes", "3", "--out", "few.npz"))
            told = run("train", "few.npz", "--seeds", "1", "--episodes", "1", "--epochs", "10")
            for name in ("the script itself", "with tactile images, seed 0", "without, seed 0"):
                self.assertRegex(told, f"{name}: [01] of 1")
            errors = [float(line.split()[-1]) for line in told.splitlines() if "mean squared error" in line]
            # Of what varies with a standard deviation of 1: less than a mean would leave.
            self.assertTrue(len(errors) == 2 and all(error < 0.5 for error in errors), told)


if __name__ == "__main__":
    unittest.main()
