"""What a frame shows (nothing, an even surface, a scene), so that one given as another kind is refused with the right reason."""

from functools import cached_property

import numpy as np

from shared import Mosaic
from shared.arrays import BoolArray
from shared.errors import InputError

from .samples import CLIPPED, levels_of, robust_deviation, without

_TILES = 24  # along each side
_DARK, _LEAST_CODES = 1 / 1024, 3.0  # of full scale, and codes: in less light than that filters do not differ
_NOT_DARK, _OFF = 0.1, 0.02  # of full scale, above a black level that is assumed, or measured in dark frames that may be wrong
_DIM = 0.1  # of full scale: a white patch below it shows much more noise than one at three quarters
_OVEREXPOSED = 0.2  # of the samples
_STEP, _LEAST_STEP = (
    0.3,
    0.005,
)  # between neighbouring tiles, of the logarithm of the light, and of full scale: no lens makes so many
_STEPS = 0.05  # of the pairs of neighbouring tiles: no lens makes so many
_LEAST_PAIRS = 100  # of neighbouring tiles, that tell an even surface
_NOISE = 6.0  # standard errors


class Content:
    """What the panchromatic samples of a frame show, and its channels beside them; levels are parts of full scale.

    mosaic: the frame; its black level counts, its shading does not.
    """

    def __init__(self, mosaic: Mosaic) -> None:
        levels, period = levels_of(without(mosaic, "shading")), mosaic.pattern.period
        row, column = np.argwhere(mosaic.pattern.panchromatic_mask((period, period)))[0]
        self._clear = levels[row::period, column::period].astype(np.float64)  # one site of each period tells it
        colours = [float(np.median(levels[*lattice])) for _, *lattice in mosaic.pattern.lattices]
        self._code = 1 / (mosaic.calibration.white_level - mosaic.calibration.black_level[-1])
        self.level = float(np.median(self._clear))
        self.lift = self.level - float(np.mean(colours))
        self.brightest = float(np.quantile(self._clear, 0.995))

    @cached_property
    def _steps(self) -> BoolArray:
        """Return of each pair of neighbouring tiles whether the light differs by more than noise explains."""
        rows, columns = (min(max(length // _TILES, 2), length) for length in self._clear.shape)
        high, wide = self._clear.shape[0] // rows, self._clear.shape[1] // columns
        tiles = self._clear[: high * rows, : wide * columns].reshape(high, rows, wide, columns).swapaxes(1, 2)
        samples = tiles.reshape(high, wide, rows * columns)
        middle = np.median(samples, axis=2)
        # Of a median, sqrt(pi / 2) times that of a mean; of two, sqrt(2) times more.
        error = float(robust_deviation(samples - middle[..., None])) * np.sqrt(np.pi / (rows * columns))
        light = np.log(np.maximum(middle, max(0.02 * self.brightest, 1e-6)))
        steps, ratios = (np.concatenate([np.diff(each, axis=axis).ravel() for axis in (0, 1)]) for each in (middle, light))
        large: BoolArray = (np.abs(steps) > max(_LEAST_STEP, _NOISE * error)) & (np.abs(ratios) > _STEP)
        return large

    def is_dark(self, *, black_measured: bool) -> bool:
        """Whether no light fell in: nothing reads more than black, or no filter more than another, where black may be off.

        black_measured: whether dark frames have measured the black level; False = it is assumed.
        """
        least = max(_DARK, _LEAST_CODES * self._code)
        alike = abs(self.lift) < least and self.level < (_OFF if black_measured else _NOT_DARK)
        return (alike or (black_measured and self.level < least)) and not self.shows_a_scene

    @property
    def shows_a_scene(self) -> bool:
        """Whether light differs from place to place in steps, as no lens makes it."""
        return bool(self._steps.sum() > _STEPS * self._steps.size)

    @property
    def is_even(self) -> bool:
        """Whether there is no step at all."""
        return self._steps.size >= _LEAST_PAIRS and not self._steps.any()

    @property
    def is_dim(self) -> bool:
        """Whether even the brightest places are much darker than a chart has to be."""
        return self.brightest < _DIM

    @property
    def clipped(self) -> float:
        """Part of the panchromatic samples that are clipped."""
        return float((self._clear >= CLIPPED).mean())


def check_dark(mosaic: Mosaic) -> None:
    """Raise InputError if a frame that is given as dark shows a scene or an evenly lit surface."""
    content = Content(mosaic)
    if content.shows_a_scene:
        raise InputError("is not dark: it shows a scene; cover the lens (a shot of the chart is given without `dark`)")
    if content.level > _NOT_DARK:
        raise InputError(
            f"is not dark: its median is {100 * content.level:.0f} % of full scale; cover the lens (flat frames go by `flat`)"
        )


def check_flat(mosaic: Mosaic, *, black_measured: bool) -> None:
    """Raise InputError if a frame that is given as flat is dark or shows a scene; black_measured: see `Content`."""
    content = Content(mosaic)
    if content.is_dark(black_measured=black_measured):
        raise InputError("is dark: no light fell in; dark frames are given by `dark`")
    if content.shows_a_scene:
        raise InputError(
            "is no flat frame: it shows a scene; take an evenly lit surface, out of focus (a shot of the chart is given without "
            "`flat`)"
        )


def why_no_chart(mosaic: Mosaic) -> str:
    """Return why a frame shows no chart, by what it shows instead; "" if that is nothing in particular."""
    content = Content(mosaic)
    if content.is_dim:
        if content.is_dark(black_measured=False):
            return "no ColorChecker was found: it is dark; a dark frame, or a folder of them, is given by `dark`"
        reading = f"its brightest places read {100 * max(content.brightest, 0):.1f} % of full scale"
        return f"it is too dark for a chart: {reading}; expose more, so that white reads about three quarters"
    if content.clipped > _OVEREXPOSED:
        part = f"{100 * content.clipped:.0f} % of its panchromatic samples are clipped"
        return f"it is over-exposed: {part}; expose less, so that white reads about three quarters"
    if content.is_even:
        return "no ColorChecker was found: it shows an even surface; a flat frame, or a folder of them, is given by `flat`"
    return ""
