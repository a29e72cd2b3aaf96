"""The parts that can be used alone: shapes, units, and what is refused."""

import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import ftac
from ftac import grasps, hand, optics, touch


class Package(unittest.TestCase):
    def test_its_parts_are_there_as_the_pages_write_them(self):
        for name in ("ftac.lerobot.export", "ftac.scripted.Script", "ftac.bench.run", "ftac.envs.Pick", "ftac.touch.surface"):
            asked = [sys.executable, "-c", f"import ftac; assert callable({name})"]
            done = subprocess.run(asked, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)

    def test_it_says_its_version(self):
        done = subprocess.run([sys.executable, "-m", "ftac", "--version"], capture_output=True, text=True)
        self.assertEqual(done.stdout.split(), ["ftac", ftac.__version__])

    def test_without_gymnasium_it_says_what_the_environments_need(self):
        # `None` among the modules is one that cannot be imported.
        hidden = "import importlib.util, sys; sys.modules['gymnasium'] = None; importlib.util.find_spec = lambda name: None\n"
        for asked, words in [
            ("import ftac; ftac.scripted.Script", ""),
            ("import ftac; ftac.envs", "ftac.envs needs gymnasium: pip install 'ftac[gym]'"),
            ("import ftac; ftac.nothing", "module 'ftac' has no attribute 'nothing'"),
        ]:
            done = subprocess.run([sys.executable, "-c", hidden + asked], capture_output=True, text=True)
            self.assertEqual(done.returncode, 1 if words else 0, done.stderr)
            self.assertIn(words, done.stderr)

    def test_a_gymnasium_that_cannot_be_imported_costs_the_environments_only(self):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "gymnasium.py").write_text("raise AttributeError('numpy has no bool8')")
            path = {**os.environ, "PYTHONPATH": os.pathsep.join([folder, *sys.path[1:]])}
            why = "the installed one cannot be imported: AttributeError: numpy has no bool8"
            for asked, words in [
                ("import ftac; ftac.hand.JOINTS", f"no environments, because of gymnasium: {why}"),
                ("import ftac; ftac.envs", f"ImportError: ftac.envs needs gymnasium: {why}"),
            ]:
                done = subprocess.run([sys.executable, "-c", asked], env=path, capture_output=True, text=True)
                self.assertEqual(done.returncode, int("ftac.envs" in asked), done.stderr)
                self.assertIn(words, done.stderr)


