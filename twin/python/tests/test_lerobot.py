"""LeRobot data sets: what is read back is what was observed, statistics, video, atomic and continued writing, and policies on exported keys."""

import importlib
import importlib.util
import json
import shutil
import tempfile
import unittest
from pathlib import Path
from unittest import mock

import numpy as np

from ftac import features
from ftac.features import Spec

MISSING = [name for name in ("pyarrow", "av", "gymnasium") if importlib.util.find_spec(name) is None]
if not MISSING:
    import gymnasium
    import pyarrow.parquet as pq

    from ftac import bench, envs
    from ftac.lerobot import Episode, Layout, PolicyAdapter, Taught, Writer, record, statistics, tables, video
    from ftac.lerobot.layout import ACTION, ENVIRONMENT, IMAGES, STATE

SIDE = 16


def constant(env):
    """Closes the hand and rises, with some chance."""
    rng = np.random.default_rng(len(env.unwrapped.features.detected))

    def act(_):
        action = rng.uniform(-0.2, 0.2, env.action_space.shape)
        action[-6:-1] += 0.5
        return action.astype(np.float32)

    return act


def short():
    """Episodes of three steps."""
    return gymnasium.wrappers.TimeLimit(envs.Pick(images=SIDE), 3)


def led(env):
    """Is led to close the hand by a part drawn for each episode, and would do something else."""
    moves = np.full(12, np.random.default_rng([env.unwrapped.np_random_seed, 1]).uniform(0.5, 0.9), dtype=np.float32)
    return lambda observation: Taught(moves, np.full(12, 0.5, dtype=np.float32))


class Recording(list):
    """A policy that acts by chance and keeps the observations."""

    def __init__(self, size, steps):
        super().__init__()
        self.size, self.steps = size, steps

    def reset(self, info):
        self.rng, self.left = np.random.default_rng(7), self.steps

    def act(self, observation):
        self.left -= 1
        if self.left < 0:
            return None
        action = self.rng.uniform(-0.3, 0.3, self.size).astype(np.float32)
        self.append((observation, action))
        return action


