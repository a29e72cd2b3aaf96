"""Many environments side by side, and what they look like."""

import unittest

import gymnasium
import numpy as np

from ftac import envs, vector


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
