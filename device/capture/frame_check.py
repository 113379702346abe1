"""Comparison of frames with the description of their sensor: until two have confirmed it, and
whether later ones still do.

Raw frames have no header. In a wrong layout, or with a wrong pattern, they would be saved as
pictures that look like noise or have false colours. A frame that contradicts its description is
refused; `panchroma identify` finds out what would be right.

A colour filter passes a fraction of the light that its panchromatic neighbours receive: colour
sites are darker wherever there is light. Folding a frame with the period of the pattern adds up
their differences, while scene and noise average out. In rows that do not line up, or with another
pattern, nothing adds up, or it does so elsewhere. Sites of one channel read the same: the two
greens of a Bayer block show its diagonal, and scattered sites where their tile begins.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import NoReturn

import numpy as np

from ...shared import CfaPattern, CodeArray, DoubleArray, InputError, SensorCalibration
from ...shared.arrays import BoolArray, ByteArray
from .bits import contradiction, has_gap, open_bits
from .frames import FrameError, RawFrame, Sensor
from .windows import FEWEST_WINDOWS, Windows

_OPEN = "the frame does not show whether {}; the next frames are looked at"
_GREENS = "the greens are on the right diagonal (it has little colour)"
_COLOUR_SITES = "each colour is where `pattern` says (it has little colour)"
_SLIPPED = "the frame does not show the filters where those before it did: {}, add `unchecked`"
_LOST = "the stream has lost or gained bytes; start the camera again. If it has not"
_ODD = "it is of another camera, or its file is damaged; leave it out. If it is right"

# frames that confirm the description; the second shows that the first has as many rows as described
_ENOUGH = 2
_SIDE, _PERIODS = 32, 4  # pixels along a window, and periods in it, at least
# of a first frame, at most; of a later one at least, all but twice as many in its last rows; and
# where these do not show the filters, in more rows
_FIRST_WINDOWS, _LAST_WINDOWS, _MORE_WINDOWS = 64, 24, 96
# windows: with so few standard errors and medians are uncertain; among many places twice as many
# errors are asked for
_FEW_WINDOWS = 8

_CERTAIN = 6.0  # standard errors of a contrast
# the best place explains this many times the variance that the next one does; in photographs 2.7
# times and more
_BETTER = 1.5
# times as much is explained where filters are than where they are not; blocks that overlap by half
# explain a tenth
_FAR = 4.0
# fraction of the variance that filters elsewhere explain at least: half of what is plain in a whole
# frame
_PLAIN = 0.03
_NOTHING = 1e-9  # what rounding leaves of stripes without the means of their rows and columns
# relative to panchromatic pixels: colour sites that are brighter have no filter; median of windows
_AS_BRIGHT = 0.9

_LIT = 0.03  # of the range of codes: a window with less light says nothing of its filters
# of the samples of a window: with more of them colour sites seem brighter than they are
_CLIPPED = 1 / 16
# of the black level and of the range of codes: no window is darker than black by more
_MARGIN, _LEAST_MARGIN = 1 / 8, 1 / 1024
# of the range of codes: samples of a dark frame differ by less, but for this percentage at either
# end
_NARROW, _DEFECTS = 1 / 16, 1
_OVEREXPOSED = 0.1  # of the samples: so many clipped ones may hide the filters

# times the energy of all other differences; in photographs 7 times and more where there is light
_UNLIKE_FILTERS = 3.0
# of the energy of panchromatic pixels: a filter passes half the light or less, and sites are nearer
_SCENE = 1 / 8
_IMBALANCE = 0.03  # of their level by which sites of one channel may differ
_SURE_ENERGY = 5.0  # standard errors of an energy


class SlippedError(FrameError):
    """A stream has lost or gained bytes: this frame, and perhaps some before it, are not what the
    camera has sent.
    """


def checked(
    frames: Iterable[RawFrame],
    sensor: Sensor,
    note: Callable[[str], None],
    refused: Callable[[InputError], None],
) -> Iterator[RawFrame]:
    """Pass frames on, and look at them: until some have confirmed the description of their sensor,
    and whether they still do.

    Raises FrameError, before the frame is passed on, at the first that contradicts the description.

    Parameters
    ----------
    note : Callable[[str], None]
        Called with each sentence on what a frame leaves open, once.
    refused : Callable[[InputError], None]
        Called for a file that is not like those before it, which is left out: the next one begins
        anew.

    Raises
    ------
    SlippedError
        When a stream has lost or gained bytes since.
    """
    check = _Check(sensor, cache(note))  # which notes each sentence once
    for frame in frames:
        try:
            is_checked = check.look(frame)
        except InputError as error:
            reason = type(error)(frame.named(error))
            if not frame.source or not isinstance(error, SlippedError):
                raise reason from None
            refused(reason)
        else:
            yield replace(frame, is_checked=is_checked)


def _slipped(frame: RawFrame) -> SlippedError:
    """The error of a frame, of a stream or in a file, that does not show what others have shown."""
    return SlippedError(_SLIPPED.format(_ODD if frame.source else _LOST))


class _Check:
    """Frames so far, and what they have confirmed. For the arguments see `checked`."""

    def __init__(self, sensor: Sensor, note: Callable[[str], None]) -> None:
        self._sensor, self._note, self._layout = sensor, note, sensor.layout
        self._pattern, self._calibration = sensor.pattern, sensor.calibration
        most = min(self._layout.width, self._layout.height)
        self._side = min(max(_SIDE, _PERIODS * self._pattern.period), most)  # of a window, pixels
        self._confirmed = 0
        self._has_colours = self._tells_colours = False

    def look(self, frame: RawFrame) -> bool:
        """Return whether the frame shows what is described after others have, and note what it
        leaves open.

        Raises FrameError if the frame contradicts the description.
        """
        is_known, self._tells_colours = self._confirmed >= _ENOUGH, not self._pattern.is_scattered
        # whoever reads it says so
        if is_known and len(frame.data) != self._layout.frame_bytes:
            return False
        shown = self._later(frame) if is_known else self._first(frame)
        if shown and self._confirmed and not is_known:
            self._later(frame)  # most of it may lie before what slipped
        self._confirmed += shown
        return shown and is_known and self._tells_colours

    def _first(self, frame: RawFrame) -> bool:
        """Return whether all of a frame shows the pattern, and note what it leaves open."""
        codes = self._layout.unpack(frame.data)
        windows = Windows.of(codes, self._side, _FIRST_WINDOWS)
        reason = impossible_level(codes, windows, self._calibration)
        if reason := reason or contradiction(self._sensor, frame, codes, windows):
            self._refuse(frame, reason)
        shown = shows_filters(windows, self._pattern)
        if shown is False and self._confirmed:
            rows = f"frames have another number of rows than {self._layout.height}"
            self._refuse(frame, f"it does not begin where the frame before it ended: {rows}")
        if shown is False or (shown and has_longer_period(windows, self._pattern)):
            places = "the colour sites are not where `pattern` and `origin` say"
            rows = "or rows do not begin where `stride` and `width` say"
            self._refuse(frame, f"{places}, {rows}")
        if shown is None:
            if not is_even(codes, self._calibration) and lacks_filters(windows, self._sensor):
                colours = "the samples at the places of the colour filters"
                self._refuse(frame, f"{colours} are as bright as their neighbours")
            why = hindrance(codes, self._calibration)
            self._note(_OPEN.format(f"size, format and pattern are right ({why})"))
            return False
        self._look_at_colours(frame, windows)
        if remark := open_bits(codes, self._calibration):
            self._note(remark)
        return True

    def _later(self, frame: RawFrame) -> bool:
        """Return the same of the last rows of a frame, which move when anything before them slips.
        Raises SlippedError where they show anything else.
        """
        layout, bits = self._layout, self._calibration.bits
        across = max(layout.width // self._side, 1)
        for least in (_LAST_WINDOWS, _MORE_WINDOWS):
            rows = min(self._side * -(-least // across), layout.height)
            top = layout.height - rows
            last = memoryview(frame.data)[top * layout.stride :]
            codes = replace(layout, height=rows).unpack(last)
            windows = Windows.of(codes, self._side, 2 * least, top)
            shown = shows_filters(windows, self._pattern)
            has_its_bits = codes.max() >> bits == 0 and not has_gap(codes, layout)
            is_alike = shown is None and not lacks_filters(windows, self._sensor)
            if not (has_its_bits and (shown or is_alike)):
                raise _slipped(frame)
            if shown:
                self._look_at_colours(frame, windows)
                return True
        return False

    def _look_at_colours(self, frame: RawFrame, windows: Windows) -> None:
        """Note what the windows of a frame that shows its filters leave open of their colours."""
        if self._has_colours and not self._pattern.is_scattered:
            return
        coloured = shows_colours(windows, self._sensor)
        self._tells_colours |= coloured is True
        if coloured is False and self._has_colours:
            raise _slipped(frame)
        if coloured is False:  # until a frame shows them they may as well be described wrongly
            greens = "the two greens of a block lie on the other diagonal"
            scattered = "its colours are at other sites of the tile"
            self._refuse(frame, scattered if self._pattern.is_scattered else greens)
        self._has_colours |= coloured is True
        if not self._has_colours:
            self._note(_OPEN.format(_COLOUR_SITES if self._pattern.is_scattered else _GREENS))

    def _refuse(self, frame: RawFrame, reason: str) -> NoReturn:
        """Raise FrameError with the reason."""
        layout, source = self._layout, frame.source or "FRAME"
        raise FrameError(
            f"the frame is not as described: {reason}; run `panchroma identify {source} --size "
            f"{layout.width}x{layout.height} --pixel-format {layout.format} --stride "
            f"{layout.stride}`. If the description is right, add `unchecked`"
        )


def impossible_level(codes: CodeArray, windows: Windows, calibration: SensorCalibration) -> str:
    """Return which level no frame of the sensor has; "" if none.

    Parameters
    ----------
    windows : Windows
        Of the frame.
    """
    highest, black = int(codes.max()), float(np.mean(calibration.black_level))
    if highest >> calibration.bits:
        return f"a sample is {highest}, more than {calibration.bits} bits hold"
    if (darkest := float(windows.codes.mean(axis=(1, 2)).min())) < black - _margin(calibration):
        dark = f"a part of it has a mean of {darkest:.0f}, darker than black, which is {black:.0f}"
        remedy = "`black=N` or `sensor_bits=N` moves it; `unchecked` is for a covered lens"
        return f"{dark} ({remedy})"
    return ""


def is_even(codes: CodeArray, calibration: SensorCalibration) -> bool:
    """Return whether all samples but defects are nearly equal, as in the dark."""
    low, high = np.percentile(codes[::7, ::5], (_DEFECTS, 100 - _DEFECTS))
    return bool(high - low < _NARROW * (1 << calibration.bits))


def hindrance(codes: CodeArray, calibration: SensorCalibration) -> str:
    """Return what keeps a frame from showing its filters."""
    if float(codes.mean()) < float(np.mean(calibration.black_level)) + _margin(calibration):
        return "it is dark"
    clipped = float((codes >= calibration.white_level).mean())
    if clipped > _OVEREXPOSED:
        return f"{100 * clipped:.0f} % of its samples are clipped: it is overexposed"
    return "it is even, noisy or too dim"


def shows_filters(windows: Windows, pattern: CfaPattern) -> bool | None:
    """Return whether colour sites are where `pattern` has them; False: at another place, None: the
    windows do not show it.
    """
    if len(windows.codes) < FEWEST_WINDOWS:
        return None
    flat = windows.flattened()
    explained, certainties = _explained(flat, pattern, pattern.period)
    best = divmod(int(explained.argmax()), pattern.period)
    most, ours = float(explained[best]), _places_alike(pattern, pattern.block_origin)
    here, elsewhere = explained[ours].max(), explained[~ours].max(initial=0.0)
    if here == most > _BETTER * elsewhere and certainties[best] > _CERTAIN:
        return True
    if certainties[best] < _CERTAIN * (1 + _FEW_WINDOWS / len(flat.codes)):
        return None
    # Where colour sites are elsewhere, other places show hardly anything, whatever the scene
    # repeats.
    there = explained > most / _BETTER
    if here < most / _FAR:
        there &= ~_places_alike(pattern, best)
        return None if there.any() or most < _PLAIN * np.square(flat.codes).mean() else False
    return False if (there & ~ours).any() and (there | (explained < most / _FAR)).all() else None


def has_longer_period(windows: Windows, pattern: CfaPattern) -> bool:
    """Return whether blocks repeat at twice the period of `pattern` only. It is for windows that
    show them.
    """
    flat = windows.flattened()
    explained, _ = _explained(flat, pattern, 2 * pattern.period)
    rows, columns = (slice(place, None, pattern.period) for place in pattern.block_origin)
    *_, second, first = np.sort(explained[rows, columns], axis=None)
    least = max(_FAR * second, _PLAIN / 2 * float(np.square(flat.codes).mean()))
    return not pattern.is_scattered and bool(first > least)


def lacks_filters(windows: Windows, sensor: Sensor) -> bool:
    """Return whether there is light, and the colour sites are as bright as panchromatic pixels in
    the same rows, or columns.
    """
    pattern, calibration = sensor.pattern, sensor.calibration
    black, white = float(np.mean(calibration.black_level)), calibration.white_level
    sites = ~pattern.panchromatic_mask((pattern.period, pattern.period))
    levels = windows.levels(pattern.period) - black
    is_bright = levels[:, ~sites].mean(axis=1) > _LIT * (white - black)
    lit = is_bright & ((windows.codes >= white).mean(axis=(1, 2)) < _CLIPPED)
    if lit.sum() < _FEW_WINDOWS:
        return False
    for axis in (0, 1):
        mixed = sites.any(axis=axis, keepdims=True) & ~sites.all(axis=axis, keepdims=True)
        colour, clear = (levels[lit][:, kind & mixed].mean(axis=1) for kind in (sites, ~sites))
        if mixed.any() and np.median(colour / clear) > _AS_BRIGHT:
            return True
    return False


def shows_colours(windows: Windows, sensor: Sensor) -> bool | None:
    """Return whether each colour is at the sites where `pattern` has it; None where the windows do
    not show it.

    True where no frame can show it: where only channels are exchanged (a chart tells which is red).

    Parameters
    ----------
    windows : Windows
        They show the panchromatic pixels where `pattern` has them.
    """
    pattern, calibration = sensor.pattern, sensor.calibration
    period, candidates = pattern.period, [pattern]
    if pattern.is_scattered:
        alike = np.argwhere(_places_alike(pattern, pattern.block_origin)).tolist()
        candidates += [replace(pattern, origin=(row, column)) for row, column in alike]
    elif len(pattern.sites) == 4 and pattern.block_shape == (2, 2):
        block = tuple(row[1::-1] for row in pattern.letters_from(pattern.block_origin)[:2])
        origin, channels = pattern.block_origin, pattern.channels
        candidates.append(CfaPattern.with_block(block, period, origin, channels))
    planes = [candidate.filter_map((period, period)) for candidate in candidates]
    sites = planes[0] < len(pattern.channels)
    at_sites = [plane[sites] for plane in planes]
    kinds = {(plane[:, None] == plane).tobytes(): plane for plane in reversed(at_sites)}
    ours = kinds.pop((at_sites[0][:, None] == at_sites[0]).tobytes())
    if not kinds:
        return True
    levels = windows.levels(period) - float(np.mean(calibration.black_level))
    levels = levels[(windows.codes < calibration.white_level).all(axis=(1, 2))]
    if len(levels) < _FEW_WINDOWS:
        return None
    samples = levels[:, sites]
    own, others = _spread(samples, ours), [_spread(samples, other) for other in kinds.values()]
    # What makes sites of one channel differ, the scene or the sensor, is at most as large as this.
    contrast, level = levels[:, ~sites].var(axis=1), samples.mean(axis=1)
    usual = np.maximum(_SCENE * contrast, np.square(_IMBALANCE * level) / 2)
    best = min(others, key=lambda other: float(other.mean()))
    if all(_exceeds(other, np.maximum(own, usual)) for other in others):
        return True
    return False if _exceeds(own, np.maximum(best, usual)) else None


def _spread(samples: DoubleArray, kinds: ByteArray) -> DoubleArray:
    """Variance of the sites of a kind about their mean, in each window. samples: (windows, sites).
    kinds: of each site, (sites,).
    """
    shares = (kinds[:, None] == kinds).astype(float)
    shares /= shares.sum(axis=1, keepdims=True)
    return np.square(samples - samples @ shares.T).sum(axis=1) / (len(shares) - np.trace(shares))


def _exceeds(ours: DoubleArray, others: DoubleArray) -> bool:
    """Tell whether energies of windows are certainly larger than others, by enough for a difference
    of filters.
    """
    # Of each window at most 1, so that a few strong colours do not hide how certain the many are.
    votes = (ours - others) / (ours + others + _NOTHING)
    are_certain = votes.mean() > _SURE_ENERGY * votes.std(ddof=1) / votes.size**0.5
    return bool(are_certain and ours.mean() > _UNLIKE_FILTERS * others.mean())


def _places_alike(pattern: CfaPattern, place: tuple[int, int]) -> BoolArray:
    """Return the mask of `place` and all others at which the colour sites would be the same, (K,
    K).
    """
    block = _block(pattern, pattern.period)
    moved = (np.roll(block, step, (0, 1)) for step in np.ndindex(block.shape))
    same = np.reshape([np.array_equal(turned, block) for turned in moved], block.shape)
    return np.roll(same, place, (0, 1))


def _block(pattern: CfaPattern, period: int) -> DoubleArray:
    """1 at the colour sites, if they had this period, (K, K)."""
    block = ~pattern.panchromatic_mask(pattern.block_shape, pattern.block_origin)
    return np.pad(block.astype(float), [(0, period - side) for side in block.shape])


def _explained(flat: Windows, pattern: CfaPattern, period: int) -> tuple[DoubleArray, DoubleArray]:
    """Variance that a block explains at each place, (K, K), 0 where it is not darker; its contrast
    in standard errors.

    flat: see `Windows.flattened`. period: K, if blocks had this one.
    """
    folded, block = flat.folded(period), _block(pattern, period)
    contrasts, certainties = [], []
    # Once as it is, and once without the means of rows and columns, so that stripes of the same
    # period are not taken for blocks.
    for means, model in ((folded, block - block.mean()), (_centred(folded), _centred(block))):
        if np.square(model).sum() < _NOTHING:
            continue
        sites = [np.roll(means, -site, (1, 2)) for site in np.argwhere(block)]
        contrast = sum(sites) / np.square(model).sum()
        contrasts.append(mean := contrast.mean(axis=0))
        certainties.append(mean / (contrast.std(axis=0, ddof=1) / len(contrast) ** 0.5 + 1e-3))
    if not contrasts:  # all sites are coloured, and none stands out
        return np.zeros(block.shape), np.zeros(block.shape)
    darker, filled = np.maximum(-np.max(contrasts, axis=0), 0.0), block.mean()
    return darker**2 * filled * (1 - filled), -np.max(certainties, axis=0)


def _centred(means: DoubleArray) -> DoubleArray:
    rows, columns = means.mean(axis=-1, keepdims=True), means.mean(axis=-2, keepdims=True)
    return means - rows - columns + means.mean(axis=(-1, -2), keepdims=True)


def _margin(calibration: SensorCalibration) -> float:
    """Codes by which a part of a frame may be darker than black."""
    black = float(np.mean(calibration.black_level))
    return max(_MARGIN * black, _LEAST_MARGIN * (1 << calibration.bits))
