"""Both cameras in front of one scene at one noise level, the filter patterns that are compared, and
a method: a way from the shot of one of the two to a picture.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from os.path import isfile
from pathlib import Path

import numpy as np

from ...shared import CfaPattern, FloatArray, Mosaic
from ..io.scene import RGB, Scene, scene_channels
from ..io.versions import package_version
from ..simulation.bayer import ORDER, channel_map, sample_bayer
from ..simulation.filters import Filters, filters_for
from ..simulation.protocols import BayerShot, Protocol
from ..simulation.simulated_camera import SimulatedCamera

Demosaic = Callable[[FloatArray], FloatArray]  # samples (H, W) -> (H, W, 3)


def render_samples(demosaic: Demosaic, shot: BayerShot, white: FloatArray) -> FloatArray:
    """The picture, (H, W, 3), of the white-balanced samples of a shot, with the balance undone.

    white: what white reads, (3,).
    """
    return demosaic(shot.samples / white[channel_map(shot.samples.shape)]) * white


@dataclass(frozen=True, eq=False)
class CameraPair:
    """The sparse-colour camera and the Bayer camera; each shot is taken once, when it is first
    needed.

    Attributes
    ----------
    level : Protocol
        The noise.
    seed : int
        Of the noise, the same for every scene and method.
    truth : FloatArray
        Light of the scene, (H, W, N), scene units.
    pattern : CfaPattern
        Of the sparse-colour camera.
    neutral : tuple[float, ...] | None
        What white reads in the scene, one value per channel; None = unknown.
    window : tuple[slice, slice]
        Rows and columns of both shots that are rendered; they must begin at multiples of both
        patterns' periods.
    """

    level: Protocol
    seed: int
    truth: FloatArray
    pattern: CfaPattern
    neutral: tuple[float, ...] | None
    window: tuple[slice, slice] = (slice(None), slice(None))

    def render_sparse(self, render: Callable[[Mosaic], FloatArray]) -> FloatArray:
        """Render the sparse-colour shot.

        A picture in other channels than the scene's is unmixed by the inverse of the filters'
        matrix, or its pseudo-inverse.

        Returns float32 (H, W, N) in scene units of the scene, whatever exposure and filters were.
        """
        picture = render(self.sparse) / np.float32(self.level.light)
        mixing = np.array(filters_of(self.pattern).matrix)
        if np.array_equal(mixing, np.eye(self.truth.shape[2])):
            return picture
        return (picture @ np.linalg.pinv(mixing).T).astype(np.float32)

    @property
    def white(self) -> FloatArray:
        """Readings of white, largest channel 1; all 1 where it is unknown."""
        white = np.array(self.neutral or (1.0, 1.0, 1.0), np.float32)
        return white / white.max()

    @cached_property
    def sparse(self) -> Mosaic:
        """The shot of the sparse-colour camera; its calibration states the noise."""
        # The scene without its colours: filters are what all channels have in common.
        scene = Scene(self.truth, "", channels=channels_of(self.pattern))
        level = self.level.scaled(filters_of(self.pattern).unit)
        camera = SimulatedCamera(self.pattern, protocol=level, bits=level.bits)
        shot = camera.shoot(scene, np.random.default_rng(self.seed)).mosaic
        return Mosaic(shot.samples[self.window], shot.pattern, shot.calibration)

    @cached_property
    def bayer(self) -> BayerShot:
        """The shot of the Bayer camera, in scene units under full light."""
        shot = self.level.bayer(sample_bayer(self.truth), np.random.default_rng(self.seed))
        return shot._replace(samples=shot.samples[self.window])


@dataclass(frozen=True)
class Tile:
    """A pattern of the sparse-colour camera.

    name: for people. pattern: the pattern.
    """

    name: str
    pattern: CfaPattern

    @classmethod
    def named(cls, pattern: CfaPattern, source: str = "") -> "Tile":
        """A pattern that the user gave as letters or as a file, which lends it its name unless it
        is one of the paper's: "K=6" is one Bayer block per period of 6.

        source: what the user wrote. Raises InputError as `filters_for` does.
        """
        filters_of(pattern)
        name = Path(source).stem if isfile(source) else pattern.name or source  # noqa: PTH113 (Path.is_file refuses long names)
        tile = cls(name, pattern)
        return replace(tile, name=f"K={tile.period}") if tile.period else tile

    @property
    def period(self) -> int | None:
        """K of the paper's pattern; None for any other."""
        period = self.pattern.period
        return period if self.pattern == CfaPattern.bayer(period, ORDER) else None

    @property
    def light(self) -> float:
        """Light collected from a white scene, as a multiple of what a Bayer sensor collects."""
        return self.pattern.light_efficiency(1 / filters_of(self.pattern).unit)


def channels_of(pattern: CfaPattern) -> str:
    """The channels of the scenes for a pattern: red, green and blue if its filters are made of
    these.
    """
    channels = scene_channels(pattern.channels)
    return RGB if set(channels) <= set(RGB) else channels


@lru_cache(maxsize=256)
def filters_of(pattern: CfaPattern) -> Filters:
    """The filters of a pattern before any scene with its channels.

    Raises InputError as `filters_for` does.
    """
    channels = channels_of(pattern)
    dark = np.zeros((1, 1, len(channels)), np.float32)
    return filters_for(pattern, Scene(dark, "", channels=channels))


_ALWAYS = ("numba", "numpy", "onnxruntime", "scipy")  # packages that make or measure pictures


@dataclass(frozen=True)
class Method:
    """A way from a shot to a picture.

    Parameters
    ----------
    name
        On the command line and in the results.
    title
        For people: the camera, a comma, the method.
    function
        Makes the picture, float32 (H, W, N), scene units: from a Mosaic if the method is for the
        sparse-colour camera; from a
        `BayerShot` and the white to balance by, float32 (3,), if it is a rival.
    version
        Digest of `source`.
    ours
        Panchroma's own, for shots of the sparse-colour camera with any pattern; otherwise a rival,
        for Bayer shots.
    balanced
        The picture depends on what white reads; if not, a rival is given ones.
    packages
        Distributions that the method needs; results depend on their versions.
    source
        Somebody's own network or function, as the user gave it; "" = none. Results depend on its
        content, which `version` states.
    """

    name: str
    title: str
    function: Callable[..., FloatArray]
    version: str = ""
    ours: bool = False
    balanced: bool = False
    packages: tuple[str, ...] = ()
    source: str = ""

    @property
    def missing(self) -> str | None:
        """A package that the method needs and that is not installed."""
        missing = (package for package in self.packages if package_version(package) is None)
        return next(missing, None)

    @property
    def identity(self) -> dict[str, object]:
        """Dependencies of results besides scene, noise, pattern and Panchroma's own code, as JSON
        values.
        """
        packages = {name: package_version(name) for name in (*_ALWAYS, *self.packages)}
        return {"method": self.version or self.name, "packages": packages}

    def render(self, cameras: CameraPair) -> FloatArray:
        """Render the shot of the camera that this method is for.

        Returns float32 (H, W, N), scene units.
        """
        if self.ours:
            return cameras.render_sparse(self.function)
        white = cameras.white if self.balanced else np.ones_like(cameras.white)
        return self.function(cameras.bayer, white)
