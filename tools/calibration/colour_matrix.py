"""The colour matrix from camera RGB to XYZ (D50), which keeps white neutral, and the uneven light
on the chart.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...shared import BoolArray, CfaPattern, DoubleArray, InputError
from ...shared.colorimetry import D50, SRGB_TO_XYZ, xyz
from ...shared.lights import illuminant_xy
from ..io.colour import delta_e_2000, lab_slopes, xyz_to_lab
from .chart.place import COLUMNS, PATCHES, ROWS

# Neutral 8, 6.5, 5: the white patch is slightly yellow, the darker ones collect stray light.
GREYS = 19, 20, 21
_FEWEST_PATCHES, _FEWEST_GREYS = 20, 2  # that tell colours and white
FEWEST_CHANNELS = 3  # that can tell the colours of a chart apart
UNEVEN = 1.5  # brightest over dimmest light on the chart: worth a word
_CROOKED = 0.15  # log level: stray light and reflections bend the grey row less, tone curves more
# log light from patch to patch, fourfold over the row; half in the shade it is 0.19, with sRGB's
# curve 0.36
_STEEPEST = 0.28
_MATRIX_ROUNDS = 12
_FIELD_RIDGE = 0.02  # of a patch's weight: stabilises the corners
_HUBER = 0.08  # log light: a larger deviation is a reflection or the edge of a shadow
_DARKEST_PATCH = 0.02  # of white: colours outside sRGB have no logarithm
_NAMES = {"R": "red", "G": "green", "B": "blue", "C": "cyan", "M": "magenta", "Y": "yellow"}
# What sRGB's red, green and blue add up to, for the filters that may be exchanged with each other.
_KINDS = {"RGB": np.eye(3), "CMY": 1 - np.eye(3)}


@dataclass(frozen=True, eq=False)
class ColourFit:
    """A camera's colours under one light, from the patches of one chart.

    Attributes
    ----------
    camera : DoubleArray
        (24, C), linear levels.
    colours : DoubleArray
        (24, 3), XYZ (D50) of the reference, white = 1.
    centres : DoubleArray
        (24, 2), positions of the patches on the chart.
    matrix : DoubleArray
        (3, C), scene units to XYZ (D50); it takes `neutral` to D50 exactly.
    neutral : DoubleArray
        (C,), what white reads, largest entry 1.
    light : DoubleArray
        (24,), relative illumination of each patch, mean 1.
    lab : DoubleArray
        (24, 3), L*a*b* of the patches after correction.
    used : BoolArray
        (24,), False for patches that were left out.
    """

    camera: DoubleArray
    colours: DoubleArray
    centres: DoubleArray
    matrix: DoubleArray
    neutral: DoubleArray
    light: DoubleArray
    lab: DoubleArray
    used: BoolArray

    @property
    def unevenness(self) -> float:
        """The brightest over the dimmest light on the chart."""
        return float(self.light.max() / self.light.min())

    @cached_property
    def difference(self) -> DoubleArray:
        """The dE2000 of each patch, (24,); masked where it was left out."""
        return self._differences(self.lab)

    def _differences(self, lab: DoubleArray) -> DoubleArray:
        return np.ma.masked_array(delta_e_2000(lab, xyz_to_lab(self.colours)), ~self.used)

    @cached_property
    def left_out(self) -> DoubleArray:
        """The dE2000 of each patch with matrix and illumination field from the 23 others, (24,); it
        takes 24 times as long.
        """
        lab = np.zeros((PATCHES, 3))
        for index, used in enumerate(self.used * (1 - np.eye(PATCHES))):
            matrix, _, light = _fit(self.camera, self.colours, self.centres, used)
            lab[index] = xyz_to_lab(self.camera[index] / light[index] @ matrix.T)
        return self._differences(lab)


def fit_colour(
    camera: DoubleArray, colours: DoubleArray, centres: DoubleArray, used: BoolArray | None = None
) -> ColourFit:
    """Fit matrix, neutral and illumination field to the patches of one chart.

    camera, colours, centres: see `ColourFit`. used: see `ColourFit`; None = all patches. Raises
    InputError if too many patches are left out, or the grey ones have no light in some channel.
    """
    used = np.ones(len(camera), bool) if used is None else used
    greys = [index for index in GREYS if used[index]]
    if used.sum() < _FEWEST_PATCHES or len(greys) < _FEWEST_GREYS:
        raise InputError(f"colour: {int((~used).sum())} patches are clipped; expose less")
    if not (camera[greys] > 0).all():
        raise InputError("colour: the grey patches have no light in some channel; expose more")
    matrix, neutral, light = _fit(camera, colours, centres, used.astype(float))
    lab, light = xyz_to_lab((camera / light[:, None]) @ matrix.T), light / light.mean()
    return ColourFit(camera, colours, centres, matrix, neutral, light, lab, used)


def light_change(one: ColourFit, other: ColourFit, lights: tuple[str, str]) -> float:
    """Return by how much white changes from one chart to the other, over the change between the
    lights: 1 = as it should.

    The patches show what each channel sees of XYZ. A change of light acts on white like a coloured
    surface, so they predict the change in every channel, up to a common factor.

    lights: of the two charts, see `illuminant_xy`.
    """
    white, before = (xyz(*illuminant_xy(light)) for light in lights)
    expected = np.zeros(len(one.neutral))
    for fit in (one, other):
        even = (fit.camera / fit.light[:, None])[fit.used]
        sensitivity, *_ = np.linalg.lstsq(fit.colours[fit.used], even, rcond=None)
        ratio = np.maximum(white @ sensitivity, 1e-6) / np.maximum(before @ sensitivity, 1e-6)
        expected += np.log(ratio) / 2
    measured = np.log(one.neutral / other.neutral)
    expected -= expected.mean()
    return float((measured - measured.mean()) @ expected / (expected @ expected))


def _fit(
    camera: DoubleArray, reference: DoubleArray, centres: DoubleArray, used: DoubleArray
) -> tuple[DoubleArray, DoubleArray, DoubleArray]:
    """Return matrix, neutral (largest entry 1), and the absolute light on each patch.

    Light and matrix are fitted in turn: given the matrix, the light is the excess of luminance over
    the reference; given the light, the matrix is a linear least-squares problem. used: (24,),
    weights.
    """
    greys = [index for index in GREYS if used[index]]
    light = np.full(len(camera), (camera[greys].sum(axis=1) / reference[greys, 1]).mean())
    for step in range(_MATRIX_ROUNDS + 1):
        even = camera / light[:, None]
        neutral = (even[greys] / reference[greys, 1:2]).mean(axis=0)
        matrix = _white_preserving(even, reference, neutral, used)
        if step < _MATRIX_ROUNDS:
            excess = np.log(np.maximum(even @ matrix[1], 1e-6) / reference[:, 1])
            light = light * np.exp(_surface(excess, centres, used))
    scale = neutral.max()
    return matrix * scale, neutral / scale, light * scale


def _white_preserving(
    camera: DoubleArray, reference: DoubleArray, neutral: DoubleArray, used: DoubleArray
) -> DoubleArray:
    """Return the matrix M with M neutral = D50 that has the least squared error in L*a*b*, to first
    order.

    M = D50 n^T / n.n + Q B^T, where B is a basis of the space orthogonal to n: any Q preserves
    white (G. D. Finlayson, M. S. Drew, "White-point preserving color correction", CIC 1997).
    """
    basis = np.linalg.svd(neutral[None])[2][1:].T
    start = np.outer(D50, neutral) / (neutral @ neutral)
    # CIEDE2000 divides differences in chroma by 1 + 0.045 C (Eq. 19 in `delta_e_2000`).
    _, a, b = xyz_to_lab(reference).T
    emphasis = 1 / (1 + 0.045 * np.hypot(a, b))
    slopes = lab_slopes(reference) * emphasis[:, None, None] * used[:, None, None]
    design = np.einsum("nij,nk->nijk", slopes, camera @ basis).reshape(3 * len(camera), -1)
    target = np.einsum("nij,nj->ni", slopes, reference - camera @ start.T).ravel()
    solution, *_ = np.linalg.lstsq(design, target, rcond=None)
    return start + solution.reshape(3, -1) @ basis.T


def _surface(excess: DoubleArray, centres: DoubleArray, used: DoubleArray) -> DoubleArray:
    """Fit a second-order surface to logarithms (24,), robust against single patches; return its
    values (24,).
    """
    x, y = 2 * centres[:, 0] / COLUMNS - 1, 2 * centres[:, 1] / ROWS - 1
    terms = np.stack([np.ones(len(x)), x, y, x * x, x * y, y * y], axis=1)
    ridge = np.diag([0.0, *[_FIELD_RIDGE * PATCHES] * (terms.shape[1] - 1)])
    weight, values = used, excess
    for _ in range(5):
        weighted = terms * weight[:, None]
        values = terms @ np.linalg.solve(weighted.T @ terms + ridge, weighted.T @ excess)
        weight = used * np.minimum(1, _HUBER / np.maximum(np.abs(excess - values), 1e-9))
    return values


def grey_row_fault(level: DoubleArray, reference: DoubleArray) -> str | None:
    """Return why six levels cannot be a grey row: not monotone, or not linear; None if they can.

    The light may change along the row by a constant factor per patch, up to the effect of a shadow.
    The greys are nearly a geometric series, so a tone curve looks like a very steep fall-off of the
    light.

    level: (6,), white to black. reference: (6,), their Y.
    """
    if not (np.diff(level) < 0).all() or level[-1] <= 0:
        return "the grey row does not get darker from patch to patch"
    bend = np.log(level / reference)
    place = np.arange(len(level), dtype=float)
    line = np.polyfit(place, bend, 1, w=np.sqrt(reference))
    worst = float(np.abs(bend - np.polyval(line, place))[:-1].max())
    if worst > _CROOKED:
        return f"the grey row is not linear (off by {100 * worst:.0f} %)"
    if abs(line[0]) > _STEEPEST:
        change = f"{np.exp(abs(line[0]) * 5):.0f}-fold"
        return f"the grey row is not linear, or the light on it changes {change}"
    return None


def expected_levels(
    levels: DoubleArray, reference: DoubleArray, centres: DoubleArray, letter: str
) -> DoubleArray:
    """Return what a channel with this name should see of each patch, (24,): that of sRGB, in the
    light on the chart, which the other planes show.

    Parameters
    ----------
    levels : DoubleArray
        (24, P), of the planes that have samples.
    reference, centres : DoubleArray
        See `ColourFit`.
    letter : str
        R, G, B, or C, M, Y, which is the mean of two of them.
    """
    light = fit_colour(levels, reference, centres).light
    weights = {name: kind[i] for names, kind in _KINDS.items() for i, name in enumerate(names)}
    if letter not in weights:
        fault = "has no filter, and nobody knows what it should see of a chart"
        expected = f"such a channel has to be one of {', '.join(weights)}"
        raise InputError(f"the channel {letter} {fault}; {expected}")
    return light * (_linear_srgb(reference) @ weights[letter]) / weights[letter].sum()


def check_channel_order(levels: DoubleArray, reference: DoubleArray, pattern: CfaPattern) -> None:
    """Raise InputError if the channels R, G and B, or C, M and Y, see the chart's colours as if
    their names were exchanged.

    A matrix from camera RGB to XYZ undoes any exchange, so it cannot tell. But a filter called red
    is, however broad, more like the red of sRGB than a filter called blue is: the patches' colours,
    relative to grey, must be most alike in the order of the names.

    Parameters
    ----------
    levels : DoubleArray
        (24, C), patches under one light, linear.
    reference : DoubleArray
        (24, 3), XYZ (D50), white = 1.
    pattern : CfaPattern
        Of the shot.
    """
    srgb = _linear_srgb(reference)
    for names, mixture in _KINDS.items():
        if not set(names) <= set(pattern.channels):
            continue
        own = [pattern.channels.index(letter) for letter in names]
        expected, measured = _hues(srgb @ mixture), _hues(levels[:, own])
        # Channel `order[i]` of the shot sees what the i-th name should.
        _, order = linear_sum_assignment(expected.T @ measured, maximize=True)
        true = {names[index]: right for right, index in zip(names, order, strict=True)}
        wrong = " and ".join(_NAMES[letter] for letter in names if true[letter] != letter)
        block = "".join(true.get(letter, letter) for letter in "/".join(pattern.letters_from()))
        if wrong:
            shown = f"the chart shows that {wrong} are exchanged"
            fault = f"does not fit its sensor, whose pattern probably is {block}"
            remedy = "capture the shot again with the right pattern"
            raise InputError(f"{shown}: the pattern in the shot {fault}; {remedy}")


def _linear_srgb(colours: DoubleArray) -> DoubleArray:
    """XYZ (D50) as linear sRGB, (N, 3)."""
    return colours @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T


def _hues(levels: DoubleArray) -> DoubleArray:
    """Return the logarithms of the levels relative to grey and to the mean of the patch's channels,
    (24, C).
    """
    logarithms = np.log(np.maximum(levels / levels[list(GREYS)].mean(axis=0), _DARKEST_PATCH))
    return logarithms - logarithms.mean(axis=1, keepdims=True)
