"""Eight narrow bands: sparse blocks of them, against three channels and a guess, and against a mosaic of bands without sparse W."""

import string
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, partial
from itertools import product

import numpy as np

from offline import PRESETS
from shared import CfaPattern, Mosaic
from shared.arrays import BoolArray, DoubleArray, FloatArray
from tools.camera.filters import filters_for
from tools.camera.protocols import Protocol
from tools.camera.simulated_camera import SimulatedCamera
from tools.evaluation.methods import render_preset
from tools.evaluation.metrics import BORDER, quality
from tools.evaluation.rivals.planes import denoised_planes, planes
from tools.scenes.scene import Scene

MEASURES = "luminance", "median RGB", "chrominance", "RMS of bands", "mean angle", "angle where RGB errs"
BLOCKS = "HIJ/KWL/NOP", "HIJK/LNOP"
PERIODS = 6, 8, 10
MOSAIC = "HIJ/KWL/NOP"  # the tile of the traditional mosaic
_ERRS = 10.0  # degrees from the truth, of what is guessed from perfect red, green and blue


def bands(scene: Scene, level: Protocol) -> Iterator[tuple[str, list[float]]]:
    """Name and MEASURES of each way to the bands: of the picture in red, green and blue (PSNR, dB), and of the spectra."""
    truth, unlearned = Truth(scene), partial(render_preset, PRESETS["unlearned"])
    guessed = truth.filters @ truth.guess  # bands that three filters show
    yield "perfect R, G, B; bands guessed", truth.measured(scene.rgb @ guessed)
    for period in (4, 6):
        picture = rendered("RG/GB", period, scene, level, unlearned)
        yield f"sparse `RG/GB`, K = {period}; bands guessed", truth.measured(picture @ guessed)
    for block, period in product(BLOCKS, PERIODS):
        picture = rendered(block, period, scene, level, unlearned)
        yield f"sparse `{block}`, K = {period}", truth.measured(picture)
    yield f"mosaic `{MOSAIC}`, planes interpolated", truth.measured(rendered(MOSAIC, 3, scene, level, planes))
    if not level.clear:
        yield f"mosaic `{MOSAIC}`, BM3D, planes interpolated", truth.measured(rendered(MOSAIC, 3, scene, level, denoised_planes))


def rendered(block: str, period: int, scene: Scene, level: Protocol, method: Callable[[Mosaic], FloatArray]) -> FloatArray:
    """A shot as rendered by a method, in the scene's bands by the pseudo-inverse of the filters, as bright as the scene.

    block: rows separated by "/"; there is one in every `period` pixels.
    """
    letters = "".join(sorted(set(block) - set("/W"), key=("RGB" + string.ascii_uppercase).index))
    pattern = CfaPattern.with_block(tuple(block.split("/")), period, channels=letters)
    filters = filters_for(pattern, scene)
    camera = SimulatedCamera.of(pattern, protocol=level.scaled(filters.unit), bits=level.bits)
    shot = camera.shoot(replace(scene, camera_to_xyz=None, neutral=None), np.random.default_rng(0)).mosaic
    return method(shot) / np.float32(level.light) @ np.linalg.pinv(np.array(filters.matrix)).T.astype(np.float32)


class Truth:
    """A scene of eight bands, and what can be known of it from red, green and blue alone."""

    def __init__(self, scene: Scene) -> None:
        self.bands = scene.rgb
        self.filters = np.array(filters_for(CfaPattern.bayer(6), scene).matrix, np.float32).T

    @cached_property
    def rgb(self) -> FloatArray:
        """What red, green and blue filters read, (H, W, 3)."""
        return self.bands @ self.filters

    @cached_property
    def guess(self) -> FloatArray:
        """Matrix (3, 8) from R, G, B to bands: least squares over this very scene, the best case for three channels."""
        return np.linalg.lstsq(self.rgb.reshape(-1, 3), self.bands.reshape(-1, 8))[0]

    @cached_property
    def _mistaken(self) -> BoolArray:
        """Pixels whose spectrum three channels do not tell from others that are more frequent."""
        return self._angles(self.rgb @ self.guess) > _ERRS

    def measured(self, picture: FloatArray) -> list[float]:
        """The MEASURES of a picture of the bands, (H, W, 8)."""
        found = quality(picture @ self.filters, self.rgb)
        angles = self._angles(picture)
        error = (picture - self.bands)[BORDER:-BORDER, BORDER:-BORDER]
        rms = float(np.sqrt(np.mean(error.astype(np.float64) ** 2)))
        medians = found.luminance[2], found.rgb[2], found.chrominance[2]
        return [*medians, rms, float(angles.mean()), float(angles[self._mistaken].mean())]

    def _angles(self, picture: FloatArray) -> DoubleArray:
        """Angles between spectra, degrees: how different they are whatever their brightness."""
        one, two = (each[BORDER:-BORDER, BORDER:-BORDER].astype(np.float64) for each in (picture, self.bands))
        cosine = (one * two).sum(axis=2) / np.maximum(np.linalg.norm(one, axis=2) * np.linalg.norm(two, axis=2), 1e-12)
        return np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))
