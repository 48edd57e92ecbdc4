"""Tests of the comparison itself: python3 test_mitsuba.py"""

import tempfile
import unittest
from pathlib import Path

import mitsuba as mi
import numpy as np

import scene as s
from welch import Estimate, compare, test_blocks

mi.set_variant("scalar_rgb")


def pictures(factor, rng, runs=16, shape=(128, 128, 3), per_run=64):
    """Means of skewed samples (gamma, as light is) whose scale varies over the picture."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    scale = (0.2 + x / shape[1] + 0.5 * (y > shape[0] / 2))[..., None] * np.array([1.0, 0.7, 0.4])
    return rng.gamma(0.7 * per_run, 1 / 0.7 / per_run, (runs, *shape)) * scale * factor


class Welch(unittest.TestCase):
    def test_equal_expectations_agree(self):
        words = []
        for seed in range(20):
            rng = np.random.default_rng(seed)
            a, b = (Estimate.of_runs(pictures(1, rng)) for _ in range(2))
            words.append(compare(a, b).word())
        self.assertEqual(words, ["AGREE"] * 20)

    def test_p_values_are_uniform(self):
        rng = np.random.default_rng(5)
        p = test_blocks(*(Estimate.of_runs(pictures(1, rng, shape=(512, 512, 3))) for _ in range(2)))[1]
        counts = np.histogram(p, bins=20, range=(0, 1))[0]
        expected = p.size / 20
        self.assertLess(((counts - expected) ** 2 / expected).sum(), 43.8)  # chi-squared, 19 degrees, 0.1 %

    def test_one_percent_is_found(self):
        rng = np.random.default_rng(1)
        a, b = Estimate.of_runs(pictures(1.01, rng)), Estimate.of_runs(pictures(1, rng))
        self.assertEqual(compare(a, b).word(), "DISAGREE")

    def test_one_bad_block_is_found(self):
        rng = np.random.default_rng(2)
        a, b = pictures(1, rng), pictures(1, rng)
        a[:, 40:48, 64:72] *= 1.1
        verdict = compare(Estimate.of_runs(a), Estimate.of_runs(b))
        self.assertFalse(verdict.agree)

    def test_too_few_samples_do_not_decide(self):
        rng = np.random.default_rng(3)
        a, b = (Estimate.of_runs(pictures(1, rng, shape=(16, 16, 3), per_run=4)) for _ in range(2))
        verdict = compare(a, b)
        self.assertEqual((verdict.agree, verdict.resolved, verdict.exit_code()), (True, False, 3))

    def test_pixels_without_noise(self):
        still = np.full((16, 16, 3), 18.387)
        a, b = Estimate(still, 0 * still, 63), Estimate(still * (1 + 1e-7), 0 * still, 15)
        self.assertEqual(compare(a, b).word(), "AGREE")
        self.assertEqual(compare(a, Estimate(still * 1.0001, 0 * still, 15)).word(), "DISAGREE")


class Scenes(unittest.TestCase):
    def test_every_built_in_scene_loads(self):
        for path in sorted(s.SCENES.glob("*.toml")):
            with self.subTest(path.stem):
                scene, _ = s.comparable(s.read(path.stem))
                self.assertGreater(len(s.load(scene).shapes()), 0)

    def test_toml_survives(self):
        import tomllib

        for path in s.SCENES.glob("*.toml"):
            scene = s.read(path.stem)
            self.assertEqual(tomllib.loads(s.dump(scene)), scene)

    def test_transforms(self):
        steps = [{"scale": 2}, {"rotate": {"axis": [0, 0, 1], "angle": 90}}, {"translate": [1, 0, 0]}]
        np.testing.assert_allclose(s.matrix(steps) @ [1, 0, 0, 1], [1, 2, 0, 1], atol=1e-12)
        look = {"origin": [1, 2, 3], "target": [4, 1, 7], "up": [0, 1, 0]}
        theirs = mi.ScalarTransform4f().look_at(**look).matrix
        np.testing.assert_allclose(s.matrix({"look_at": look}), np.array(theirs), atol=1e-6)

    def test_environments_are_the_same_function(self):
        rng = np.random.default_rng(4)
        texels = rng.random((5, 8, 3)).astype(np.float32)
        axes = s.matrix([{"rotate": {"axis": [1, 2, 3], "angle": 40}}, {"scale": [-1, 1, 1]}])
        translation = s._Translation({}, Path(tempfile.gettempdir()))
        emitter = mi.load_dict(translation.envmap(texels, axes))
        h, w = texels.shape[:2]
        for _ in range(300):
            d = rng.normal(size=3)
            d /= np.linalg.norm(d)
            # As the scene format defines it: centre towards local -z, top towards +y, u growing towards +x.
            x, y, z = axes[:3, :3].T @ d
            u, v = 0.5 + np.arctan2(x, -z) / (2 * np.pi), np.arccos(y) / np.pi
            px, py = u * w - 0.5, np.clip(v * h - 0.5, 0, h - 1)
            x0, y0 = int(np.floor(px)), int(np.floor(py))
            row = lambda j: (1 - px + x0) * texels[j, x0 % w] + (px - x0) * texels[j, (x0 + 1) % w]
            expected = (1 - py + y0) * row(y0) + (py - y0) * row(min(y0 + 1, h - 1))
            si = mi.SurfaceInteraction3f()
            si.wi = -mi.Vector3f(d)
            np.testing.assert_allclose(np.array(emitter.eval(si)), expected, atol=1e-5)

    def test_textures_stand_upright(self):
        # 2x2: black but for the upper left texel, the one at (u, v) = (1/4, 3/4).
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "corner.exr")
            texels = np.zeros((2, 2, 3), np.float32)
            texels[0, 0] = 1
            mi.Bitmap(texels).write(str(path))
            translation = s._Translation({}, Path(folder))
            for wrap in ("repeat", "clamp"):
                for u_repeat, v_repeat in ((1, 1), (3, 2)):
                    image = {"image": str(path), "filter": "nearest", "wrap": wrap, "repeat": [u_repeat, v_repeat]}
                    texture = mi.load_dict(translation.texture(image))
                    look = lambda u, v: texture.eval(self.at(u / u_repeat, v / v_repeat))[0]
                    self.assertEqual([look(0.25, 0.75), look(0.75, 0.75), look(0.25, 0.25), look(0.75, 0.25)], [1, 0, 0, 0])

    def at(self, u, v):
        si = mi.SurfaceInteraction3f()
        si.uv = mi.Point2f(u, v)
        return si


if __name__ == "__main__":
    unittest.main()
