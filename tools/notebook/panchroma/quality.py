"""Quality of a picture against the truth."""

from __future__ import annotations  # help() then shows them as they are written here

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .pictures import Picture
from .shared.arrays import unmasked
from .shared.errors import InputError
from .shots import Shot
from .tools.evaluation.metrics import Measures
from .tools.io.display import checked_picture


@dataclass(frozen=True, repr=False, match_args=False)
class Comparison:
    """Figures of a picture.

    Attributes
    ----------
    rgb, luminance, chrominance : tuple[float, float, float, float]
        PSNR in dB of all 10 x 10 patches, but for a border of 15 pixels: (10 % quantile, 25 %,
        median, 75 %). Luminance is the mean of the channels, chrominance what remains of each.
    psnr : tuple[float, float, float]
        Of the whole picture: (rgb, luminance, chrominance), dB.
    wrong_hue : float | None
        Share of pixels whose colour is visibly wrong (CIEDE2000 above 10), 0 to 1; None without
        red, green and blue.

    Examples
    --------
    >>> import numpy as np
    >>> import panchroma
    >>> grey = np.full((60, 60, 3), 0.5, np.float32)
    >>> figures = panchroma.compare(grey + 0.01, grey)
    >>> figures
    <Comparison: median PSNR 40.0 dB, luminance 40.0, chrominance 200.0; wrong hue 0.0 %>
    >>> round(figures.median[0], 2)  # dB: the figure to quote
    40.0
    """

    rgb: tuple[float, float, float, float]
    luminance: tuple[float, float, float, float]
    chrominance: tuple[float, float, float, float]
    psnr: tuple[float, float, float]
    wrong_hue: float | None

    @property
    def median(self) -> tuple[float, float, float]:
        """PSNR of the median patch, dB: (rgb, luminance, chrominance)."""
        return self.rgb[2], self.luminance[2], self.chrominance[2]

    def __repr__(self) -> str:
        hue = "" if self.wrong_hue is None else f"; wrong hue {100 * self.wrong_hue:.1f} %"
        rgb, luminance, chrominance = self.median
        medians = f"{rgb:.1f} dB, luminance {luminance:.1f}, chrominance {chrominance:.1f}"
        return f"<Comparison: median PSNR {medians}{hue}>"


def compare(
    picture: Picture | NDArray[np.floating],
    truth: Shot | Picture | NDArray[np.floating] | None,
    *,
    white: float | None = None,
) -> Comparison:
    """Compare a picture with the truth, as section 4 of the paper does: PSNR over small patches, in
    luminance and chrominance too.

    Parameters
    ----------
    picture : Picture | NDArray[np.floating]
        A `Picture` of `render`, or an array (H, W, C) of linear light: what another program made of
        the same scene.
    truth : Shot | Picture | NDArray[np.floating] | None
        `shot.truth`, or an array alike; a shot stands for its truth.
    white : float | None, optional
        What the scene's white reads in both, the peak of every figure, so that figures fall with
        the light: 1/4 after `simulate(..., light=1/4)`. By default that of the truth, or of the
        picture if the truth is an array; for two arrays 1.0.

    Raises
    ------
    PanchromaError
        Where their sizes differ, or are below 40 x 40 pixels.

    Examples
    --------
    >>> import panchroma
    >>> shot = panchroma.simulate("builtin:120x90", sigma=0.01)
    >>> paper, best = (panchroma.compare(panchroma.render(shot, preset=name), shot.truth) for name
    ...     in ("paper", "best"))
    >>> best.median > paper.median
    True
    """
    truth = truth.truth if isinstance(truth, Shot) else truth
    if truth is None:
        raise InputError("`truth` is None: only a simulated shot knows what it saw")
    rgb, true_rgb = unmasked(picture), unmasked(truth)
    count = true_rgb.shape[-1] if true_rgb.ndim == 3 else len("RGB")
    source = next((image for image in (truth, picture) if isinstance(image, Picture)), None)
    if white is None:
        white = source.white if source else 1.0
    if not 0 < white < np.inf:
        meaning = "what the white of the scene reads in both pictures"
        raise InputError(f"`white` is {white}, expected a positive number: {meaning}")
    rgb, true_rgb = checked_picture(rgb, count), checked_picture(true_rgb, count)
    if rgb.shape == true_rgb.shape and white != 1:
        rgb, true_rgb = rgb / np.float32(white), true_rgb / np.float32(white)
    plain = "RGB" if count == len("RGB") else ""
    measures = Measures.of(rgb, true_rgb, source.channels if source else plain)
    rgb_patches, luminance, chrominance = map(tuple, measures.quality.tolist())
    psnr, hue = tuple(measures.psnr.tolist()), measures.wrong_hue.item()
    return Comparison(rgb_patches, luminance, chrominance, psnr, None if np.isnan(hue) else hue)