class Hand(unittest.TestCase):
    def test_the_jacobian_is_the_derivative_of_the_kinematics(self):
        q, link, point, step = np.linspace(0.1, 1.2, 15), hand.JOINTS.index("index_3"), np.array([0.02, 0.01, 0.0]), 1e-6
        at = lambda q: (hand.forward(q)[link] @ [*point, 1.0])[:3]  # noqa: E731
        jacobian = hand.jacobian(q, "index_3", point)
        for joint in range(15):
            change = np.eye(15)[joint] * step
            np.testing.assert_allclose((at(q + change) - at(q - change)) / (2 * step), jacobian[:3, joint], atol=1e-8)

    def test_a_resting_hand_has_no_torque_but_at_its_limits(self):
        tensions = np.full(5, 3.0)
        q = hand.resting_posture(tensions)
        torques = hand.torques(q, tensions)
        inside = (q > hand.LIMITS[:, 0] + 1e-6) & (q < hand.LIMITS[:, 1] - 1e-6)
        self.assertTrue(inside.sum() >= 10)
        np.testing.assert_allclose(torques[inside], 0.0, atol=1e-6)

    def test_tension_on_moment_arms_is_torque(self):
        q = np.full(15, 0.5)
        tensions = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
        expected = hand.moment_arms(q).T @ tensions - hand.SPRINGS * q
        np.testing.assert_allclose(hand.torques(q, tensions), expected, atol=1e-12)

    def test_bad_input_is_refused_in_words(self):
        for call, words in [
            (lambda: hand.forward([0.0] * 14), r"q: found shape \(14,\), expected shape \(15,\)"),
            (lambda: hand.forward([np.nan] * 15), r"q\[0\]: found NaN"),
            (lambda: hand.forward("no"), "q: found 'no', expected numbers"),
            (lambda: hand.forward([1j] * 15), "q: found complex numbers"),
            (lambda: hand.jacobian([0.0] * 15, "toe_1"), "link: found 'toe_1'"),
            (lambda: hand.jacobian([0.0] * 15, 15), "link: found 15, expected 0 to 14"),
            (lambda: hand.resting_posture([-1.0, 0, 0, 0, 0]), r"tensions\[0\]: found -1"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                call()


class Optics(unittest.TestCase):
    def test_depth_and_force_are_two_words_for_one_press(self):
        deep = optics.press_sphere("index_distal", 0.01, depth=0.001)
        pressed = optics.press_sphere("index_distal", 0.01, force=deep.force)
        np.testing.assert_allclose(pressed.depth, deep.depth, atol=1e-6)
        self.assertEqual((deep.image.shape, deep.image.dtype, deep.depth.dtype), ((240, 240, 3), np.uint8, np.float32))

    def test_a_surface_of_heights_is_the_sphere_that_it_describes(self):
        camera = hand.CAMERAS[hand.camera("index_distal")]
        at = (np.arange(240) + 0.5) / 240 - 0.5
        x, y = at[None, :] * camera.width, -at[:, None] * camera.height
        with np.errstate(invalid="ignore"):
            heights = 0.01 - np.sqrt(0.01**2 - x**2 - y**2)
        pressed = optics.press_heights("index_distal", heights, 2.0)
        sphere = optics.press_sphere("index_distal", 0.01, force=2.0)
        np.testing.assert_allclose(pressed.depth, sphere.depth, atol=1e-6)

    def test_noise_repeats_by_seed_and_units_differ(self):
        image = lambda **how: optics.press_sphere("thumb_distal", 0.008, force=1.0, **how).image  # noqa: E731
        self.assertTrue((image(seed=1) == image(seed=1)).all())
        self.assertTrue((image(seed=1) != image(seed=2)).any())
        self.assertTrue((image(unit=1) != image(unit=2)).any())

    def test_bad_input_is_refused_in_words(self):
        for call, words in [
            (lambda: optics.background("toe"), "camera: found 'toe'"),
            (lambda: optics.background(1.5), "camera: found 1.5, expected a whole number"),
            (lambda: optics.background(0, unit=-1), "unit: found -1"),
            (lambda: optics.press_sphere(18, 0.01, force=1.0), "camera: found 18, expected 0 to 17"),
            (lambda: optics.press_sphere(0, -0.01, force=1.0), "radius: found -0.01"),
            (lambda: optics.press_sphere(0, 0.01), "expected either a depth or a force"),
            (lambda: optics.press_sphere(0, 0.01, force=-1.0), "force"),
            (lambda: optics.press_sphere(0, 0.01, depth=np.nan), "depth: found nan"),
            (lambda: optics.press_sphere(0, 10.0, depth=1.0), "depth: found 1 m, expected at most 0.0025 m"),
            (lambda: optics.press_sphere(0, 0.01, force=1000.0), "force: found 1000 N, expected at most what the gel bears under this object, [0-9.]+ N"),
            (lambda: optics.press_sphere(0, 0.01, force=1.0, center=(0.0,)), r"center: found shape \(1,\)"),
            (lambda: optics.press_heights(0, np.zeros((3, 3)), 1.0), "surface: found shape"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                call()


class Touch(unittest.TestCase):
    def test_an_image_gives_back_what_pressed_and_a_background_is_flat(self):
        press = optics.press_sphere("middle_distal", 0.01, force=2.0, unit=7)
        untouched = optics.background("middle_distal", unit=7)
        felt = touch.surface("middle_distal", press.image, untouched)
        self.assertLess(abs(felt.indentation.max() - press.depth.max()), 2e-4)
        np.testing.assert_allclose(np.linalg.norm(felt.normals, axis=2), 1.0, atol=1e-6)
        flat = touch.surface("middle_distal", untouched, untouched)
        self.assertEqual(flat.indentation.max(), 0.0)
        self.assertEqual(flat.points("middle_distal").shape, (240 * 240, 3))

    def test_pictures_of_another_kind_are_refused(self):
        good = optics.background(0)
        for bad, words in [
            (good.astype(np.float32), "image: found dtype float32, expected uint8"),
            (good[:100], r"image: found shape \[100, 240, 3\]"),
            (good[:, :, 0], "image: found shape"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                touch.surface(0, bad, good)


class Meshes(unittest.TestCase):
    def test_a_ball_of_triangles_presses_as_a_ball_does(self):
        radius, force = 0.010, 2.0
        ring, height = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 73), np.linspace(0.0, np.pi, 145), indexing="ij")
        flat = np.sin(height)
        ball = radius * np.stack([flat * np.cos(ring), flat * np.sin(ring), 1.0 - np.cos(height)], axis=2)
        at = np.arange(73 * 145).reshape(73, 145)
        one, two, three, four = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
        faces = np.concatenate([np.stack(f, axis=2).reshape(-1, 3) for f in [(one, two, three), (one, three, four)]])
        mesh = optics.press_mesh("index_distal", ball.reshape(-1, 3), faces, force)
        same = optics.press_sphere("index_distal", radius, force=force)
        self.assertAlmostEqual(mesh.force, same.force, delta=0.02)
        np.testing.assert_allclose(mesh.depth, same.depth, atol=2e-5)

    def test_what_is_no_mesh_is_refused(self):
        square = [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0]]
        for vertices, faces, words in [
            ([[0.0, 0.0]], [[0, 0, 0]], r"vertices: found shape \(1, 2\)"),
            (square, [[0, 1, 3]], "triangles: found 0 to 3, expected 0 to 2"),
            (square, [[0.0, 1.0, 2.0]], "triangles: found shape"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                optics.press_mesh(0, vertices, faces, 1.0)


class Grasps(unittest.TestCase):
    def test_grasps_are_generated_and_what_cannot_be_is_refused_in_words(self):
        found = grasps.generate("egg", chains=1)
        self.assertLessEqual(len(found), 1)
        self.assertTrue(all(grasp.object == "egg" and grasp.joints.shape == (15,) for grasp in found))
        for asked, words in [
            ({}, "either an object or a mesh"),
            ({"object": "eg"}, "eg"),
            ({"mesh": "nowhere.obj"}, "nowhere.obj"),
            ({"object": "egg", "mass": -1.0}, "--mass: found -1"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                grasps.generate(**asked)
        with self.assertRaisesRegex(ValueError, "nowhere"):
            optics.calibrate("nowhere", ball_diameter_mm=5.0, pixel_mm=0.02)

    def test_what_comes_with_the_program_is_there(self):
        repertoire, collection = grasps.repertoire(), grasps.collection()
        self.assertTrue({first for first, _ in ftac.combinations()} <= set(repertoire))
        self.assertEqual(len(collection), 3450)
        self.assertEqual(collection[0].joints.shape, (15,))
        forces = collection[0].contacts[:, 7]
        self.assertTrue((forces > 0).all())


if __name__ == "__main__":
    unittest.main()
