"""The worked examples at small size."""

import csv
import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

from ftac import bench

EXAMPLES = Path(__file__).parent.parent / "examples"


class Examples(unittest.TestCase):
    def run_example(self, folder, name, *arguments):
        command = [sys.executable, str(EXAMPLES / name), "--jobs", "2", *arguments]
        done = subprocess.run(command, cwd=folder, env={**os.environ, "FTAC_LOG": ""}, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_the_script_is_imitated_reinforced_and_run_in_the_benchmark(self):
        few = ["--objects", "lemon", "--episodes", "4", "--tests", "1"]
        with tempfile.TemporaryDirectory() as folder:
            told = self.run_example(folder, "imitate.py", *few, "--rounds", "2", "--seeds", "1", "--epochs", "10", "--out", "made")
            for name in ("script, seed ", "plain, seed 0", "tactile, seed 0"):
                self.assertRegex(told, f"{name}, the benchmark's errors: [01] of 1")
            errors = [float(line.split()[-1]) for line in told.splitlines() if "steps, error" in line]
            # As shares of the variance, which the mean action would leave.
            self.assertTrue(len(errors) == 4 and all(error < 0.7 for error in errors), told)
            start = ["--start", "made/tactile_0.npz", "--iterations", "2"]
            self.run_example(folder, "reinforce.py", *few, *start, "--out", "better")
            with open(Path(folder) / "better/curve.csv") as file:
                self.assertEqual([row["iteration"] for row in csv.DictReader(file)], ["0", "1"])
            before, after = (np.load(Path(folder) / name) for name in ("made/tactile_0.npz", "better/tactile_0.npz"))
            self.assertTrue(np.array_equal(before["mean"], after["mean"]) and not np.array_equal(before["w0"], after["w0"]))
            sys.path.insert(0, str(EXAMPLES))
            from imitate import Imitation

            (row,) = bench.run(Imitation(Path(folder) / "better/tactile_0.npz"), combinations=[0])
            self.assertNotEqual(row["cause"], "policy_failed", row["reason"])

    def test_sorting_is_imitated(self):
        few = ["--task", "SortInHand", "--kinds", "script,tactile", "--episodes", "3", "--tests", "2", "--rounds", "2", "--seeds", "1", "--epochs", "4"]
        with tempfile.TemporaryDirectory() as folder:
            told = self.run_example(folder, "imitate.py", *few, "--out", "made")
            self.assertRegex(told, "script that knows the class, seed , the benchmark's errors: [0-2] of 2")
            self.assertRegex(told, "tactile, seed 0, the benchmark's errors: [0-2] of 2")
            self.assertTrue((Path(folder) / "made/tactile_0.npz").exists())

    def test_the_candidates_are_taken_in_order(self):
        sys.path.insert(0, str(EXAMPLES))
        from candidates_in_order import CandidatesInOrder

        (row,) = bench.run(CandidatesInOrder(), combinations=[1])
        self.assertNotEqual(row["cause"], "policy_failed", row["reason"])

    def test_a_choice_is_learned(self):
        sys.path.insert(0, str(EXAMPLES))
        from learned_choice import LearnedChoice, explore, fitted, unseen_predictions

        ((combination, seed, known, clean),) = explore((0, 1, 2))
        self.assertEqual((combination, seed), (0, 2))
        self.assertTrue(np.all(np.isfinite(known)) and isinstance(clean, bool))
        random = np.random.default_rng(0)
        # Trials in which one number decides the outcome.
        inputs = np.tile(known, (400, 1))
        inputs[:, -1] = random.random(400)
        outcomes, folds = (inputs[:, -1] > 0.4).astype(float), np.arange(400) % 4
        predicted = unseen_predictions(inputs, outcomes, folds, epochs=300, hidden=8)
        self.assertLess(((predicted - outcomes) ** 2).mean(), 0.4 * outcomes.var())
        # And trials in which nothing does.
        drawn = random.permutation(outcomes)
        predicted = unseen_predictions(inputs, drawn, folds, epochs=300, hidden=8)
        self.assertGreater(((predicted - drawn) ** 2).mean(), 0.9 * drawn.var())
        with tempfile.TemporaryDirectory() as folder:
            fitted(inputs, outcomes, 20, 8, random).save(Path(folder) / "choice.npz")
            (row,) = bench.run(LearnedChoice(Path(folder) / "choice.npz"), combinations=[0])
        self.assertNotEqual(row["cause"], "policy_failed", row["reason"])

    def test_the_best_grasp_is_chosen(self):
        with tempfile.TemporaryDirectory() as folder:
            few = ["--objects", "gem", "--most", "4", "--episodes", "2", "--rounds", "2", "--out", "chosen.json"]
            self.run_example(folder, "choose_grasps.py", *few)
            chosen = json.loads((Path(folder) / "chosen.json").read_text())["gem"]
            self.assertEqual((chosen["object"], chosen["of"]), ("gem", 6))
            # Two of the four hold it in nearly every episode, the first one in hardly any.
            self.assertGreater(chosen["held"], 2)


if __name__ == "__main__":
    unittest.main()
