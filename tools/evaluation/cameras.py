"""Both cameras in front of one scene at one noise level: their shots, and the pictures that methods
make of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...shared import CfaPattern, Mosaic
from ...shared.arrays import FloatArray
from ..io.scene import Scene
from ..simulation.bayer import channel_map, sample_bayer
from ..simulation.protocols import BayerShot, Protocol
from ..simulation.simulated_camera import SimulatedCamera
from .compared_tiles import channels_of, filters_of

Demosaic = Callable[[FloatArray], FloatArray]  # samples (H, W) -> (H, W, 3)


def with_balance(demosaic: Demosaic, samples: FloatArray, white: FloatArray) -> FloatArray:
    """The picture, (H, W, 3), of white-balanced samples, with the balance undone.

    white: what white reads, (3,).
    """
    return demosaic(samples / white[channel_map(samples.shape)]) * white


def render_samples(demosaic: Demosaic, shot: BayerShot, white: FloatArray) -> FloatArray:
    """Render the samples of a Bayer shot; arguments and result as in `with_balance`."""
    return with_balance(demosaic, shot.samples, white)


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
        picture, gain = render(self.sparse), self.level.light
        picture = picture / np.float32(gain) if gain != 1 else picture
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
        camera = SimulatedCamera.of(self.pattern, protocol=level, bits=level.bits)
        shot = camera.shoot(scene, np.random.default_rng(self.seed)).mosaic
        return Mosaic(shot.samples[self.window], shot.pattern, shot.calibration)

    @cached_property
    def bayer(self) -> BayerShot:
        """The shot of the Bayer camera, in scene units under full light."""
        shot = self.level.bayer(sample_bayer(self.truth), np.random.default_rng(self.seed))
        return shot._replace(samples=shot.samples[self.window])
