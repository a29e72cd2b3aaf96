"""Many environments side by side, and what they look like."""

import multiprocessing
import unittest
import warnings

import gymnasium
import numpy as np

from ftac import envs, vector


def images_of_many(reality):
    """Images of environments after a step, in this process. They begin together, on several threads."""
    many = vector.VectorPick(8, task="pick_one", images=16, reality=reality, jobs=8)
    many.reset(seed=1)
    return many.step(np.zeros((8, 12), dtype=np.float32))[0]["tactile"]


class Vector(unittest.TestCase):
    def test_many_do_what_one_does(self):
        for tactile in ("image", "change"):
            with self.subTest(tactile=tactile):
                self.many_do_what_one_does(tactile)

    def many_do_what_one_does(self, tactile):
        many = gymnasium.make_vec("ftac/PickOne-v1", num_envs=3, images=16, tactile=tactile, reward="shaped")
        observed, info = many.reset(seed=7)
        self.assertEqual((observed["tactile"].shape, len(info["objects"])), ((3, 17, 16, 16, 3), 3))
        untouched = info["untouched"] if tactile == "image" else np.full_like(info["untouched"], 128)
        np.testing.assert_array_equal(untouched, observed["tactile"])
        one = envs.Pick("pick_one", images=16, tactile=tactile, reward="shaped")
        alone, _ = one.reset(seed=8)
        rng = np.random.default_rng(0)
        for _ in range(5):
            actions = rng.uniform(-1, 1, (3, 12)).astype(np.float32)
            observed, rewards, terminated, truncated, _ = many.step(actions)
            alone, reward, *_ = one.step(actions[1])
            self.assertEqual(rewards[1], reward)
        self.assertEqual(set(observed), set(alone))
        for name, value in alone.items():
            np.testing.assert_array_equal(observed[name][1], value)
        # The cameras' noise: images had to be taken anew.
        self.assertTrue((observed["tactile"] != untouched).any())

    def test_an_episode_that_is_over_begins_anew_in_the_next_step(self):
        many = vector.VectorPick(2, task="pick_one", max_episode_steps=3)
        many.reset(seed=1)
        still = np.zeros((2, 12), dtype=np.float32)
        truncated = [many.step(still)[3].tolist() for _ in range(7)]
        ends = [[True, True] if n in (2, 6) else [False, False] for n in range(7)]
        self.assertEqual(truncated, ends)

    def test_an_action_that_is_refused_steps_none(self):
        many = vector.VectorPick(2, task="pick_one")
        before, _ = many.reset(seed=1)
        bad = np.zeros((2, 12), dtype=np.float32)
        bad[1, 3] = np.nan
        for action, words in [(bad, "expected numbers from -1 to 1"), (bad[:1], r"actions: found shape \(1, 12\)")]:
            with self.assertRaisesRegex(ValueError, words):
                many.step(action)
        for env, seen in zip(many.envs, before["arm"]):
            np.testing.assert_array_equal(env._observe()["arm"], seen)

    def test_a_gpu_forms_nearly_the_same_images(self):
        for options in ({"renderer": "gpu"}, {"renderer": "gpu", "images": 64}):
            with self.assertRaisesRegex(ValueError, "renderer: found gpu for images=.*, expected images=240"):
                vector.VectorPick(2, task="pick_one", **options)
        with self.assertRaisesRegex(ValueError, "renderer: found 'cuda', expected cpu or gpu"):
            envs.Pick(renderer="cuda", images=240)
        action = np.zeros((2, 12), dtype=np.float32)
        seen = {}
        for renderer in ("cpu", "gpu"):
            many = vector.VectorPick(2, task="pick_one", images=240, renderer=renderer)
            try:
                many.reset(seed=1)
            except RuntimeError as error:
                self.assertEqual(renderer, "gpu")
                self.assertRegex(str(error), "renderer: GPU: found .*; expected a GPU")
                return
            seen[renderer] = many.step(action)[0]["tactile"].astype(np.int16)
        self.assertLess((abs(seen["gpu"] - seen["cpu"]) > 1).mean(), 0.001)

    @unittest.skipUnless("fork" in multiprocessing.get_all_start_methods(), "processes are not forked here")
    def test_a_forked_process_forms_images_too(self):
        here = images_of_many(True)
        with warnings.catch_warnings():
            # Python warns of forking a process with threads, which is what is tried.
            warnings.simplefilter("ignore", DeprecationWarning)
            with multiprocessing.get_context("fork").Pool(1) as forked:
                # What this process has not made yet, the forked one makes itself.
                there, made_there = forked.map_async(images_of_many, [True, False]).get(timeout=300)
        np.testing.assert_array_equal(here, there)
        np.testing.assert_array_equal(images_of_many(False), made_there)

    def test_saved_states_are_restored(self):
        many = vector.VectorPick(2, task="pick_one", images=16)
        many.reset(seed=3)
        actions = np.full((2, 12), 0.3, dtype=np.float32)
        kept = many.save()
        first = many.step(actions)
        again = many.restore(kept)
        self.assertEqual(set(again), set(first[0]))
        second = many.step(actions)
        for name, value in first[0].items():
            np.testing.assert_array_equal(value, second[0][name])
        np.testing.assert_array_equal(first[1], second[1])
        with self.assertRaisesRegex(ValueError, "states: found 1, expected 2"):
            many.restore(kept[:1])

    def test_the_steps_of_an_episode_are_restored_too(self):
        many = vector.VectorPick(2, task="pick_one", max_episode_steps=6)
        many.reset(seed=3)
        still = np.zeros((2, 12), dtype=np.float32)
        for _ in range(2):
            many.step(still)
        kept = many.save()
        ends = [[False, False]] * 3 + [[True, True], [False, False]]
        for _ in range(2):
            self.assertEqual([many.step(still)[3].tolist() for _ in range(5)], ends)
            many.restore(kept)
        for _ in range(4):
            many.step(still)
        # What is over begins anew in the next step, after a return to it as well.
        kept = many.save()
        begun = many.step(still)[0]
        many.restore(kept)
        again, rewards, terminated, truncated, _ = many.step(still)
        np.testing.assert_array_equal(begun["servos"], again["servos"])
        self.assertFalse(rewards.any() or terminated.any() or truncated.any())

    def test_who_begins_anew_tells_with_what(self):
        many = gymnasium.make_vec("ftac/Sort-v1", num_envs=2, images=8, max_episode_steps=2)
        still = np.zeros((2, 12), dtype=np.float32)
        _, begun = many.reset(seed=5)
        self.assertTrue(begun["_class"].all() and begun["_objects"].all())
        for step in (1, 2):
            info = many.step(still)[4]
            self.assertNotIn("class", info)
            self.assertTrue(info["_held"].all() and info["_is_success"].all(), step)
        _, _, _, _, info = many.step(still)
        self.assertTrue(info["_class"].all() and info["_untouched"].all())
        self.assertFalse(info["_held"].any())
        self.assertEqual(info["held"].tolist(), [None, None])
        alone = [env.class_of_object for env in many.envs]
        self.assertEqual(info["class"].tolist(), alone)
        self.assertEqual([names[0] in many.envs[0].classes[one] for names, one in zip(info["objects"], alone)], [True, True])

    def test_limits_and_threads_are_checked(self):
        for options, words in [
            ({"max_episode_steps": 0}, "max_episode_steps: found 0, expected 1 to"),
            ({"max_episode_steps": "x"}, "max_episode_steps: found 'x', expected a whole number"),
            ({"jobs": 0}, "jobs: found 0, expected 1 to"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                vector.VectorPick(2, task="pick_one", **options)
        # As Gymnasium's own: no limit.
        many = vector.VectorPick(1, task="pick_one", max_episode_steps=-1)
        many.reset(seed=1)
        self.assertFalse(any(many.step(np.zeros((1, 12), dtype=np.float32))[3][0] for _ in range(3)))


class Pictures(unittest.TestCase):
    def test_a_picture_shows_the_hand_and_moves_with_it(self):
        env = gymnasium.make("ftac/PickTwo-v1", render_mode="rgb_array")
        env.reset(seed=1)
        before = env.render()
        self.assertEqual((before.shape, before.dtype), ((480, 480, 3), np.uint8))
        self.assertGreater(before.std(), 10)
        for _ in range(10):
            env.step(np.array([0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], dtype=np.float32))
        self.assertGreater((env.render() != before).mean(), 0.01)
        self.assertIsNone(gymnasium.make("ftac/PickOne-v1").unwrapped.render())


if __name__ == "__main__":
    unittest.main()
