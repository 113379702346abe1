"""Content of a frame (nothing, an even surface, a scene), so that one given as another kind is
refused with the right reason.
"""

from dataclasses import dataclass

import numpy as np

from ...shared import Mosaic
from ...shared.errors import InputError
from .samples import CLIPPED, levels_of, robust_deviation, without_shading

# Parts of full scale, where nothing else is said. All are set so that simulated frames of each kind
# are told apart.
_TILES = 24  # along each side
# Of full scale, and codes: in less light than that filters do not differ.
_DARK, _LEAST_CODES = 1 / 1024, 3.0
# Above a black level that is assumed, or measured in dark frames that may be wrong.
_NOT_DARK, _OFF = 0.1, 0.02
_DIM = 0.1  # a white patch below it shows much more noise than one at three quarters
_OVEREXPOSED = 0.2  # of the samples
# Between neighbouring tiles, of the logarithm of the light, and of full scale.
_STEP, _LEAST_STEP = 0.3, 0.005
_STEPS = 0.05  # of the pairs of neighbouring tiles: no lens makes so many
_NOISE = 6.0  # standard errors


@dataclass(frozen=True)
class Content:
    """Content of the panchromatic samples of a frame; levels are parts of full scale.

    Attributes
    ----------
    level : float
        Median.
    lift : float
        Of the median above the mean of the channels' medians.
    brightest : float
        Quantile 0.995.
    clipped : float
        Part of the samples that are clipped.
    least : float
        Level below which a difference between filters is none.
    is_scene : bool
        Whether light differs from place to place in steps, as no lens makes it.
    """

    level: float
    lift: float
    brightest: float
    clipped: float
    least: float
    is_scene: bool

    @classmethod
    def of(cls, mosaic: Mosaic) -> "Content":
        """Return the content of a frame; its black level counts, its shading does not."""
        levels, period = levels_of(without_shading(mosaic)), mosaic.pattern.period
        row, column = np.argwhere(mosaic.pattern.panchromatic_mask((period, period)))[0]
        # One site of each period tells it.
        clear = levels[row::period, column::period].astype(np.float64)
        colours = [float(np.median(levels[*lattice])) for _, *lattice in mosaic.pattern.lattices]
        calibration = mosaic.calibration
        level, brightest = float(np.median(clear)), float(np.quantile(clear, 0.995))
        return cls(
            level,
            level - float(np.mean(colours)),
            brightest,
            float((clear >= CLIPPED).mean()),
            max(_DARK, _LEAST_CODES / (calibration.white_level - calibration.black_level[-1])),
            _has_steps(clear, brightest),
        )

    def is_dark(self, *, black_measured: bool) -> bool:
        """True if no light fell in: nothing reads more than black, or no filter more than another,
        where black may be off.

        Parameters
        ----------
        black_measured : bool
            Whether dark frames have measured the black level; False = it is assumed.
        """
        alike = abs(self.lift) < self.least and self.level < (_OFF if black_measured else _NOT_DARK)
        return (alike or (black_measured and self.level < self.least)) and not self.is_scene


def _has_steps(clear: np.ndarray, brightest: float) -> bool:
    """Return whether many neighbouring tiles differ by more light than noise and a lens explain.
    clear: (h, w), levels.
    """
    rows, columns = (min(max(length // _TILES, 2), length) for length in clear.shape)
    high, wide = clear.shape[0] // rows, clear.shape[1] // columns
    tiles = clear[: high * rows, : wide * columns].reshape(high, rows, wide, columns).swapaxes(1, 2)
    samples = tiles.reshape(high, wide, rows * columns)
    middle = np.median(samples, axis=2)
    # Of a median, sqrt(pi / 2) times that of a mean; of two, sqrt(2) times more.
    error = robust_deviation(samples - middle[..., None]) * np.sqrt(np.pi / (rows * columns))
    light = np.log(np.maximum(middle, max(0.02 * brightest, 1e-6)))
    steps, ratios = (
        np.abs(np.concatenate([np.diff(values, axis=axis).ravel() for axis in (0, 1)]))
        for values in (middle, light)
    )
    large = (steps > max(_LEAST_STEP, _NOISE * error)) & (ratios > _STEP)
    return bool(large.sum() > _STEPS * large.size)


def check_dark(mosaic: Mosaic) -> None:
    """Raise InputError if a frame that is given as dark shows a scene or an evenly lit surface."""
    content = Content.of(mosaic)
    if content.is_scene:
        advice = "cover the lens (a shot of the chart is given without `dark`)"
        raise InputError(f"is not dark: it shows a scene; {advice}")
    if content.level > _NOT_DARK:
        level = f"its median is {100 * content.level:.0f} % of full scale"
        raise InputError(f"is not dark: {level}; cover the lens (flat frames go by `flat`)")


def check_flat(mosaic: Mosaic, *, black_measured: bool) -> None:
    """Raise InputError if a frame that is given as flat is dark or shows a scene.

    Parameters
    ----------
    black_measured : bool
        See `Content.is_dark`.
    """
    content = Content.of(mosaic)
    if content.is_dark(black_measured=black_measured):
        raise InputError("is dark: no light fell in; dark frames are given by `dark`")
    if content.is_scene:
        instead = "take an evenly lit surface, out of focus"
        other = "(a shot of the chart is given without `flat`)"
        raise InputError(f"is no flat frame: it shows a scene; {instead} {other}")


def why_no_chart(mosaic: Mosaic) -> str:
    """Return why a frame in which no chart was found shows none, "" if that is nothing in
    particular.
    """
    content, kind, remedy = Content.of(mosaic), "", "so that white reads about three quarters"
    if content.brightest < _DIM:
        if not content.is_dark(black_measured=False):
            percent = f"{100 * max(content.brightest, 0):.1f} %"
            reading = f"its brightest places read {percent} of full scale"
            return f"it is too dark for a chart: {reading}; expose more, {remedy}"
        kind = "is dark; a dark frame, or a folder of them, is given by `dark`"
    elif content.clipped > _OVEREXPOSED:
        percent = f"{100 * content.clipped:.0f} %"
        reading = f"{percent} of its panchromatic samples are clipped"
        return f"it is over-exposed: {reading}; expose less, {remedy}"
    elif not content.is_scene:
        kind = "shows an even surface; a flat frame, or a folder of them, is given by `flat`"
    return kind and f"no ColorChecker was found: it {kind}"
