"""Sorting by touch: what decides an episode, what a policy cannot see, and saved states."""

import unittest
import warnings

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

import ftac  # noqa: F401  (registers the environments)
from ftac.scripted import CARRY, Script
from ftac.sorting import ANY_SIZE


def run(env, place, kind=1, steps=300):
    """The last step's ``terminated``, info and return of an episode in which the script carries an object of a class to a place."""
    observation, info = env.reset(seed=5, options={"class": kind})
    script, total = Script(env.features, place=place), 0.0
    for _ in range(steps):
        observation, reward, terminated, _, info = env.step(script.act(observation))
        total += reward
        if terminated:
            break
    return terminated, info, total


class Sorting(unittest.TestCase):
    def setUp(self):
        self.env = gymnasium.make("ftac/Sort-v1", reality=False, grasp=True).unwrapped

    def test_gymnasium_accepts_it(self):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            check_env(self.env)

    def test_the_bin_decides(self):
        terminated, info, total = run(self.env, self.env.bins[1])
        self.assertTrue(terminated and info["is_success"] and info["held"][0])
        self.assertEqual(total, 1.0)
        terminated, info, total = run(self.env, self.env.bins[2])
        self.assertTrue(terminated and info["held"][0] and not info["is_success"])
        self.assertEqual(total, 0.0)
        # An object that is only lifted is over no bin.
        terminated, info, _ = run(self.env, None)
        self.assertTrue(info["held"][0] and not terminated)

    def test_the_shape_is_not_seen(self):
        seen = []
        for kind in range(3):
            observation, info = self.env.reset(seed=8, options={"class": kind})
            self.assertEqual(info["class"], kind)
            self.assertIn(info["objects"][0], self.env.classes[kind])
            np.testing.assert_array_equal(observation["shape"], 0.0)
            seen.append(observation)
        for name in ("servos", "arm", "palm", "command", "time", "shape"):
            for other in seen[1:]:
                np.testing.assert_array_equal(seen[0][name], other[name], name)
        tensions = [observation["grasp"][0, 13:] for observation in seen]
        np.testing.assert_array_equal(tensions[0], tensions[2])

    def test_objects_have_any_size(self):
        env = gymnasium.make("ftac/Sort-v1", randomization=ANY_SIZE).unwrapped
        radii = []
        for seed in range(8):
            env.reset(seed=seed, options={"class": 0})
            radii.append(env.save().episode.true_state()["objects"][0, 2])
        # A ball lies with its middle one radius over the table; the two balls of the class differ by 2.5 mm.
        self.assertGreater(np.ptp(radii), 0.005)

    def test_all_objects_are_drawn(self):
        drawn = set()
        for seed in range(40):
            _, info = self.env.reset(seed=seed)
            drawn.add((info["class"], *info["objects"]))
        expected = {(number, name) for number, names in enumerate(self.env.classes) for name in names}
        self.assertEqual(drawn, expected)

    def test_a_saved_state_goes_on_the_same(self):
        observation, _ = self.env.reset(seed=5, options={"class": 1})
        script = Script(self.env.features, place=self.env.bins[1])
        while not self.env._steps_over[1]:
            observation, *_ = self.env.step(script.act(observation))
        kept, zeros = self.env.save(), np.zeros(12)

        def steps_to_the_end(env):
            for step in range(30):
                _, _, terminated, _, info = env.step(zeros)
                if terminated:
                    return step, info["is_success"]

        first = steps_to_the_end(self.env)
        self.assertTrue(first and first[1])
        other = gymnasium.make("ftac/Sort-v1", reality=False, grasp=True).unwrapped
        other.reset(seed=1, options={"class": 0})
        other.restore(kept)
        self.assertEqual(steps_to_the_end(other), first)

    def test_it_begins_with_the_object_in_hand(self):
        env = gymnasium.make("ftac/Sort-v1", reality=False, grasp=True, in_hand=True, arm="joints", hand="spools").unwrapped
        observation, info = env.reset(seed=5, options={"class": 2})
        self.assertEqual(info["class"], 2)
        self.assertIn(observation, env.observation_space)
        # Actions of any kind go on from there: the spools stay wound.
        spools, joints = observation["command"], observation["arm"][:, 0]
        for _ in range(10):
            _, _, over, _, info = env.step(np.concatenate([joints, spools]))
        self.assertTrue(info["held"][0] and not over)
        env = gymnasium.make("ftac/Sort-v1", reality=False, grasp=True, in_hand=True).unwrapped
        _, info = env.reset(seed=5, options={"class": 1})
        script = Script(env.features, place=env.bins[1], stage=CARRY)
        observation = env._observe()
        for _ in range(100):
            observation, _, over, _, info = env.step(script.act(observation))
            if over:
                break
        self.assertTrue(info["is_success"])

    def test_bad_input_is_named(self):
        for choices, message in (
            ({"classes": [["egg"]]}, "classes: found .*, expected the names of the objects of two to 4 classes"),
            ({"classes": [["egg"], []]}, "expected one name at least in each"),
            ({"classes": [["egg"], ["egg"]]}, "each name once"),
            ({"classes": ["egg", "pawn"]}, "expected one name at least in each"),
            ({"grasp_of": "house"}, "grasp_of: found 'house', expected one of "),
            ({"objects": ["egg"]}, "objects: found .*, expected none"),
            ({"identity": True}, "identity: found True, expected none"),
            ({"combination": 0}, "combination: found 0, expected none"),
        ):
            with self.assertRaisesRegex(ValueError, message):
                gymnasium.make("ftac/Sort-v1", **choices)
        with self.assertRaisesRegex(ValueError, "class: found 3"):
            self.env.reset(options={"class": 3})
        with self.assertRaisesRegex(ValueError, "options: found 'objects'"):
            self.env.reset(options={"objects": ["egg"]})

    def test_many_side_by_side_are_as_one(self):
        many = gymnasium.make_vec("ftac/Sort-v1", num_envs=2, vectorization_mode="vector_entry_point", images=16)
        observations, info = many.reset(seed=5)
        many_next, *_ = many.step(np.zeros((2, 12), np.float32))
        for n in range(2):
            one = gymnasium.make("ftac/Sort-v1", images=16).unwrapped
            observation, told = one.reset(seed=5 + n)
            self.assertEqual(info["class"][n], told["class"])
            following, *_ = one.step(np.zeros(12, np.float32))
            for name in observation:
                np.testing.assert_array_equal(observations[name][n], observation[name], name)
                np.testing.assert_array_equal(many_next[name][n], following[name], name)


class SavedGoals(unittest.TestCase):
    def test_a_saved_state_has_its_goal(self):
        env, other = (gymnasium.make("ftac/LiftTo-v1").unwrapped for _ in range(2))
        observation, _ = env.reset(seed=1)
        other.reset(seed=2)
        np.testing.assert_array_equal(other.restore(env.save())["desired_goal"], observation["desired_goal"])


if __name__ == "__main__":
    unittest.main()
