"""Scenes and environments: bits by seed, nothing of the truth, and clear words for what cannot be."""

import copy
import pickle
import threading
import unittest
import warnings
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

import ftac
from ftac import _native, envs, vector
from ftac.scripted import Script

ROBOTS = Path(__file__).parents[3] / "hand-model" / "data" / "robots"
OBJECTS = [("lemon", 0.62, 0.14, 0.0), ("box_50", 0.62, -0.14, 0.0)]


class Scenes(unittest.TestCase):
    def test_the_same_actions_give_the_same_bits(self):
        def steps_of(seed):
            scene = ftac.Scene(OBJECTS, images=32, seed=seed)
            for n in range(6):
                seen = scene.step(twist=[0.1, 0, -0.1, 0, 0.2, 0], tensions=[n] * 5, opposition=0.3)
            return seen

        one, same = steps_of(4), steps_of(4)
        for name in one:
            np.testing.assert_array_equal(one[name], same[name])

    def test_a_copy_goes_its_own_way(self):
        scene = ftac.Scene(OBJECTS)
        twin = scene.copy()
        scene.step(twist=[0.2, 0, 0, 0, 0, 0])
        self.assertEqual((scene.observe()["time"] > 0, twin.observe()["time"]), (True, 0.0))
        twin.step(twist=[0.2, 0, 0, 0, 0, 0])
        np.testing.assert_array_equal(scene.observe()["arm"], twin.observe()["arm"])

    def test_a_pickled_scene_goes_on_alike(self):
        scene = ftac.Scene(OBJECTS, images=16, seed=4)
        joints = scene.observe()["arm"][:, 0] + 0.01
        scene.step(joints=joints, spools=[0.1] * 6)
        scene.step(twist=[0.1, 0, -0.1, 0, 0.2, 0], tensions=[1, 2, 3, 4, 5], opposition=0.3)
        text = pickle.dumps(scene)
        twin = pickle.loads(text)
        self.assertEqual(twin.objects, scene.objects)
        again = pickle.loads(pickle.dumps(twin))
        for one in (scene, twin, again):
            seen = one.step(tensions=[3.0] * 5)
            for name, value in scene.observe().items():
                np.testing.assert_array_equal(seen[name], value)
        version = ftac.__version__.encode()
        with self.assertRaisesRegex(ValueError, "pickle: found one of ftac 9.9.9, expected one of " + ftac.__version__):
            pickle.loads(text.replace(version, b"9.9.9"))

    def test_untouched_pads_look_as_at_the_beginning(self):
        scene = ftac.Scene(OBJECTS, images=16)
        before = scene.observe()["tactile"]
        scene.step(tensions=[40.0] * 5)
        np.testing.assert_array_equal(scene.untouched(), before)
        self.assertIsNone(ftac.Scene().untouched())

    def test_joints_and_spools_are_followed(self):
        scene = ftac.Scene()
        joints = scene.observe()["arm"][:, 0]
        joints[6] += 0.2
        for _ in range(40):
            seen = scene.step(joints=joints, spools=[0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
        self.assertLess(abs(seen["arm"][6, 0] - joints[6]), 0.01)
        self.assertLess(abs(seen["servos"][1, 0] - 1.0), 0.1)
        scene.step(twist=[0.0, 0.0, 0.1, 0.0, 0.0, 0.0])

    def test_the_hand_on_another_arm_moves_and_is_pickled(self):
        with self.assertRaisesRegex(ValueError, "nowhere.toml: No such file"):
            ftac.Scene(robot_model="nowhere.toml")
        scene = ftac.Scene([("lemon", 0.6, 0.0, 0.0)], robot_model=ROBOTS / "ftac_ur5e.toml")
        joints = scene.observe()["arm"][:, 0]
        self.assertEqual((joints.shape, scene.limits["joints"].shape), ((6,), (6, 2)))
        with self.assertRaisesRegex(ValueError, r"joints: found shape \(7,\), expected shape \(6,\)"):
            scene.step(joints=np.zeros(7))
        before = scene.observe()["palm"][2]
        for _ in range(10):
            seen = scene.step(twist=[0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
        self.assertAlmostEqual(seen["palm"][2] - before, 0.05, delta=0.01)
        joints = seen["arm"][:, 0] + 0.01
        scene.step(joints=joints)
        again = pickle.loads(pickle.dumps(scene))
        np.testing.assert_array_equal(scene.step(joints=joints)["arm"], again.step(joints=joints)["arm"])

    def test_what_is_no_scene_and_no_action_is_refused_and_changes_nothing(self):
        scene = ftac.Scene(OBJECTS)
        for action, words in [
            ({"twist": [0.0] * 5}, r"twist: found shape \(5,\)"),
            ({"twist": [np.nan] * 6}, r"palm velocity\[0\]: found NaN"),
            ({"twist": [9.0] * 6}, r"palm velocity\[0\]: found 9, expected -0.5 to 0.5 m/s"),
            ({"joints": [9.0] * 7}, r"arm joints\[1\]: found 9"),
            ({"twist": [0.0] * 6, "joints": [0.0] * 7}, "twist and joints"),
            ({"tensions": [-1.0] * 5}, r"tensions\[0\]: found -1"),
            ({"tensions": [0.0] * 5, "spools": [0.0] * 6}, "either tensions and opposition, or spools"),
            ({"spools": [np.inf] * 6}, r"spools\[0\]: found inf"),
            ({"twist": ["left"] * 6}, "twist: found .*, expected numbers"),
            ({"tensions": [[1.0, 2.0], [3.0]]}, "tensions: expected numbers"),
            ({"opposition": "a"}, "opposition: found 'a', expected a finite number"),
            ({"twist": [1j] * 6}, "twist: found complex numbers"),
            ({"tensions": np.zeros((5, 1))}, r"tensions: found shape \(5, 1\), expected shape \(5,\)"),
            ({"tensions": [0.0] * 5, "opposition": np.nan}, "opposition: found nan"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                scene.step(**action)
        self.assertEqual(scene.observe()["time"], 0.0)
        for make, words in [
            (lambda: ftac.Scene([("lemn", 0.6, 0.0, 0.0)]), "object: found `lemn`, expected one of "),
            (lambda: ftac.Scene([("lemon", np.nan, 0.0, 0.0)]), r"objects\[0\]: x: found nan, expected a finite number"),
            (lambda: ftac.Scene([("lemon", 9.0, 0.0, 0.0)]), "object `lemon`, x: found 9"),
            (lambda: ftac.Scene([("lemon", 0.62, 0.14)]), r"objects\[0\]: found \('lemon', 0.62, 0.14\), expected \(name, x, y, turn\)"),
            (lambda: ftac.Scene([("lemon", 0.62, 0.14, "a")]), r"objects\[0\]: turn: found 'a', expected a finite number"),
            (lambda: ftac.Scene([("lemon", 0.62, 0.0, 0.0), ("box_50", 0.63, 0.0, 0.0)]), "objects: found `box_50` .* mm inside `lemon`, expected objects that stand clear"),
            (lambda: ftac.Scene(images=241), "images: found 241, expected 8 to 240"),
            (lambda: ftac.Scene(images=1.5), "images: found 1.5, expected a whole number"),
            (lambda: ftac.Scene(seed=-1), "seed: found -1"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                make()

    def test_two_threads_on_one_scene_never_end_the_interpreter(self):
        scene, errors = ftac.Scene(OBJECTS), []

        def step():
            for _ in range(200):
                try:
                    scene.step(twist=[0.0] * 6)
                except RuntimeError as error:
                    errors.append(str(error))

        threads = [threading.Thread(target=step) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertTrue(all("another thread" in error for error in errors))
        scene.step(twist=[0.0] * 6)

    def test_a_scene_that_is_in_use_is_refused_and_goes_on_after_it(self):
        env = envs.Pick()
        before, _ = env.reset(seed=1)
        # The second of the two finds what the first has taken.
        with self.assertRaisesRegex(RuntimeError, "another thread"):
            _native.step_all([env._episode, env._episode], [(None, None, np.zeros(5), 0.0, None)] * 2, 2)
        np.testing.assert_array_equal(env._observe()["arm"], before["arm"])
        env.step(np.zeros(12, dtype=np.float32))


class Environments(unittest.TestCase):
    def test_gymnasium_s_checks_pass(self):
        for name in ("PickOne", "PickSecond", "PickTwo"):
            for images in (None, 16):
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    check_env(gymnasium.make(f"ftac/{name}-v1", images=images).unwrapped)

    def test_observations_hold_nothing_of_the_truth(self):
        env = envs.Pick("pick_one", images=16)
        observation, info = env.reset(seed=5)
        measured = {"servos", "arm", "palm", "command", "time", "objects", "shape", "tactile"}
        self.assertEqual(set(observation), measured)
        self.assertEqual(set(info), {"objects", "yaws", "combination", "detected", "drawn", "untouched"})
        np.testing.assert_array_equal(info["untouched"], observation["tactile"])
        true = env._episode.true_state()["objects"][0]
        # Vision errs: what is seen is not where the object is.
        self.assertGreater(np.abs(info["detected"][0, :3] - true[:3]).max(), 1e-5)
        _, _, _, _, info = env.step(env.action_space.sample())
        self.assertEqual(set(info), {"held", "is_success", "progress"})

    def test_the_second_pick_begins_with_the_first_object_held_and_keeps_it(self):
        env = envs.Pick("pick_second")
        env.reset(seed=2)
        for _ in range(30):
            _, _, over, _, info = env.step(np.zeros(12))
            self.assertFalse(over)
        self.assertEqual(info["held"], [True, False])

    def test_an_environment_has_the_robot_that_its_file_says(self):
        env = gymnasium.make("ftac/PickOne-v1", robot_model=ROBOTS / "ftac_panda.toml", combination=3)
        observation, _ = env.reset(seed=1)
        self.assertIn(observation, env.observation_space)
        self.assertFalse(np.array_equal(observation["arm"], gymnasium.make("ftac/PickOne-v1").reset(seed=1)[0]["arm"]))
        self.assertEqual(gymnasium.make("ftac/PickTwo-v1", robot_model=ROBOTS / "ftac_ur5e.toml").observation_space["arm"].shape, (6, 3))
        with self.assertRaisesRegex(ValueError, "pick_second.*expected `pick_one` or `pick_two` with ftac_panda"):
            gymnasium.make("ftac/PickSecond-v1", robot_model=ROBOTS / "ftac_panda.toml").reset(seed=1)

    def test_what_is_not_asked_for_rightly_is_refused(self):
        env = envs.Pick()
        with self.assertRaises(gymnasium.error.ResetNeeded):
            env.step(np.zeros(12))
        env.reset(seed=1)
        others = [np.zeros(12, dtype=complex), np.zeros(12, dtype=bool), ["left"] * 12, "left", None, [None] * 12]
        for action in (np.full(12, np.nan), np.zeros(11), np.zeros((1, 12)), np.full(12, 1.5), *others):
            with self.assertRaisesRegex(ValueError, "expected 12 numbers from -1 to 1"):
                env.step(action)
        for options, words in [
            ({"task": "pick_three"}, "task: found 'pick_three'"),
            ({"reward": "rich"}, "reward: found 'rich'"),
            ({"reward": {"reech": 1.0}}, "reward: found the term 'reech'"),
            ({"reward": {"lift": np.nan}}, "reward.lift: found nan"),
            ({"images": 7}, "images: found 7"),
            ({"arm": "fly"}, "arm: found 'fly', expected one of twist, palm_twist"),
            ({"objects": "lemon"}, "objects: found 'lemon', expected a list of names"),
            ({"objects": ["lemon", "lemmon"]}, "objects: found 'lemmon', expected one of lemon"),
            ({"reward": None}, "reward: found None, expected sparse, shaped, or weights"),
            ({"reward": {"lift": "a"}}, "reward.lift: found 'a', expected a finite number"),
            ({"randomization": [1]}, r"randomization: found \[1\], expected distributions"),
            ({"robot_instances": 5}, "robot_instances: found 5, expected the first and the last number"),
            ({"randomization": {"effects.gel.shear": (1.0, 0.5)}}, r"randomization.effects.gel.shear: found \(1.0, 0.5\)"),
            ({"robot_instances": (5, 3)}, "robot_instances: found 3, expected 5"),
            ({"render_mode": "human"}, "render_mode: found 'human'"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                envs.Pick(**options)
        for one in (envs.Pick(), vector.VectorPick(1)):
            one.reset(seed=1, options={})
            with self.assertRaisesRegex(ValueError, "options: found 'combinations', expected some of combination, objects"):
                one.reset(seed=1, options={"combinations": 3})
        with self.assertRaisesRegex(ValueError, "combination: found 60, expected 0 to 59"):
            envs.Pick(combination=60)

    def test_an_episode_that_is_over_is_not_stepped(self):
        env = envs.Pick(combination=0, reality=False)
        observation, info = env.reset(seed=3)
        script = Script(env.features)
        over = False
        while not over:
            observation, _, over, _, info = env.step(script.act(observation))
        self.assertTrue(info["is_success"])
        for _ in range(2):
            with self.assertRaisesRegex(gymnasium.error.ResetNeeded, "the episode is over"):
                env.step(script.act(observation))
        env.reset(seed=3)
        env.step(np.zeros(12, dtype=np.float32))

    def test_a_pickled_environment_goes_on_alike(self):
        env = envs.Pick("pick_one", images=16)
        env.reset(seed=4)
        action = np.full(12, 0.3, dtype=np.float32)
        env.step(action)
        twin = pickle.loads(pickle.dumps(env))
        for mine, its in zip(env.step(action)[0].values(), twin.step(action)[0].values()):
            np.testing.assert_array_equal(mine, its)
        # What is drawn next is drawn alike.
        np.testing.assert_array_equal(env.reset()[0]["objects"], twin.reset()[0]["objects"])

    def test_a_copied_environment_goes_on_alike(self):
        env = envs.Pick("pick_one", images=16)
        env.reset(seed=4)
        twin = copy.deepcopy(env)
        action = np.full(12, 0.3, dtype=np.float32)
        for mine, its in zip(env.step(action)[0].values(), twin.step(action)[0].values()):
            np.testing.assert_array_equal(mine, its)


if __name__ == "__main__":
    unittest.main()
