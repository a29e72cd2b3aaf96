"""What a learner relies on: scales, kinds of actions, rewards, randomisation, saved states, goals."""

import unittest
import warnings

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

import ftac
from ftac import envs, features
from ftac.scripted import Script, palm_of


def run(env, act, steps=300):
    """The return of an episode, and its last info."""
    observation, info = env.reset(seed=3)
    act, total = act(env), 0.0
    for _ in range(steps):
        observation, reward, over, _, info = env.step(act(observation))
        total += reward
        if over:
            break
    return total, info


class Scales(unittest.TestCase):
    def test_all_numbers_are_bounded_and_zeros_keep_still(self):
        env = envs.Pick("pick_two", identity=True, grasp=True, privileged=True)
        observation, _ = env.reset(seed=3)
        self.assertIn(observation, env.observation_space)
        before, _ = observation, None
        for _ in range(20):
            observation, *_ = env.step(np.zeros(12))
            self.assertIn(observation, env.observation_space)
        moved = features.REACH * np.abs(observation["palm"][:3] - before["palm"][:3]).max()
        self.assertLess(moved, 1e-3)
        self.assertLess(np.abs(observation["servos"][:, 0] - before["servos"][:, 0]).max(), 0.02)

    def test_every_number_has_a_name(self):
        spec = features.Spec(identity=True, grasp=True, arm="joints", hand="spools")
        names = features.names(spec, 2)
        for name, shape in features.shapes(spec, 2).items():
            self.assertEqual(len(names[name]), int(np.prod(shape)), name)
            self.assertEqual(len(set(names[name])), len(names[name]), name)
        self.assertEqual(len(names["action"]), features.action_size(spec))

    def test_relative_poses_lead_to_the_object(self):
        env = envs.Pick(reality=False)
        observation, info = env.reset(seed=2)
        palm = palm_of(observation)
        at = palm[:3, 3] + palm[:3, :3] @ (features.REACH * observation["objects"][0, :3].astype(np.float64))
        np.testing.assert_allclose(at, info["detected"][0, :3], atol=1e-6)

    def test_every_kind_of_action_moves_the_robot_as_it_says(self):
        for arm in ("palm_twist", "palm_pose", "joints", "joint_steps"):
            for hand in ("tensions", "spools", "spool_steps"):
                env = envs.Pick(arm=arm, hand=hand)
                before, _ = env.reset(seed=1)
                action = np.zeros(env.action_space.shape)
                if arm == "joints":
                    action[:-6] = before["arm"][:, 0]
                    action[0] += 0.05
                elif arm == "palm_pose":
                    action[:3] = before["palm"][:3] + (0.0, 0.1, 0.0)
                else:
                    action[0] = 0.5
                action[-5] = 0.2
                for _ in range(20):
                    after, *_ = env.step(action)
                self.assertGreater(np.abs(after["palm"][:3] - before["palm"][:3]).max(), 0.01, (arm, hand))
                if arm == "palm_pose":
                    np.testing.assert_allclose(after["palm"][:3], action[:3], atol=0.01)
                if arm == "joints":
                    np.testing.assert_allclose(after["arm"][:, 0], action[:-6], atol=0.005)
                self.assertGreater(after["servos"][1, 0], before["servos"][1, 0] + 0.02, (arm, hand))
                # A refused action moves no set-point.
                command = after["command"]
                with self.assertRaises(ValueError):
                    env.step(np.full(action.shape, 2.0))
                np.testing.assert_array_equal(env._observe()["command"], command)

    def test_images_of_changes_are_grey_where_nothing_is_touched(self):
        env = envs.Pick(images=16, tactile="change")
        observation, _ = env.reset(seed=1)
        self.assertTrue(np.all(observation["tactile"] == 128))


class Rewards(unittest.TestCase):
    def test_the_shaped_reward_is_climbed_by_the_script_and_not_by_chance(self):
        rng = np.random.default_rng(0)
        env = envs.Pick(combination=0, reality=False, reward="shaped")
        scripted, info = run(env, lambda env: Script(env.features).act)
        self.assertTrue(info["is_success"])
        by_chance, _ = run(env, lambda env: lambda _: rng.uniform(-1.0, 1.0, 12))
        still, _ = run(env, lambda env: lambda _: np.zeros(12), 50)
        self.assertGreater(scripted, 2.0)
        self.assertLess(by_chance, 0.5 * scripted)
        self.assertLess(abs(still), 0.01)

    def test_objects_of_two_pick_ups_with_one_number_are_held_too(self):
        for name in ("billiard_ball", "bottle"):
            env = envs.Pick(objects=[name], reality=False)
            _, info = run(env, lambda env: Script(env.features).act)
            self.assertTrue(info["is_success"], name)

    def test_weights_are_data(self):
        env = envs.Pick(combination=0, reality=False, reward={"reach": 2.0, "step": -0.01})
        env.reset(seed=1)
        before = env._progress[0]
        _, reward, _, _, info = env.step(np.array([1.0] + [0.0] * 11))
        self.assertAlmostEqual(reward, 2.0 * (info["progress"]["reach"] - before) - 0.01, places=12)