@unittest.skipIf(MISSING, f"LEFT OUT: LeRobot data sets are NOT tested: {', '.join(MISSING)} missing")
class DataSet(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = Path(cls.folder.name) / "set"
        cls.env = envs.Pick("pick_two", images=SIDE, tactile="image", grasp=True, hand="tensions", camera=32, privileged=True)
        cls.policy = Recording(12, 6)
        cls.told = record(cls.env, cls.policy, 2, cls.root, seed=5, only_successes=False, quiet=True)
        cls.info = json.loads((cls.root / "meta/info.json").read_text())
        cls.table = pq.read_table(cls.root / "data/chunk-000/file-000.parquet")
        cls.episodes = pq.read_table(cls.root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
        cls.stats = json.loads((cls.root / "meta/stats.json").read_text())

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def column(self, name):
        return tables.read_column([self.root / "data/chunk-000/file-000.parquet"], name)

    def test_what_is_read_back_is_what_the_environment_gave(self):
        self.assertEqual((self.told["episodes"], self.told["frames"], len(self.policy)), (2, 12, 12))
        layout = Layout.read(self.root)
        self.assertEqual(layout, Layout.of(self.env))
        vectors = {name: self.column(name) for name in layout.names()}
        films = {key: video.read(self.root / f"videos/{key}/chunk-000/file-000.mp4") for key in layout.sides()}
        for n, (observation, action) in enumerate(self.policy):
            frame = {name: rows[n] for name, rows in vectors.items()}
            again = layout.observation(frame, {key: film[n] for key, film in films.items()})
            self.assertEqual(list(again), list(observation))
            for name, value in observation.items():
                np.testing.assert_array_equal(again[name], value, name)
            np.testing.assert_array_equal(frame[ACTION], action)

    def test_the_format_is_that_of_lerobot(self):
        self.assertEqual((self.info["codebase_version"], self.info["fps"], self.info["total_frames"]), ("v3.0", 20, 12))
        single = [name for name, feature in self.info["features"].items() if feature["dtype"] != "video"]
        self.assertEqual(set(self.table.column_names), set(single))
        for name, feature in self.info["features"].items():
            if feature["names"] and feature["dtype"] != "video":
                self.assertEqual(feature["shape"], [len(feature["names"])], name)
        self.assertEqual(self.table["next.done"].to_pylist(), ([False] * 5 + [True]) * 2)
        self.assertEqual(self.table["index"].to_pylist(), list(range(12)))
        second = self.episodes[1]
        self.assertEqual((second["dataset_from_index"], second["dataset_to_index"], second["seed"]), (6, 12, 6))
        self.assertEqual(second[f"videos/{IMAGES}thumb_distal/from_timestamp"], 0.3)
        tasks = pq.read_table(self.root / "meta/tasks.parquet").to_pylist()
        self.assertIn(second["tasks"][0], [row["task"] for row in tasks])
        # No policy is to read the truth.
        self.assertFalse([name for name in self.info["features"] if name.startswith("observation") and "privileged" in name])

    def test_statistics_are_those_of_numpy(self):
        for name in (STATE, ENVIRONMENT, ACTION, "timestamp", "next.reward"):
            values = self.column(name).astype(np.float64)
            for part, share in statistics.QUANTILES.items():
                np.testing.assert_allclose(self.stats[name][part], np.quantile(values, share, axis=0), atol=1e-12)
                within = [f"stats/{name}/{part}"]
                np.testing.assert_allclose(self.episodes[1][within[0]], np.quantile(values[6:], share, axis=0), atol=1e-12)
            for part in ("min", "max", "mean", "std"):
                np.testing.assert_allclose(self.stats[name][part], getattr(values, part)(axis=0), atol=1e-12)
            self.assertEqual(self.stats[name]["count"], [12])
        for key in (IMAGES + "index_distal", IMAGES + "scene"):
            film = video.read(self.root / f"videos/{key}/chunk-000/file-000.mp4").reshape(-1, 3) / 255.0
            for part, share in statistics.QUANTILES.items():
                found = np.array(self.stats[key][part])
                self.assertEqual(found.shape, (3, 1, 1))
                np.testing.assert_allclose(found.ravel(), np.quantile(film, share, axis=0), atol=1e-12)
            np.testing.assert_allclose(np.ravel(self.stats[key]["std"]), film.std(axis=0), atol=1e-12)
            self.assertEqual(np.ravel(self.stats[key]["max"]).tolist(), film.max(axis=0).tolist())

    def test_no_image_is_black(self):
        for pad in Layout.read(self.root).pads:
            film = video.read(self.root / f"videos/{IMAGES}{pad}/chunk-000/file-000.mp4")
            self.assertGreater(film.mean(axis=(1, 2, 3)).min(), 10.0, pad)

    def test_recorded_actions_lead_to_the_same_observations(self):
        actions = self.column(ACTION)[6:]
        observation, _ = self.env.reset(seed=self.episodes[1]["seed"])
        for n, action in enumerate(actions):
            for name, value in observation.items():
                np.testing.assert_array_equal(value, self.policy[6 + n][0][name], name)
            observation, *_ = self.env.step(action)

    def test_a_policy_gets_the_keys_of_the_data(self):
        seen = []

        def learnt(batch):
            seen.append(batch)
            return np.full((1, 12), 0.1)

        adapter = PolicyAdapter(learnt, self.root)
        observation, info = self.env.reset(seed=5)
        adapter.reset(info)
        np.testing.assert_allclose(adapter.act(observation), np.full(12, 0.1, dtype=np.float32))
        (batch,) = seen
        np.testing.assert_array_equal(batch[STATE][0], self.column(STATE)[0])
        np.testing.assert_array_equal(batch[ENVIRONMENT][0], self.column(ENVIRONMENT)[0])
        film = video.read(self.root / f"videos/{IMAGES}thumb_distal/chunk-000/file-000.mp4")
        np.testing.assert_array_equal(batch[IMAGES + "thumb_distal"][0], film[0].transpose(2, 0, 1) / np.float32(255.0))
        self.assertEqual(batch["task"], self.episodes[0]["tasks"])
        for answer, words in [(np.zeros(11), "expected 12 finite numbers"), (np.full(12, np.nan), "expected 12 finite numbers")]:
            adapter.policy = lambda batch, answer=answer: answer
            with self.assertRaisesRegex(ValueError, words):
                adapter.act(observation)
        adapter.policy = learnt
        with self.assertRaisesRegex(ValueError, "observation.scene_camera: found none, expected shape"):
            adapter.act({name: value for name, value in observation.items() if name != "scene_camera"})

    def test_the_words_of_a_task_are_those_of_its_data(self):
        for env, expected in [
            ("PickSecond", "pick up the {1} with the {0} in the hand"),
            ("PickTwo", "pick up the {0}, then the {1} beside it"),
            # Nobody may know the object.
            ("Sort", "hold the object over the bin of its shape"),
            ("LiftTo", "move the {0} to the goal"),
        ]:
            out, seen = Path(self.folder.name) / f"words_{env}", []
            made = gymnasium.make(f"ftac/{env}-v1", max_episode_steps=2)
            record(made, constant, 1, out, only_successes=False, seed=4, quiet=True)
            (row,) = tables.read_episodes(out / "meta/episodes/chunk-000/file-000.parquet")
            names = [name.replace("_", " ") for name in row["objects"]]
            self.assertEqual(row["tasks"], [expected.format(*names)])
            adapter = PolicyAdapter(lambda batch, seen=seen: seen.append(batch["task"]) or np.zeros(12), out)
            observation, info = made.reset(seed=4)
            adapter.reset(info)
            adapter.act(observation)
            self.assertEqual(seen, [row["tasks"]])

    def test_bad_input_is_refused_in_words_and_nothing_is_left(self):
        env = envs.Pick(images=SIDE)
        folder = Path(self.folder.name)
        fail = lambda env: lambda observation: np.full(12, 3.0)  # noqa: E731
        for arguments, error, words in [
            ((env, constant, 1, self.root), ValueError, "it is there already, expected the name of a new folder"),
            ((env, constant, 0, folder / "x"), ValueError, "episodes: found 0, expected 1 to"),
            ((object(), constant, 1, folder / "x"), ValueError, "env: found object, expected an environment of ftac.envs"),
            ((env, 3, 1, folder / "x"), ValueError, "policy: found int, expected an object with act"),
            ((env, fail, 1, folder / "x"), ValueError, "action: found"),
            ((envs.Pick(images=15), constant, 1, folder / "x"), ValueError, "images: found 15 pixels .* expected an even number"),
        ]:
            with self.assertRaisesRegex(error, words):
                record(*arguments, quiet=True)
        for arguments, words in [
            ((env, constant), "env: found Pick for several jobs, expected a function that makes an environment that can be pickled"),
            ((short, Recording(12, 2)), "policy: found Recording for several jobs, expected a function of the environment that can"),
            ((short, lambda env: None), "policy: found function for several jobs, .*lambda"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                record(*arguments, 1, folder / "x", jobs=2, quiet=True)
        beyond = Taught(np.zeros(12), np.full(12, 1.5))
        with self.assertRaisesRegex(ValueError, "written: found .*, expected 12 numbers from -1 to 1"):
            record(env, lambda env: lambda observation: beyond, 1, folder / "x", quiet=True)
        with self.assertRaisesRegex(ValueError, "video: found 'best', expected lossless or a whole number from 1 to 40"):
            record(env, constant, 1, folder / "x", video="best", quiet=True)
        never = lambda env: iter([None]).__next__ and (lambda observation: None)  # noqa: E731
        with self.assertRaises(ValueError):
            record(env, never, 1, folder / "x", only_successes=False, quiet=True)
        with self.assertRaisesRegex(RuntimeError, "attempts: found 0 successes in 1 episodes, expected 1"):
            record(env, Recording(12, 2), 1, folder / "x", attempts=1, quiet=True)
        self.assertEqual(sorted(path.name for path in folder.iterdir()), ["set"])
        (folder / "broken.json").write_text('{"layout": {"spec": {"imagse": 3}}}')
        with self.assertRaisesRegex(ValueError, "broken.json: layout.spec: found 'imagse', expected some of images"):
            Layout.read(folder / "broken.json")
        (folder / "broken.json").unlink()

    def test_processes_make_the_same_data_and_a_teacher_may_write(self):
        folder = Path(self.folder.name) / "processes"
        few = {"only_successes": False, "seed": 3, "quiet": True}
        for jobs in (1, 2):
            record(short, led, 3, folder / str(jobs), jobs=jobs, **few)
        read = {path.relative_to(folder / "1"): path.read_bytes() for path in sorted((folder / "1").rglob("*")) if path.is_file()}
        self.assertEqual({path: (folder / "2" / path).read_bytes() for path in read}, read)
        data = [folder / "1/data/chunk-000/file-000.parquet"]
        action, command = tables.read_column(data, ACTION), tables.read_column(data, STATE)
        np.testing.assert_array_equal(action, np.full((9, 12), 0.5, dtype=np.float32))
        # The robot did what the first of the two actions says.
        names = Layout.read(folder / "1").names()[STATE]
        thumb = command[:, names.index("command.thumb")].reshape(3, 3)
        self.assertTrue(np.all(np.diff(thumb, axis=1) > 0.05) and np.ptp(thumb[:, 2]) > 0.0, thumb)
        shutil.rmtree(folder)

    def test_goals_are_among_what_is_to_be_reached_for(self):
        env = envs.LiftTo(images=16)
        layout = Layout.of(env)
        observation, _ = env.reset(seed=2)
        vectors = layout.vectors(observation)
        np.testing.assert_array_equal(vectors[ENVIRONMENT][-3:], observation["desired_goal"])
        again = layout.observation(vectors, layout.images(observation))
        self.assertEqual(set(again), set(observation))
        for name, value in observation.items():
            np.testing.assert_array_equal(again[name], value, name)
        self.assertEqual({name: len(row) for name, row in vectors.items()}, {name: len(row) for name, row in layout.names().items() if name != ACTION})


@unittest.skipIf(MISSING, "LEFT OUT with the data sets")
class Files(unittest.TestCase):
    """Data sets of several files, in a small layout."""

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.out = Path(self.folder.name) / "set"
        self.layout = Layout(Spec(images=SIDE), 1, pads=("one", "two"))

    def tearDown(self):
        self.folder.cleanup()

    def episode(self, number):
        rng = np.random.default_rng(number)
        count = 3 + number
        vectors = {name: rng.uniform(-1, 1, (count, len(row))) for name, row in self.layout.names().items()}
        images = {key: rng.integers(60, 200, (count, SIDE, SIDE, 3)).astype(np.uint8) for key in self.layout.sides()}
        return Episode("pick up the ball", vectors, images, True, None, {"seed": number})

    def files(self):
        return {str(path.relative_to(self.out)): path.read_bytes() for path in sorted(self.out.rglob("*")) if path.is_file()}

    def write(self, numbers, out=None, resume=False, stop=False):
        writer = Writer(out or self.out, self.layout, made={"from": "chance"}, resume=resume)
        for number in numbers[writer.episodes :]:
            writer.add(self.episode(number))
            if number % 2:
                writer.finish_file()
        if stop:
            writer.add(self.episode(9))
            writer.abandon(keep_finished=True)
            return writer
        writer.finish("# card")
        return writer

    def test_an_interrupted_data_set_continues_to_the_same_bytes(self):
        self.write(range(4))
        whole = self.files()
        self.assertIn("data/chunk-000/file-001.parquet", whole)
        self.assertEqual(whole["README.md"], b"# card")
        self.out = self.out.with_name("again")
        self.write(range(2), stop=True)
        self.assertFalse(self.out.exists())
        self.assertEqual(self.write(range(4), resume=True).resumed, 1)
        self.assertEqual(self.files(), whole)
        self.assertEqual(sorted(path.name for path in self.out.parent.iterdir()), ["again", "set"])
        rows = pq.read_table(self.out / "meta/episodes/chunk-000/file-001.parquet").to_pylist()
        self.assertEqual((rows[0]["episode_index"], rows[0]["data/file_index"], rows[0][f"videos/{IMAGES}one/from_timestamp"]), (2, 1, 0.0))
        stats = json.loads((self.out / "meta/stats.json").read_text())
        every = np.concatenate([self.episode(n).images[IMAGES + "one"] for n in range(4)]).reshape(-1, 3) / 255.0
        np.testing.assert_allclose(np.ravel(stats[IMAGES + "one"]["q90"]), np.quantile(every, 0.9, axis=0), atol=1e-12)

    def test_only_the_same_data_set_is_continued(self):
        self.write(range(2), stop=True)
        with self.assertRaisesRegex(ValueError, "found an incomplete data set with another made, expected the same"):
            Writer(self.out, self.layout, made={"from": "elsewhere"}, resume=True)

    def test_other_shapes_are_refused_and_change_nothing(self):
        writer = Writer(self.out, self.layout)
        writer.add(self.episode(0))
        bad = self.episode(1)
        bad.images[IMAGES + "two"] = bad.images[IMAGES + "two"][:2]
        with self.assertRaisesRegex(ValueError, r"episode.observation.images.two: found \(2, 16, 16, 3\), expected shape \(4, 16, 16, 3\)"):
            writer.add(bad)
        self.assertEqual((writer.episodes, writer.frames), (1, 3))
        writer.abandon()
        self.assertEqual(list(self.out.parent.iterdir()), [])

    def test_a_lossy_video_loses_no_more_than_it_says(self):
        from ftac import optics

        press = optics.press_sphere("index_distal", radius=0.008, force=2.0, unit=3).image[::4, ::4][:60, :60]
        rng = np.random.default_rng(1)
        images = np.clip(press + rng.normal(0.0, 1.0, (20, *press.shape)), 0, 255).astype(np.uint8)
        path = self.out.with_suffix(".mp4")
        images[0] = press[0, 0]  # the first image of a video is untouched
        for quality, most in [("lossless", 0.0), (12, 2.5)]:
            film = video.Video(path, 60, quality)
            film.add(images)
            film.finish()
            error = np.abs(video.read(path).astype(int) - images)
            self.assertLessEqual(error.mean(), most, quality)
            touched = np.abs(images.astype(int) - images[0]) >= video.CONTACT
            self.assertAlmostEqual(video.measured_loss({"press": images}, quality)["error"], error[touched].mean())
        self.assertGreater(error.mean(), 0.1, "the last one is lossy")


@unittest.skipIf(MISSING, "LEFT OUT with the data sets")
class Demonstrations(unittest.TestCase):
    """The command's function, with trials of three steps in place of simulated ones."""

    def run_some(self, out, jobs, stop_at=None):
        module = importlib.import_module("ftac.lerobot.demonstrations")

        def trial(benchmark, combination, number, spec):
            if stop_at is not None and (combination, number) == stop_at:
                raise KeyboardInterrupt
            clean, layout = (combination + number) % 3 != 0, Layout(spec, 2)
            rng = np.random.default_rng(combination * 100 + number)
            vectors = {name: rng.uniform(-1, 1, (3, len(row))) for name, row in layout.names().items()}
            images = {key: rng.integers(60, 200, (3, SIDE, SIDE, 3)).astype(np.uint8) for key in layout.sides()}
            about = {"combination": combination, "trial": number, "objects": ["ball", "box"]}
            return (Episode("pick up both", vectors, images, True, None, about) if clean else None), {"clean_success": clean}

        again = {"success": True, "clean_success": False}
        with mock.patch.multiple(module, trial=trial, replay=lambda *_: again), mock.patch.object(module._native, "Benchmark", lambda seed: None):
            return module.demonstrations(20, out, images=SIDE, combinations=4, jobs=jobs, replayed=3, quiet=True)

    def test_an_interrupted_run_continues_to_the_same_data(self):
        with tempfile.TemporaryDirectory() as folder:
            whole, stopped = Path(folder) / "whole", Path(folder) / "stopped"
            told = self.run_some(whole, jobs=3)
            self.assertEqual((told["episodes"], told["clean"], told["replayed"], told["replayed_success"]), (20, 20, 3, 3))
            with self.assertRaises(KeyboardInterrupt):
                self.run_some(stopped, jobs=1, stop_at=(1, 6))
            self.assertFalse(stopped.exists())
            self.assertTrue((Path(folder) / "stopped.partial/meta/episodes/chunk-000/file-000.parquet").exists())
            self.assertFalse(list(Path(folder).glob("stopped.partial/videos/*/chunk-000/file-001.mp4")))
            self.assertEqual(self.run_some(stopped, jobs=1)["trials"], told["trials"])
            self.assertEqual(sorted(path.name for path in Path(folder).iterdir()), ["stopped", "whole"])
            files = [{str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()} for root in (whole, stopped)]
            cards = [found.pop("README.md").decode() for found in files]
            self.assertEqual(files[0], files[1])
            for card in cards:
                self.assertIn("ftac demonstrations --episodes 20 --seed 1 --images 16 --combos 4 --video lossless", card)
                self.assertIn(f"{told['trials']} trials were run, 20 clean successes are kept", card)
                self.assertIn("Of 3 episodes whose actions were repeated", card)


@unittest.skipIf(MISSING, "LEFT OUT with the data sets")
class Trials(unittest.TestCase):
    """Trials of the built-in policy as episodes, and policies on exported keys in trials."""

    def test_a_demonstration_has_what_an_acting_policy_is_told_in_its_trial(self):
        from dataclasses import replace

        from ftac import _native
        from ftac.lerobot.trials import SPEC, replay, trial

        spec = replace(SPEC, images=SIDE)
        benchmark = _native.Benchmark(1)
        number = next(n for n in range(10) if json.loads(benchmark.condition("touch", 1, n))["clean_success"])
        episode, told = trial(benchmark, 1, number, spec)
        # The images in between change nothing.
        same = json.loads(benchmark.condition("touch", 1, number))
        for name in ("sim_seconds", "reason", "success", "contact"):
            self.assertEqual(told[name], same[name], name)
        first = []

        class Looks:
            features = spec

            def act(self, observation):
                first.append(observation)
                return None

        bench.run(Looks(), combinations=[1], trials=number + 1, seed=1)
        layout = Layout(spec, 2)
        vectors = layout.vectors(first[number])
        np.testing.assert_allclose(episode.vectors[ENVIRONMENT][0], vectors[ENVIRONMENT], atol=1e-6)
        np.testing.assert_allclose(episode.vectors[STATE][0], vectors[STATE], atol=1e-6)
        np.testing.assert_array_equal(episode.images[IMAGES + "index_distal"][0], layout.images(first[number])[IMAGES + "index_distal"])
        self.assertLessEqual(np.abs(episode.vectors[ACTION]).max(), 1.0)
        # Images are dense: the controller's own are all that comes between those of the steps.
        pad = max(layout.pads, key=lambda pad: episode.images[IMAGES + pad].astype(int).std(axis=0).mean())
        moving = (np.diff(episode.images[IMAGES + pad].astype(int), axis=0) != 0).any(axis=(1, 2, 3))
        self.assertGreater(moving.mean(), 0.8)
        row = {"combination": 1, "trial": number}
        record = replay(benchmark, spec, row, episode.vectors[ACTION])
        self.assertGreater(record["sim_seconds"], 5.0)

    def test_an_adapter_plays_in_the_benchmark(self):
        calls = []

        def lowers(batch):
            calls.append(batch)
            action = np.zeros(12, dtype=np.float32)
            action[2] = -0.5
            return action

        # What was trained on one object is told of the first one of a trial.
        for layout in (Layout(Spec(images=SIDE, grasp=True), 2), Layout(Spec(grasp=True), 1)):
            calls.clear()
            (row,) = bench.run(PolicyAdapter(lowers, layout), combinations=[1], trials=1)
            self.assertTrue(not row["success"] and row["cause"] != "policy_failed", row["reason"])
            self.assertGreater(len(calls), 20)
            for key in (STATE, ENVIRONMENT):
                self.assertEqual(calls[0][key].shape, (1, len(layout.names()[key])))
            heights = [batch[STATE][0, layout.names()[STATE].index("palm.z")] for batch in calls[:20]]
            self.assertLess(heights[-1], heights[0] - 0.05)


if __name__ == "__main__":
    unittest.main()
