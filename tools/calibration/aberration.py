"""Lateral chromatic aberration from edges: how far each channel is displaced along the radius of the frame.

Displacements are relative to one channel. All shots are fitted together. A centred lens displaces along the radius, symmetrically;
a shift and a turn are fitted too, to see whether it was one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from shared import Aberration
from shared.aberration import half_diagonal
from shared.arrays import DoubleArray
from shared.errors import InputError

from .displacement import FARTHEST, LIKELY, RINGS, TERMS, ShotStep, fitted, jackknife
from .edges import Edges
from .frame_sets import common_focal_length

_RADII = (0.5, 0.75, 1.0)  # shares of half the diagonal, where a displacement may be seen
_LEAST, _CLEAR = 0.05, 5.0  # pixels, standard errors: less counts as none
_WORST, _LARGEST = 0.2, 0.3  # pixels: standard error in the corners, in general, and if it is a quarter of the displacement
_ERRORS = 4.0
_FAR, _FAR_SHARE = 0.6, 0.05  # radius beyond which edges have to be, and the least share of the information from there
_ASKEW = 0.3  # pixels: shift, or turn in the corners, beyond its error
_APART = 0.3  # pixels: of a shot in the corners, beyond its error
_MOST_SHARE = 0.05  # displacement in the corners, share of half the diagonal
_RING_ERROR = 0.5  # pixels of rings: those that are known worse are not shown
_SCALE = 0.05  # of a displacement: it is not known better, since channels that are displaced blur luminance
_DIGITS = 6


@dataclass(frozen=True, eq=False)
class AberrationResult:
    """What edges show of lateral chromatic aberration.

    aberration: None = none was found.
    channels: letters of the channels.
    shots: number of shots.
    corner: (C,), displacement in the corners, pixels.
    error: (C,), its standard error, pixels.
    curve: (C, 2), displacement in pixels: linear and cubic term of the radius, 1 in the corners.
    rings: (R, C, 3), radius, displacement and its standard error of each channel in rings of the frame; NaN where edges are few.
    """

    aberration: Aberration | None
    channels: str
    shots: int
    corner: DoubleArray
    error: DoubleArray
    curve: DoubleArray
    rings: DoubleArray

    @property
    def words(self) -> str:
        """The aberration, for people."""
        known = f"±{self.error.max():.2g} pixels (standard error)"
        if self.aberration is None:
            return f"no lateral chromatic aberration: known to {known} in the corners"
        shown = ", ".join(f"{letter} {value:+.2f}" for letter, value in zip(self.channels, self.corner, strict=True) if value)
        return f"lateral chromatic aberration: {shown} pixels in the corners, known to {known}"


def measure_aberration(shots: Sequence[Edges]) -> AberrationResult:
    """Measure the lateral chromatic aberration that edges show. Raises InputError with the reason if they do not determine it."""
    focal = common_focal_length(((shot.name, shot.focal_length) for shot in shots), "shots with edges")
    shape, channels, gamma = shots[0].shape, shots[0].channels, shots[0].gamma
    for shot in shots:
        if shot.shape != shape:
            (high, wide), (rows, columns) = shot.shape, shape
            raise InputError(f"{shot.name} has {wide} x {high} pixels, {shots[0].name} {columns} x {rows}: take all alike")
    reference = channels.find("G") if "G" in channels else int(gamma.argmax())
    others = [each for each in range(len(channels)) if each != reference]
    terms, seen = fitted(shots, others, reference)
    likely = np.diag(np.tile(LIKELY**-2, len(others)))
    weight = sum(each.lines[0].whole.weight for each in seen) + likely
    spread = jackknife(seen, weight)
    half = half_diagonal(shape)
    _check(shots, seen, terms[others], spread, likely, half)
    curve, error = terms[:, :2], np.zeros(len(channels))
    clear = False
    for place, each in enumerate(others):
        block = spread[place * TERMS :, place * TERMS :][:2, :2]
        for radius in _RADII:
            powers = np.array([radius, radius**3])
            moved = abs(float(powers @ curve[each]))
            error[each] = np.hypot(float(powers @ block @ powers) ** 0.5, _SCALE * moved)  # the last one is that of the corners
            clear |= moved >= max(_LEAST, _CLEAR * error[each])
    radial = [[float(f"{value / half:.{_DIGITS}g}") for value in pair] for pair in curve.tolist()]
    aberration = Aberration(radial, shape, focal) if clear else None  # type: ignore[arg-type]
    return AberrationResult(aberration, channels, len(shots), curve.sum(axis=1), error, curve, _rings(seen, curve, others))


def _rings(seen: Sequence[ShotStep], curve: DoubleArray, others: Sequence[int]) -> DoubleArray:
    """Return what rings of the frame show, see `AberrationResult`."""
    rings = np.full((RINGS, len(curve), 3), np.nan)
    for ring in range(RINGS):
        weight = sum(each.rings.weight[ring] for each in seen)
        radius = (ring + 0.5) / RINGS
        if np.linalg.matrix_rank(weight) < len(others):
            continue
        inverse = np.linalg.inv(weight)
        step = inverse @ sum(each.rings.gradient[ring] for each in seen)
        for place, each in enumerate(others):
            error = abs(inverse[place, place]) ** 0.5
            if error < _RING_ERROR:
                rings[ring, each] = radius, curve[each] @ [radius, radius**3] + step[place], error
    return rings


def _check(
    shots: Sequence[Edges], seen: Sequence[ShotStep], terms: DoubleArray, spread: DoubleArray, likely: DoubleArray, half: float
) -> None:
    """Raise InputError if the edges do not determine the displacement, or show one that no centred lens makes.

    terms: (others, terms); spread: their covariance; likely: their weight before.
    half: half the diagonal, pixels.
    """
    corner = np.kron(np.eye(len(terms)), [1.0, 1.0, 0.0, 0.0, 0.0])  # (others, Q)
    error = np.sqrt(np.diag(corner @ spread @ corner.T))
    rings = sum(np.trace(each.rings.weight, axis1=1, axis2=2) for each in seen)
    far = float(rings[round(_FAR * RINGS) :].sum() / rings.sum())
    if far < _FAR_SHARE:
        raise InputError(
            f"shots with edges: hardly any edges are farther from the middle than {100 * _FAR:.0f} % of half the diagonal; "
            "take shots with edges in the corners"
        )
    astray = terms[:, 2:]
    errors = np.sqrt(np.diag(spread)).reshape(terms.shape)[:, 2:]
    if (np.abs(astray) > _ASKEW + _ERRORS * errors).any():
        shift, turn = np.hypot(astray[:, 0], astray[:, 1]).max(), np.abs(astray[:, 2]).max()
        raise InputError(
            f"shots with edges: a colour is displaced by {shift:.2g} pixels all over the frame, and turned by {turn:.2g} pixels in "
            f"the corners, {_ASKEW:g} are allowed; a lens displaces along the radius. Is it askew, or were the shots altered?"
        )
    for shot, each in zip(shots, seen, strict=True):
        whole = each.lines[0].whole
        weight = whole.weight + likely
        away = corner @ np.linalg.solve(weight, whole.gradient - likely @ terms.ravel())
        own = jackknife([each], weight)
        limit = _APART + _ERRORS * np.sqrt(np.diag(corner @ own @ corner.T))
        if len(shots) > 1 and (np.abs(away) > limit).any():
            raise InputError(
                f"{shot.name} shows a displacement in the corners that is {np.abs(away).max():.2g} pixels off that of the other "
                "shots; take all with one lens, at one focal length and focus"
            )
    largest = np.abs(terms[:, :2].sum(axis=1)).max()
    if largest - _ERRORS * error.max() > (most := min(FARTHEST, _MOST_SHARE * half)):
        raise InputError(
            f"shots with edges: the displacement in the corners is {largest:.1f} pixels, {most:.2g} are allowed; is it a lens?"
        )
    allowed = max(_WORST, min(largest / _ERRORS, _LARGEST))
    if not error.max() <= allowed:
        raise InputError(
            f"shots with edges: they tell the displacement in the corners, {largest:.2g} pixels, only to ±{error.max():.3g} "
            f"(standard error), {allowed:.3g} is allowed; take more shots, with more sharp edges all over "
            "the frame, well exposed"
        )