class Choices(unittest.TestCase):
    def test_objects_are_chosen_and_told_apart(self):
        env = envs.Pick(objects=["lemon", "can_66"], identity=True)
        drawn = set()
        for seed in range(8):
            observation, info = env.reset(seed=seed)
            drawn.add(info["objects"][0])
            self.assertEqual(ftac.objects()[int(observation["identity"][0].argmax())], info["objects"][0])
        self.assertEqual(drawn, {"lemon", "can_66"})
        _, info = env.reset(seed=1, options={"objects": ["vase"]})
        self.assertEqual(info["objects"], ["vase"])
        with self.assertRaisesRegex(ValueError, "object: found `lemmon`, expected one of"):
            env.reset(options={"objects": ["lemmon"]})

    def test_fields_of_the_scenario_and_the_robot_are_drawn(self):
        drawn = {"effects.cables.friction": (0.5, 2.0), "noise.perception.xy_sigma": [0.0, 0.01]}
        env = envs.Pick(randomization=drawn, robot_instances=(1, 50))
        told = [env.reset(seed=seed)[1]["drawn"] for seed in range(4)]
        frictions = [one["effects.cables.friction"] for one in told]
        self.assertTrue(all(0.5 <= value <= 2.0 for value in frictions) and len(set(frictions)) == 4, told)
        self.assertGreater(len({one["robot_instance"] for one in told}), 1)
        self.assertEqual(env.reset(seed=2)[1]["drawn"], told[2])
        # Another friction changes what the servos need for the same posture.
        ends = []
        for friction in (0.0, 3.0):
            one = envs.Pick(combination=0, randomization={"effects.cables.friction": friction})
            one.reset(seed=1)
            for _ in range(15):
                observation, *_ = one.step(np.array([0.0] * 6 + [1.0] * 5 + [0.0]))
            ends.append(observation["servos"][:, 0])
        self.assertGreater(np.abs(ends[0] - ends[1]).max(), 1e-3)
        for name, words in [
            ("effects.cables.frictoin", "randomization.effects.cables.frictoin: found no such field, expected one of backlash, friction"),
            ("protocol.time_limit", "randomization: found a field of `protocol`, expected one of noise, effects, layout"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                envs.Pick(randomization={name: 1.0})
        self.assertIn("effects.gel.shear", ftac.randomization.fields())

    def test_all_that_can_be_drawn_is_checked_before_an_episode_begins(self):
        friction = "effects.cables.friction"
        for given, words in [
            ({friction: (0.5, 6.0)}, "friction: found 6.*, expected 0 to 5"),
            ({friction: [0.5, "x"]}, "friction"),
            ({friction: np.float32("nan")}, "randomization.effects.cables.friction: found nan, expected a finite number"),
            # Each value alone is fine, but not together.
            ({"layout.spread_xy": [0.02, 0.03], "layout.first.y": [0.14, 0.1]}, "places that may be .* apart"),
            ({friction: None}, "randomization.effects.cables.friction: found None, expected a number"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                envs.Pick(randomization=given)
        for given in (np.float32(1.5), np.array([1.5, 1.5]), [np.float64(1.5)]):
            self.assertEqual(envs.Pick(randomization={friction: given}).reset(seed=1)[1]["drawn"], {friction: 1.5})
        reach = envs.Pick(randomization={"layout.reach_x": [[0.5, 0.7]]}).reset(seed=1)[1]["drawn"]
        self.assertEqual(reach, {"layout.reach_x": [0.5, 0.7]})

    def test_an_effect_that_is_off_is_drawn_as_a_whole(self):
        friction = {"effects.cables.friction": (0.5, 2.0)}
        words = "randomization.effects.cables: found friction of an effect that is off .*; missing are backlash"
        with self.assertRaisesRegex(ValueError, words):
            envs.Pick(reality=False, randomization=friction)
        env = envs.Pick(reality=False, randomization={**friction, "effects.cables.backlash": 0.0})
        _, info = env.reset(seed=1)
        self.assertTrue(0.5 <= info["drawn"]["effects.cables.friction"] <= 2.0)

    def test_what_is_given_is_not_changed(self):
        table = {"friction": 1.0, "backlash": 0.0}
        env = envs.Pick(randomization={"effects.cables": table, "effects.cables.friction": (2.0, 3.0)})
        self.assertGreater(env.reset(seed=1)[1]["drawn"]["effects.cables.friction"], 2.0)
        self.assertEqual(table, {"friction": 1.0, "backlash": 0.0})

    def test_a_critic_may_know_the_truth(self):
        env = envs.Pick(privileged=True)
        observation, info = env.reset(seed=5)
        true = env._episode.true_state()
        palm = features.pose_matrix(true["palm"])
        at = palm[:3, 3] + palm[:3, :3] @ (features.REACH * observation["privileged"][:3].astype(np.float64))
        np.testing.assert_allclose(at, true["objects"][0, :3], atol=1e-6)

    def test_a_camera_looks_at_the_scene(self):
        env = envs.Pick(camera=64)
        before, _ = env.reset(seed=1)
        for _ in range(10):
            after, *_ = env.step(np.array([0.0, 1.0] + [0.0] * 10))
        self.assertGreater((before["scene_camera"] != after["scene_camera"]).mean(), 0.01)


class States(unittest.TestCase):
    def test_a_saved_state_is_restored_to_the_bit_and_any_number_of_times(self):
        env = envs.Pick("pick_one", images=16)
        env.reset(seed=4)
        rng = np.random.default_rng(1)
        env.step(rng.uniform(-1, 1, 12))
        kept, actions = env.save(), rng.uniform(-1, 1, (5, 12))

        def go():
            return [env.step(action) for action in actions][-1]

        first = go()
        for _ in range(2):
            env.restore(kept)
            again = go()
            for name, value in first[0].items():
                np.testing.assert_array_equal(value, again[0][name], name)
            self.assertEqual(first[1], again[1])

    def test_a_state_of_another_environment_is_refused(self):
        env = envs.Pick()
        env.reset(seed=1)
        kept = env.save()
        for other in (envs.Pick("pick_two"), envs.Pick(images=16), envs.LiftTo()):
            with self.assertRaisesRegex(ValueError, "state: found one of pick_one, .*; expected one of .*, with the same robot, scenario and options"):
                other.restore(kept)
        with self.assertRaisesRegex(ValueError, "state: found NoneType, expected what save"):
            env.restore(None)


class Goals(unittest.TestCase):
    def test_goals_are_relabelled(self):
        env = gymnasium.make("ftac/LiftTo-v1").unwrapped
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            check_env(env)
        observation, _ = env.reset(seed=1)
        observation, reward, _, _, info = env.step(np.zeros(12))
        self.assertEqual(reward, env.compute_reward(observation["achieved_goal"], observation["desired_goal"], info))
        achieved = np.stack([observation["achieved_goal"]] * 2)
        desired = np.stack([observation["achieved_goal"], observation["desired_goal"]])
        infos = np.array([{"held": [True]}, {"held": [True]}])
        np.testing.assert_array_equal(env.compute_reward(achieved, desired, infos), [0.0, -1.0])
        with self.assertRaisesRegex(ValueError, "info: found .*, expected a step's info with 'held' for each goal.*copy_info_dict=True"):
            env.compute_reward(achieved, desired, [{}, {}])
        with self.assertRaisesRegex(ValueError, "info: found 1, expected one for each"):
            env.compute_reward(achieved, desired, infos[:1])
        self.assertEqual(env.compute_reward(achieved[:0], desired[:0], []).shape, (0,))
        infos[0] = {"held": [False]}
        np.testing.assert_array_equal(env.compute_reward(achieved, desired, infos), [-1.0, -1.0])

    def test_images_and_parts_are_those_of_pick_one(self):
        choices = {"images": 16, "tactile": "change", "grasp": True}
        env = gymnasium.make("ftac/LiftTo-v1", tolerance=0.01, **choices).unwrapped
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            check_env(env)
        observation, _ = env.reset(seed=3)
        picked, _ = gymnasium.make("ftac/PickOne-v1", **choices).unwrapped.reset(seed=3)
        self.assertEqual({*env.parts(observation["observation"]), "tactile"}, set(picked))
        for name, value in {**env.parts(observation["observation"]), "tactile": observation["tactile"]}.items():
            np.testing.assert_array_equal(value, picked[name], name)

    def test_the_tolerance_decides(self):
        held = {"held": [True]}
        for tolerance, reward in ((0.01, -1.0), (0.03, 0.0)):
            env = gymnasium.make("ftac/LiftTo-v1", tolerance=tolerance).unwrapped
            self.assertEqual(env.compute_reward(np.zeros(3), np.array([0.02 / 0.5, 0.0, 0.0]), held), reward)
        with self.assertRaisesRegex(ValueError, "tolerance: found 0, expected a positive number, m"):
            gymnasium.make("ftac/LiftTo-v1", tolerance=0)


if __name__ == "__main__":
    unittest.main()
