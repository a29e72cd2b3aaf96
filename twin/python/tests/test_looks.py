"""Objects that show themselves, and plots in one call. No notebook is needed: the methods are those that a notebook calls."""

import inspect
import pickle
import re
import struct
import subprocess
import sys
import unittest
import zlib

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

import ftac  # noqa: E402
from ftac import _images, bench, grasps, hand, optics, plot, touch  # noqa: E402
from ftac._rows import Rows  # noqa: E402


def pixels(data):
    """The pixels (h, w, 3) of a PNG file without filters, whose structure and checksums are checked."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n", data[:8]
    at, chunks = 8, []
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        (checksum,) = struct.unpack(">I", data[at + 8 + length : at + 12 + length])
        assert checksum == zlib.crc32(kind + body), kind
        chunks.append((kind, body))
        at += 12 + length
    assert [kind for kind, _ in chunks] == [b"IHDR", b"IDAT", b"IEND"], chunks
    width, height, depth, colour, *_ = struct.unpack(">IIBBBBB", chunks[0][1])
    assert (depth, colour) == (8, 2)
    rows = np.frombuffer(zlib.decompress(chunks[1][1]), dtype=np.uint8).reshape(height, 1 + 3 * width)
    assert (rows[:, 0] == 0).all()
    return rows[:, 1:].reshape(height, width, 3)


def row(policy, success, contact=False, **more):
    return {"policy": policy, "combination": 0, "success": success, "contact": contact, "clean_success": success and not contact, **more}


class Reprs(unittest.TestCase):
    def test_a_png_has_the_pixels_that_went_in(self):
        picture = np.random.default_rng(1).integers(0, 256, (7, 5, 3), dtype=np.uint8)
        np.testing.assert_array_equal(pixels(_images.png(picture)), picture)
        # Any other reader agrees.
        import io

        decoded = matplotlib.image.imread(io.BytesIO(_images.png(picture)))
        np.testing.assert_array_equal(np.rint(255 * decoded[..., :3]).astype(np.uint8), picture)
        for bad in (picture.astype(float), picture[..., 0], picture[:0]):
            with self.assertRaisesRegex(ValueError, "picture: found shape"):
                _images.png(bad)

    def test_a_press_shows_its_image_beside_its_depth(self):
        light, deep = (optics.press_sphere("index_distal", 0.008, force=force) for force in (0.5, 3.0))
        shown = pixels(light._repr_png_())
        self.assertEqual(shown.shape, (240, 484, 3))
        np.testing.assert_array_equal(shown[:, :240], light.image)
        # The scale ends at the deepest point, in yellow; untouched gel is dark blue.
        row, column = np.unravel_index(np.argmax(light.depth), light.depth.shape)
        np.testing.assert_array_equal(shown[row, 244 + column], _images.COLOURS[-1])
        np.testing.assert_array_equal(shown[0, 244], _images.COLOURS[0])
        self.assertTrue((pixels(deep._repr_png_()) != shown).any())
        self.assertRegex(repr(light), r"^<Press: image \(240, 240, 3\) uint8, depth \(240, 240\) up to \d\.\d\d mm, force 0\.50 N>$")

    def test_a_surface_shows_indentation_and_normals(self):
        press = optics.press_sphere("index_distal", 0.008, force=2.0)
        felt = touch.surface("index_distal", press.image, optics.background("index_distal"))
        shown = pixels(felt._repr_png_())
        self.assertEqual(shown.shape, (240, 484, 3))
        # A flat place points out of the surface: (0, 0, 1).
        np.testing.assert_array_equal(shown[0, 244], [128, 128, 255])
        self.assertRegex(repr(felt), r"^<Surface: indentation \(240, 240\) up to \d\.\d\d mm, normals \(240, 240, 3\)>$")

    def test_images_show_themselves_and_stay_arrays(self):
        image = optics.background("thumb_distal")
        np.testing.assert_array_equal(pixels(image._repr_png_()), image)
        self.assertEqual(repr(image), "<image (240, 240, 3) uint8>")
        copied = pickle.loads(pickle.dumps(image))
        np.testing.assert_array_equal(copied, image)
        self.assertEqual(repr(copied), repr(image))
        # What is no image any more is shown as numbers.
        brightness = image[:2, :2].mean(axis=2)
        self.assertIsNone(brightness._repr_png_())
        self.assertEqual(repr(brightness), repr(np.asarray(brightness)))
        self.assertEqual(float(image.max()), float(np.asarray(image).max()))

    def test_a_scene_shows_its_picture_and_its_pads(self):
        scene = ftac.Scene([("lemon", 0.62, 0.14, 0.0)], images=16, seed=1)
        before = pixels(scene._repr_png_())
        np.testing.assert_array_equal(before, scene.picture())
        self.assertEqual(scene.picture(64).shape, (64, 64, 3))
        self.assertEqual(repr(scene), "<Scene at 0.00 s: lemon, tactile (17, 16, 16, 3) uint8>")
        for _ in range(5):
            measured = scene.step(twist=[0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
        self.assertTrue((pixels(scene._repr_png_()) != before).any())
        self.assertEqual(repr(scene.copy()), "<Scene at 0.25 s: lemon, tactile (17, 16, 16, 3) uint8>")
        mosaic = pixels(measured["tactile"]._repr_png_())
        self.assertEqual(mosaic.shape, (4 * 112 + 3 * 4, 5 * 112 + 4 * 4, 3))
        np.testing.assert_array_equal(mosaic[116:228:7, 0:112:7], measured["tactile"][5])
        self.assertEqual(repr(measured["tactile"]), "<17 images (17, 16, 16, 3) uint8>")
        self.assertEqual(repr(ftac.Scene()), "<Scene at 0.00 s: no objects, no images>")
        with self.assertRaisesRegex(ValueError, "side: found 8, expected 16 to 2048"):
            scene.picture(8)

    def test_grasps_show_the_hand_or_a_table(self):
        one, other = grasps.collection()[0], grasps.collection()[1]
        self.assertTrue(one._repr_png_().startswith(b"\x89PNG"))
        self.assertNotEqual(one._repr_png_(), other._repr_png_())
        self.assertRegex(repr(one), rf"^<Held {one.object}: joints \(15,\), contacts \(\d+, 8\), margin \d+\.\d\d N>$")
        planned = grasps.repertoire()["lemon"][0]
        table = planned._repr_html_()
        for text in (f"lemon, pick-up {planned.id}", ", ".join(planned.digits), f"{planned.score:.2f}", f"{np.degrees(planned.yaw):.0f} deg"):
            self.assertIn(text, table)
        self.assertIn(f"<PickUp {planned.id} of lemon by ", repr(planned))

    def test_rows_of_trials_are_a_table(self):
        rows = Rows([row("mine", True, cause=None, sim_seconds=12.345), row("mine", False, contact=True, cause="<b>"), row("blind", False)])
        self.assertEqual(repr(rows), "<3 trials; mine: 2 x clean success 0.50, blind: 1 x clean success 0.00>")
        table = rows._repr_html_()
        self.assertEqual(table.count("<tr>"), 1 + len(rows))
        self.assertIn("<td>12.3</td>", table)
        self.assertIn("<td>yes</td>", table)
        self.assertTrue("<b>" not in table and "&lt;b&gt;" in table, table)
        many = Rows([row("mine", True)] * 65)._repr_html_()
        self.assertTrue(many.count("<tr>") == 61 and "5 more rows" in many)
        self.assertEqual((repr(Rows()), rows[0]["policy"], bench.rates(rows)["mine"]["trials"]), ("<no trials>", "mine", 2))


class Plots(unittest.TestCase):
    def tearDown(self):
        plt.close("all")

    def test_tactile_images_are_drawn_with_their_names(self):
        stack = np.random.default_rng(2).integers(0, 256, (17, 8, 8, 3), dtype=np.uint8)
        drawn = plot.tactile(stack)
        self.assertEqual([axes.get_title() for axes in drawn], [pad.name for pad in hand.PADS])
        for axes, image in zip(drawn, stack):
            np.testing.assert_array_equal(axes.images[0].get_array(), image)
        (left, right) = plot.tactile({"index_distal": stack[0], "thumb_distal": stack[1]})
        self.assertEqual((left.get_title(), right.get_title()), ("index_distal", "thumb_distal"))
        np.testing.assert_array_equal(right.images[0].get_array(), stack[1])
        (single,) = plot.tactile(stack[3], names=["mine"])
        np.testing.assert_array_equal(single.images[0].get_array(), stack[3])
        self.assertEqual(len(plot.tactile(stack[:3])[0].figure.axes), 3)

    def test_a_press_is_drawn_in_mm_of_its_pad(self):
        press = optics.press_sphere("index_distal", 0.008, force=1.5)
        image, depth = plot.press(press, camera="index_distal")
        np.testing.assert_array_equal(image.images[0].get_array(), press.image)
        np.testing.assert_allclose(depth.images[0].get_array(), 1e3 * press.depth)
        view = hand.CAMERAS[hand.camera("index_distal")]
        left, right, bottom, top = depth.images[0].get_extent()
        np.testing.assert_allclose([right - left, top - bottom], [1e3 * view.width, 1e3 * view.height])
        np.testing.assert_allclose(0.5 * (top + bottom), 1e3 * view.center_y)
        self.assertEqual((image.get_title(), depth.get_xlabel()), ("image, 1.50 N", "x, mm"))

    def test_heights_are_drawn_in_mm(self):
        press = optics.press_sphere("index_distal", 0.008, force=1.5)
        felt = touch.surface("index_distal", press.image, optics.background("index_distal"))
        for given, expected in [(felt, felt.indentation), (press, press.depth), (press.depth, press.depth)]:
            axes = plot.heights(given)
            np.testing.assert_allclose(axes.images[0].get_array(), 1e3 * expected)
            self.assertEqual(axes.get_xlabel(), "x, pixels")
        _, own = plt.subplots()
        self.assertIs(plot.heights(felt, axes=own), own)

    def test_trials_are_drawn_as_shares_with_intervals(self):
        rows = [row("mine", n != 0, contact=n == 1) for n in range(10)] + [row("blind", False)] * 4
        axes = plot.trials(rows)
        self.assertEqual([label.get_text() for label in axes.get_yticklabels()], ["mine (10)", "blind (4)"])
        shares = {bars.get_label(): bars.lines[0].get_xdata() for bars in axes.containers}
        expected = {"contact": [0.1, 0.0], "success": [0.9, 0.0], "clean success": [0.8, 0.0]}
        self.assertEqual(set(shares), set(expected))
        for name, values in expected.items():
            np.testing.assert_allclose(shares[name], values)
        clean = next(bars for bars in axes.containers if bars.get_label() == "clean success")
        ends = clean.lines[2][0].get_segments()
        # Wilson's interval of 8 of 10, and of 0 of 4.
        np.testing.assert_allclose(ends[0][:, 0], [0.4902, 0.9433], atol=1e-4)
        np.testing.assert_allclose(ends[1][:, 0], [0.0, 0.4899], atol=1e-4)
        # A table of trials has conditions, and text for true and false.
        table = [{"condition": "touch", "contact": "false", "success": "true", "clean_success": "true"}]
        axes = plot.trials(table)
        self.assertEqual(axes.get_yticklabels()[0].get_text(), "touch (1)")
        np.testing.assert_allclose([bars.lines[0].get_xdata()[0] for bars in axes.containers], [0.0, 1.0, 1.0])

    def test_what_cannot_be_drawn_is_refused_in_words(self):
        for call, words in [
            (lambda: plot.tactile(np.zeros((2, 8, 8, 3))), r"images: found shape \(8, 8, 3\) of float64, expected \(h, w, 3\) uint8 each"),
            (lambda: plot.tactile(np.zeros((0, 8, 8, 3), dtype=np.uint8)), "images: found none"),
            (lambda: plot.tactile(np.zeros((2, 8, 8, 3), dtype=np.uint8), names=["one"]), "names: found 1, expected 2"),
            (lambda: plot.heights(np.zeros(3)), r"surface: found shape \(3,\)"),
            (lambda: plot.heights(np.zeros((4, 4)), camera="toe"), "camera: found 'toe'"),
            (lambda: plot.trials([]), "rows: found none"),
            (lambda: plot.trials([row("mine", "perhaps")]), "success: found 'perhaps', expected true or false"),
        ]:
            with self.assertRaisesRegex(ValueError, words):
                call()

    def test_without_matplotlib_everything_else_works(self):
        hidden = "import sys; sys.modules['matplotlib'] = None\n"
        for asked, words in [
            ("import ftac; print(len(ftac.optics.background(0)._repr_png_()) > 1000)", ""),
            ("import ftac; ftac.plot", "ftac.plot needs matplotlib"),
            ("import ftac.plot", "pip install 'ftac[plot]'"),
        ]:
            done = subprocess.run([sys.executable, "-c", hidden + asked], capture_output=True, text=True)
            self.assertEqual((done.returncode, done.stdout.strip()), (1, "") if words else (0, "True"), done.stderr)
            self.assertIn(words, done.stderr)


class Help(unittest.TestCase):
    def test_functions_of_arrays_state_shapes_and_units(self):
        shape = re.compile(r"\((\d+|[a-z]+)(, (\d+|[a-z]+))*,?\)|[Tt]he 1[578] ")
        units = re.compile(r"\b(m|mm|rad|N|N m|s|uint8|unit vectors|kg)\b")
        checked = 0
        for module in (hand, optics, touch, grasps, plot):
            for name, function in vars(module).items():
                own = inspect.isfunction(function) and function.__module__ == module.__name__ and not name.startswith("_")
                if not own:
                    continue
                text = inspect.getdoc(function)
                self.assertTrue(text, f"{module.__name__}.{name} has no help")
                if re.search("Array|Press|Surface|Images|Map", str(inspect.signature(function).return_annotation)):
                    checked += 1
                    self.assertRegex(text, shape, f"{module.__name__}.{name}: no shape")
                    self.assertRegex(text, units, f"{module.__name__}.{name}: no unit")
        self.assertGreater(checked, 12)


if __name__ == "__main__":
    unittest.main()
