"""Policies of one's own in the benchmark's trials."""

import unittest

import numpy as np

from ftac import bench, envs

COLUMNS = {"policy", "combination", "trial", "success", "contact", "clean_success", "cause", "reason", "sim_seconds"}


class Answers:
    """Answers by a function of the situation, and keeps the situations."""

    def __init__(self, answer):
        self.answer, self.situations, self.told = answer, [], []

    def reset(self, info):
        self.told.append(info)

    def choose(self, situation):
        self.situations.append(situation)
        return self.answer(situation)


class Acts:
    """Does the same in every step."""

    def __init__(self, action):
        self.action = action

    def act(self, observation):
        return self.action


class Lowers:
    """Lowers the palm for a second, and keeps what it was told."""

    features = {"images": 16, "grasp": True}
    ACTION = np.array([0.0, 0.0, -0.2, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0])

    def reset(self, info):
        self.told, self.seen = info, []

    def act(self, observation):
        self.seen.append(observation)
        return self.ACTION if len(self.seen) <= 20 else None


class Bench(unittest.TestCase):
    def test_a_policy_is_told_what_is_known_and_runs_its_trial(self):
        policy = Answers(lambda situation: 0 if situation.phase == "decide" else None)
        rows = bench.run(policy, combinations=[3], trials=2, beside=["blind"])
        self.assertEqual([row["policy"] for row in rows], ["Answers", "blind"] * 2)
        self.assertTrue(all(COLUMNS <= set(row) for row in rows))
        self.assertEqual([info["trial"] for info in policy.told], [0, 1])
        first = policy.situations[0]
        self.assertEqual((first.phase, first.tries, first.detected.shape, first.servos.shape), ("decide", 0, (2, 7), (6, 3)))
        self.assertEqual((len(first.tactile), first.tactile["index_distal"].shape), (18, (240, 240, 3)))
        self.assertEqual((first.in_hand.shape, first.in_hand_covariance.shape), ((7,), (6, 6)))
        self.assertTrue(all(grasp.object == first.objects[1] for grasp in first.candidates))
        self.assertEqual(set(bench.rates(rows)), {"Answers", "blind"})
        bench._benchmark.cache_clear()
        (again,) = bench.run(policy, combinations=[3])
        # How long a decision took is measured in wall time; all else is the same on every run.
        same = {name: value for name, value in again.items() if name != "decision_ms"}
        self.assertEqual(same, {name: rows[0][name] for name in same})

    def test_a_policy_that_fails_loses_its_trial_and_nothing_else(self):
        def fails(situation):
            raise KeyError("where is it?")

        for answer, words in [
            (fails, "where is it?"),
            (lambda situation: 999, "found candidate 999"),
            (lambda situation: (0, (float("nan"), 0.0, 0.0)), "NaN"),
            (lambda situation: "the left one", "Error"),
        ]:
            (row,) = bench.run(Answers(answer), combinations=[0])
            self.assertEqual((row["cause"], row["success"]), ("policy_failed", False))
            self.assertIn(words, row["reason"])

    def test_a_policy_that_acts_sees_what_is_measured_and_moves_the_robot(self):
        policy = Lowers()
        (row,) = bench.run(policy, combinations=[0])
        self.assertEqual((row["policy"], row["cause"], row["reason"]), ("Lowers", "not_finished", "the policy has finished"))
        self.assertAlmostEqual(row["sim_seconds"], (len(policy.seen) - 1) / 20, places=6)
        self.assertEqual(policy.told["objects"], ("salt_mill", "lemon"))
        first, last = policy.seen[0], policy.seen[-1]
        self.assertEqual((first["tactile"].shape, first["tactile"].dtype), ((17, 16, 16, 3), np.uint8))
        space = envs.Pick("pick_two", images=16, grasp=True).observation_space
        time_left = first.pop("time_left")
        self.assertIn(first, space)
        np.testing.assert_allclose(first["command"][:5], -1.0)
        # A tenth of 4 N in each step but the last, of 60 N.
        tension = 0.4 * (len(policy.seen) - 1)
        np.testing.assert_allclose(last["command"][1], 2.0 * tension / 60.0 - 1.0, atol=1e-6)
        # Down at 0.2 of the greatest speed.
        fallen = 0.5 * (first["palm"][2] - last["palm"][2])
        self.assertAlmostEqual(fallen, 0.2 * 0.25 * (len(policy.seen) - 1) / 20, delta=0.02)
        self.assertLess(last["time_left"], time_left)

    def test_a_policy_that_acts_badly_loses_its_trial(self):
        for action, words in [
            (np.full(12, np.nan), "expected 12 numbers from -1 to 1"),
            (np.zeros(7), "expected 12 numbers from -1 to 1"),
            (np.full(12, 1.5), "expected 12 numbers from -1 to 1"),
            ("left", "expected 12 numbers from -1 to 1"),
        ]:
            (row,) = bench.run(Acts(action), combinations=[0])
            self.assertEqual(row["cause"], "policy_failed")
            self.assertIn(words, row["reason"])

    def test_an_interrupt_ends_the_call(self):
        def interrupts(situation):
            raise KeyboardInterrupt

        with self.assertRaises(KeyboardInterrupt):
            bench.run(Answers(interrupts), combinations=[0])

    def test_former_names_work_and_are_reported(self):
        policy = Answers(lambda situation: None)
        with self.assertWarnsRegex(DeprecationWarning, "play is now called run"):
            bench.play(policy, combinations=[3])
        with self.assertWarnsRegex(DeprecationWarning, "Situation.grip is now called holding"):
            self.assertEqual(policy.situations[0].grip, policy.situations[0].holding)

    def test_what_cannot_be_run_is_refused_in_words(self):
        policy = Answers(lambda situation: None)
        both = Acts(None)
        both.choose = both.act
        for asked, words in [
            ({"policy": object()}, "found object with neither, expected an object with a method choose"),
            ({"policy": both}, "found Acts with choose and act"),
            ({"policy": Acts}, r"policy: found the class Acts, expected an object of it: Acts\(\)"),
            ({"policy": policy, "combinations": 5}, "combinations: found 5, expected a list of numbers"),
            ({"policy": policy, "beside": "tuch"}, "beside: found 'tuch'"),
            ({"policy": policy, "trials": 0}, "trials: found 0"),
            ({"policy": policy, "beside": ["tuch"]}, "beside: found 'tuch'"),
            ({"policy": policy, "combinations": [60]}, "combination: found 60, expected 0 to 59"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                bench.run(**asked)


if __name__ == "__main__":
    unittest.main()
