"""Clipped samples of a scene: white, as bright as the channels that are not clipped say.

Each channel of a camera clips at a code, and white reads less in some of them. Taken for light, a
burnt-out lamp would be magenta before any camera that gets less light of the scene. So a clipped
sample is raised to what white reads there (`raised_to_white`, as in the render), and a pixel where
every channel is clipped is white.

The four samples of a quad lie side by side. At the rim of a highlight some of them are clipped and
others are not, which gives rings of every colour. So a pixel beside a place where all channels are
clipped loses its colour too, and keeps its light.
"""

import numpy as np
from numpy.typing import NDArray

from ...shared.arrays import FloatArray
from ...shared.white_balance import clipped_share, raised_to_white

SHOULDER = 0.02
"""Fraction of the range below the limit in which a sample gradually counts as clipped: noise, and
limits that differ a little.
"""

_CLIPPED = 0.999  # share from which a sample is at the limit, but for rounding
# pixels: window in which each channel is clipped somewhere, and by which the loss of colour fades
# out, twice
_FADING_WINDOW = 3
_CODES = 1 << 16
# of the range up to the white level: no maker states one that is further above saturation
_HIGH = 0.85
# Fraction of the white level over which noise of the electronics spreads samples at the limit: how
# many times as many they are as those below, in this range of codes. The noise of light, and
# shading, spread an even surface further: more than one of so many of its samples is beyond.
_SPIKE, _NEAR, _BEYOND = 12, 0.01, 16
_SPREADS = {0.0: 20, 0.001: 10, 0.008: 8}


def saturation(codes: NDArray[np.uint16], white: float, black: float = 0.0) -> float:
    """The code at which samples of one colour are clipped: the white level, or a lower one near
    which so many samples lie that it must be the limit.

    Makers, and tables of cameras, state white levels that some sensors never reach, and cameras
    that multiply a colour clip it at a code of its own.
    """
    if white >= _CODES:
        return white
    counts = np.bincount(codes.ravel(), minlength=_CODES)
    lowest = max(int(_HIGH * white + (1 - _HIGH) * black), 0)
    total = np.concatenate([[0], counts.cumsum()])
    for spread, times in _SPREADS.items():
        width = 1 + round(spread * white)
        sums = total[width:] - total[:-width]
        code = lowest + int(sums[lowest:].argmax())
        near = round((1 - _NEAR) * code)
        before = counts[near:code].sum() * width / max(code - near, 1)
        above = total[-1] - total[code + width]
        if sums[code] >= max(_SPIKE, times * before, _BEYOND * above):
            return min(float(code), white)
    return white


def with_white_highlights(
    rgb: FloatArray, neutral: tuple[float, ...] | None, gone: FloatArray | None = None
) -> tuple[FloatArray, tuple[str, ...]]:
    """A scene whose clipped samples are white; and a note if there are any.

    Parameters
    ----------
    rgb : FloatArray
        (H, W, C), scene units.
    neutral : tuple[float, ...] | None
        What white reads; None = unknown, clipped samples stay.
    gone : FloatArray | None, optional
        (H, W, C), how far each sample counts as clipped, 0 to 1; None = by its own reading, 1.0 is
        the limit of every channel.

    Examples
    --------
    >>> import numpy as np
    >>> lamp = np.full((13, 13, 3), 0.25, np.float32)
    >>> lamp[5:8, 5:8] = 1
    >>> white, notes = with_white_highlights(lamp, (0.5, 1.0, 0.8))
    >>> white[6, 6].round(3).tolist(), white[0, 0].tolist(), len(notes)
    ([1.0, 2.0, 1.600...], [0.25, 0.25, 0.25], 1)
    """
    if gone is None:
        gone = clipped_share(rgb, 1.0, SHOULDER)
    clipped = (gone > _CLIPPED).any(axis=2)
    if neutral is None or not clipped.any():
        return rgb, ()
    counted = f"{100 * float(clipped.mean()):.2g} % of the pixels are clipped in the file"
    from scipy.ndimage import maximum_filter, uniform_filter

    white, result = np.array(neutral, np.float32), rgb.copy()
    some = (gone > 0).any(axis=2)
    result[some] = raised_to_white(rgb[some], gone[some], rgb[some], neutral)
    window = (_FADING_WINDOW, _FADING_WINDOW, 1)
    burnt_out = maximum_filter(gone, window, mode="nearest").prod(axis=2)
    around = maximum_filter(burnt_out, _FADING_WINDOW, mode="nearest")
    fading = uniform_filter(around, _FADING_WINDOW, mode="nearest")
    rim = fading > 0
    weight = np.maximum(fading, burnt_out)[rim][:, None].clip(0, 1)
    luminance = result[rim].sum(axis=1, keepdims=True) / white.sum()
    result[rim] += weight * (luminance * white - result[rim])
    return result, (f"{counted}: they are taken for white, as bright as their other channels say",)
