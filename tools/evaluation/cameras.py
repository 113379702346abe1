"""Both cameras in front of one scene at one noise level: their shots, and the pictures that methods make of them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from shared import Mosaic
from shared.arrays import FloatArray

from .protocol import BayerShot, Protocol
from .rivals.bayer import channel_map

Demosaic = Callable[..., FloatArray]  # (samples (H, W), order=) -> (H, W, 3)
Denoise = Callable[[FloatArray, float, float], FloatArray]  # (samples, shot, read) -> samples


@dataclass(frozen=True, eq=False)
class CameraPair:
    """The sparse-colour camera and the Bayer camera; each shot is taken once, when it is first needed.

    protocol, level: the noise.
    truth: light of the scene, (H, W, 3), scene units.
    period: of the sparse-colour pattern.
    neutral: what white reads in the scene, one value per channel; None = unknown.
    part: rows and columns of both shots that are rendered; they must begin at multiples of both patterns' periods.
    """

    protocol: Protocol
    level: float
    truth: FloatArray
    period: int
    neutral: tuple[float, ...] | None
    part: tuple[slice, slice] = (slice(None), slice(None))
    _denoised: dict[Denoise, FloatArray] = field(default_factory=dict, init=False)

    def render_sparse(self, render: Callable[[Mosaic], FloatArray]) -> FloatArray:
        """Render the sparse-colour shot. Returns float32 (H, W, 3) in scene units of the scene, whatever the exposure was."""
        picture, gain = render(self._sparse), self.protocol.gain(self.level)
        return picture / np.float32(gain) if gain != 1 else picture

    def render_bayer(self, demosaic: Demosaic, *, balanced: bool = False, denoise: Denoise | None = None) -> FloatArray:
        """Render the Bayer shot. Returns float32 (H, W, 3), scene units.

        demosaic: the method.
        balanced: give it white-balanced samples, as raw developers do, and undo the balance afterwards.
        denoise: applied to the samples first; kept for the next method that uses it.
        """
        samples, order = self._bayer.samples, self._bayer.order
        if denoise is not None:
            if denoise not in self._denoised:
                self._denoised[denoise] = denoise(samples, self._bayer.shot, self._bayer.read)
            samples = self._denoised[denoise]
        if not balanced or self.neutral is None:
            return demosaic(samples, order=order)
        white = np.array(self.neutral, np.float32)
        white /= white.max()
        return demosaic(samples / white[channel_map(samples.shape, order)], order=order) * white

    @cached_property
    def _sparse(self) -> Mosaic:
        shot = self.protocol.sparse_shot(self.truth, self.level, self.period)
        return Mosaic(shot.samples[self.part], shot.pattern, shot.calibration)

    @cached_property
    def _bayer(self) -> BayerShot:
        shot = self.protocol.bayer_shot(self.truth, self.level)
        return replace(shot, samples=shot.samples[self.part])
