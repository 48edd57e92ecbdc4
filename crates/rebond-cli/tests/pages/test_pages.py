"""The pages of `rebond compare` and `rebond lecture` in a real browser, and their error figures by other programs.

`make test-pages` installs what this needs (requirements.txt) and runs it; Chromium must be there.
"""

import io
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import flip_evaluator
import numpy as np
import OpenEXR
from PIL import Image
from playwright.sync_api import sync_playwright

REBOND = os.environ["REBOND"]
CHROMIUM = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])), None)
PHONE, DESKTOP = {"width": 390, "height": 844}, {"width": 1280, "height": 900}


def rebond(folder, *arguments):
    environment = os.environ | {"XDG_CACHE_HOME": str(folder / "cache")}
    done = subprocess.run([REBOND, *arguments, "--quiet", "--json"], cwd=folder, env=environment, stdout=subprocess.PIPE)
    assert done.returncode == 0, f"rebond {' '.join(arguments)}: {done.returncode}"
    return json.loads(done.stdout)


def picture(path):
    """R, G, B of an EXR file."""
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[c].pixels for c in "RGB"], -1)


class Pages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        cls.comparison = rebond(
            cls.folder, "compare", "cornell-spheres", "-i", "path", "-i", "bidirectional", "-i", "path:max_depth=3",
            "--spp", "4", "--size", "64x48", "--reference", "path", "--reference-spp", "64", "-o", "compare",
        )
        rebond(cls.folder, "lecture", "--quality", "draft", "-o", "lecture")
        playwright = sync_playwright().start()
        cls.addClassCleanup(playwright.stop)
        # Root, as CI has it, runs Chromium without its sandbox only. The pages ask nobody for anything.
        cls.browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        cls.addClassCleanup(cls.browser.close)

    def open(self, name, size=DESKTOP, colours="light", **options):
        """A page whose console must stay silent, and which must load nothing."""
        page = self.browser.new_page(viewport=size, color_scheme=colours, **options)
        self.addCleanup(page.close)
        said = []
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        file = (self.folder / name / "index.html").as_uri()
        page.on("request", lambda request: None if request.url.startswith(("data:", file)) else said.append(request.url))
        page.goto(file)
        self.addCleanup(lambda: self.assertEqual(said, []))
        return page

    def pixels(self, page, selector):
        """What a screen shows of an element: R, G, B of each pixel."""
        png = page.locator(selector).first.screenshot()
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)

    def test_all_images_load(self):
        for name in ["compare", "lecture"]:
            for size, colours in [(DESKTOP, "light"), (DESKTOP, "dark"), (PHONE, "dark")]:
                page = self.open(name, size, colours)
                images = page.evaluate("[...document.images].map(i => [i.complete, i.naturalWidth, i.alt])")
                self.assertGreater(len(images), 5)
                for complete, width, alt in images:
                    self.assertTrue(complete and width > 0 and alt, alt)
                # Nothing but what may scroll by itself is wider than the screen.
                self.assertLessEqual(page.evaluate("document.documentElement.scrollWidth"), size["width"])
                background = page.evaluate("getComputedStyle(document.body).backgroundColor")
                self.assertEqual(background == "rgb(255, 255, 255)", colours == "light")

    def test_drawings_have_words_for_who_does_not_see_them(self):
        for name in ["compare", "lecture"]:
            page = self.open(name)
            drawings = page.evaluate("[...document.querySelectorAll('svg')].map(s => s.getAttribute('aria-label'))")
            self.assertGreater(len(drawings), 1)
            self.assertTrue(all(drawings))

    def test_words_in_drawings_are_readable_in_the_dark(self):
        for name in ["compare", "lecture"]:
            page = self.open(name, colours="dark")
            script = """[...document.querySelectorAll('svg')].map(svg => {
                const fill = e => getComputedStyle(e).fill.match(/[0-9]+/g).slice(0, 3).map(Number);
                return [fill(svg.querySelector('rect')), ...[...svg.querySelectorAll('text')].map(fill)]; })"""
            for ground, *inks in page.evaluate(script):
                self.assertGreater(len(inks), 1)
                for ink in inks:
                    self.assertGreater(abs(sum(ink) - sum(ground)), 180)

    def test_formulas_are_formulas(self):
        page = self.open("lecture")
        heights = page.evaluate("[...document.querySelectorAll('math')].map(m => m.getBoundingClientRect().height)")
        self.assertGreater(len(heights), 5)
        self.assertGreater(min(heights), 10)

    def test_without_scripts_pictures_are_there(self):
        page = self.open("compare", java_script_enabled=False)
        self.assertTrue(page.locator(".view img").first.is_visible())

    def test_exposure_is_shared(self):
        page = self.open("compare")
        levels = []
        for stops in ["0", "1"]:
            page.locator("#exposure").fill(stops)
            page.wait_for_function(f"document.getElementById('stops').textContent.endsWith('{stops}')")
            script = """[...document.querySelectorAll('.pane canvas')].map(c =>
                [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data])"""
            levels.append(page.evaluate(script))
        files = ["reference.exr"] + [e["file"] for e in self.comparison["integrators"]]
        for canvas, brighter, file in zip(*levels, files, strict=True):
            linear = np.clip(picture(self.folder / "compare" / file).astype(float), 0, None)
            for shown, gain in [(canvas, 1), (brighter, 2)]:
                v = np.clip(linear * gain, 0, 1)
                srgb = np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)
                shown = np.array(shown).reshape(*linear.shape[:2], 4)[..., :3]
                # Half floats have eleven bits.
                self.assertLessEqual(np.abs(shown - 255 * srgb).max(), 0.75)

    def test_zoom_is_linked(self):
        page = self.open("compare")
        transforms = "[...document.querySelectorAll('.zoomed')].map(z => getComputedStyle(z).transform)"
        before = page.evaluate(transforms)
        frame = page.locator(".view[data-view='2'] .frame")
        box = frame.bounding_box()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"])
        page.mouse.wheel(0, -300)
        page.wait_for_function(f"JSON.stringify({transforms}) !== {json.dumps(json.dumps(before))}")
        after = page.evaluate(transforms)
        self.assertEqual(len(set(after)), 1)
        numbers = [float(n) for n in after[0].removeprefix("matrix(").removesuffix(")").split(",")]
        self.assertAlmostEqual(numbers[0], 2, places=3)
        # What was under the cursor still is.
        self.assertAlmostEqual(numbers[4], -0.25 * box["width"], delta=1)
        self.assertAlmostEqual(numbers[5], -0.5 * box["height"], delta=1)
        # Dragging moves all of them.
        page.mouse.down()
        page.mouse.move(box["x"] + 0.25 * box["width"] + 20, box["y"] + 0.5 * box["height"] - 10, steps=4)
        page.mouse.up()
        moved = page.evaluate(transforms)
        self.assertEqual(len(set(moved)), 1)
        end = [float(n) for n in moved[0].removeprefix("matrix(").removesuffix(")").split(",")]
        self.assertAlmostEqual(end[4] - numbers[4], 20, delta=1)
        self.assertAlmostEqual(end[5] - numbers[5], -10, delta=1)
        page.locator("#reset").click()
        self.assertEqual(page.evaluate(transforms), before)
        # And by keys.
        frame.focus()
        page.keyboard.press("+")
        self.assertIn("matrix(1.5", page.evaluate(transforms)[0])

    def test_swipe_shows_both(self):
        page = self.open("compare")
        page.get_by_role("button", name="swipe").click()
        frames = {}
        for at in ["0", "1000", "500"]:
            page.locator("#divider").fill(at)
            # But for the divider itself, at the lower edge.
            frames[at] = self.pixels(page, ".views .frame")[:-48]
        width = frames["0"].shape[1]
        left, right, both = frames["1000"], frames["0"], frames["500"]
        self.assertTrue((left != right).any())
        half = width // 2
        self.assertTrue((both[:, : half - 2] == left[:, : half - 2]).all())
        self.assertTrue((both[:, half + 2 :] == right[:, half + 2 :]).all())

    def test_flip_shows_one_after_the_other(self):
        page = self.open("compare")
        page.get_by_role("button", name="flip", exact=True).click()
        shots = []
        for key in ["1", "2", "3"]:
            page.keyboard.press(key)
            self.assertEqual(page.locator(".which button[aria-pressed='true']").inner_text()[0], key)
            shots.append(self.pixels(page, ".view.shown .frame"))
        self.assertTrue((shots[0] != shots[1]).any() and (shots[1] != shots[2]).any())
        page.locator(".view.shown .frame").focus()
        page.keyboard.press(" ")
        self.assertEqual(page.locator(".which button[aria-pressed='true']").inner_text()[0], "4")
        # A button that has the focus is pressed by it.
        page.locator(".which button").first.focus()
        page.keyboard.press(" ")
        self.assertEqual(page.locator(".which button[aria-pressed='true']").inner_text()[0], "1")

    def test_maps_are_shown(self):
        page = self.open("compare")
        for layer in ["relMSE", "FLIP"]:
            page.get_by_role("button", name=layer, exact=True).click()
            shown = page.locator(f".view[data-view='1'] .pane[data-layer='{layer.lower()}'] img")
            self.assertTrue(shown.is_visible())
            self.assertTrue(page.locator(f".legend.{layer.lower()}").is_visible())
            self.assertFalse(page.locator(".view[data-view='1'] .pane[data-layer='picture'] img").is_visible())

    def test_figures_are_those_of_numpy(self):
        folder = self.folder / "compare"
        r = picture(folder / "reference.exr").astype(np.float64)
        for entry in self.comparison["integrators"]:
            x = picture(folder / entry["file"]).astype(np.float64)
            of_pixel = ((x - r) ** 2 / (r**2 + 0.01)).mean(-1)
            channels = np.sort(((x - r) ** 2 / (r**2 + 0.01)).mean(-1).ravel())
            trimmed = channels[: len(channels) - int(0.001 * len(channels))].mean()
            for name, value in [
                ("mse", ((x - r) ** 2).mean()),
                ("rel_mse", of_pixel.mean()),
                ("rel_mse_trimmed", trimmed),
                ("rel_mse_times_seconds", of_pixel.mean() * entry["seconds"]),
            ]:
                self.assertLess(abs(entry[name] / value - 1), 1e-4, name)
            for c in range(3):
                self.assertAlmostEqual(entry["mean_signed_error"][c], (x - r)[..., c].mean(), delta=1e-6)
            # The slope, by NumPy's least squares.
            noise = self.comparison["reference"]["rel_mse_of_its_own"]
            points = [(p["samples_per_pixel"], p["rel_mse"]) for p in entry["curve"] if p["rel_mse"] > 4 * noise]
            if len(points) >= 3:
                slope = np.polyfit(*np.log(np.array(points)).T, 1)[0]
                self.assertAlmostEqual(entry["slope_by_samples"], slope, places=6)
            else:
                self.assertIsNone(entry["slope_by_samples"])
        noise = 0
        channels = OpenEXR.File(str(folder / "reference.exr"), separate_channels=True).channels()
        for k, c in enumerate("RGB"):
            noise += (channels[f"variance.{c}"].pixels.astype(np.float64) / (r[..., k] ** 2 + 0.01)).mean() / 3
        self.assertTrue(math.isclose(noise, self.comparison["reference"]["rel_mse_of_its_own"], rel_tol=1e-4))

    def test_flip_is_that_of_its_authors(self):
        folder = self.folder / "compare"
        r = np.maximum(picture(folder / "reference.exr"), 0)
        for entry in self.comparison["integrators"]:
            x = np.maximum(picture(folder / entry["file"]), 0)
            low = flip_evaluator.evaluate(np.clip(r, 0, 1), np.clip(x, 0, 1), "LDR", inputsRGB=False)[1]
            high = flip_evaluator.evaluate(r, x, "HDR")[1]
            self.assertAlmostEqual(entry["flip"], low, delta=1e-4)
            self.assertAlmostEqual(entry["hdr_flip"], high, delta=1e-4)


if __name__ == "__main__":
    done = unittest.main(exit=False, verbosity=2).result
    failed, skipped = len(done.failures) + len(done.errors), len(done.skipped)
    passed = done.testsRun - failed - skipped
    verdict = "ok" if done.wasSuccessful() else "FAILED"
    # As Rust's own tests have it.
    print(f"test result: {verdict}. {max(passed, 0)} passed; {failed} failed; {skipped} ignored;")
    sys.exit(not done.wasSuccessful())
