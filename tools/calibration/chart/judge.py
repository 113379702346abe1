"""Decide whether a proposed place shows a ColorChecker: by its luminances, its colours and its grey row."""

from dataclasses import dataclass

import numpy as np

from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import as_rows
from shared.errors import InputError

from ..colour_matrix import fit_colour, grey_row_fault
from .place import ChartPlace
from .refine import patch_means, refined

_LARGEST_DIFFERENCE = 8.0  # mean dE2000 after the fit: real charts stay below 5, brick walls above 15
_ALIKE, _SURELY_ALIKE = 0.5, 0.9  # correlation of log luminances; a chart half in the shade still has 0.8
_LEAST_INSIDE = 8  # patches inside the frame of a chart that is cut off
_CUT_OFF = 29.0  # stands for the mean dE2000 of a chart that is cut off: such a place is still worth mentioning
_SAME = 0.3  # of a patch: corners nearer than that to those of a refused place would lead to it again
_ROUGHEST = 0.35  # standard deviation of log luminance inside a patch, median over patches

Fault = tuple[float, str]
"""Why a place is refused: mean dE2000 (inf = no colours could be fitted), and the reason."""


@dataclass(frozen=True, eq=False)
class FoundChart:
    """A chart in a frame.

    place: where it lies.
    difference: mean dE2000 to the reference after fitting a matrix and the light.
    """

    place: ChartPlace
    difference: float


class Judge:
    """Judges proposed corners in one picture. It refines no place twice, because that takes most of the time.

    picture: (H, W, C), linear.
    reference: (24, 3), XYZ (D50), white = 1.
    """

    def __init__(self, picture: FloatArray, reference: DoubleArray) -> None:
        self._picture, self._reference = picture, reference
        self._refused: list[tuple[DoubleArray, Fault]] = []

    def __call__(self, corners: DoubleArray) -> FoundChart | Fault:
        """Return the chart at corners (4, 2), turned the right way up and refined, or why there is none."""
        picture, reference = self._picture, self._reference
        try:
            place = ChartPlace(as_rows(corners))
        except InputError as error:
            return (np.inf, str(error))
        worst: Fault = (np.inf, "it shows no ColorChecker, whichever way up")
        for quarter in (0, 2):
            turned = place.turned(quarter)
            # Corners up to half a patch outside the frame: refinement may bring them in.
            if not turned.lies_in(picture.shape[:2], place.pitch / 2):
                if _looks_alike(picture, turned, reference, partly=True):
                    worst = min(worst, _cut_off(turned))
                continue
            rough = _difference(picture, turned, reference) if _looks_alike(picture, turned, reference) else float("inf")
            if rough > 3 * _LARGEST_DIFFERENCE:
                worst = min(worst, _wrong_colours(rough))
                continue
            judged = self._refined_once(turned)
            if isinstance(judged, FoundChart):
                return judged
            worst = min(worst, judged)
        return worst

    def _refined_once(self, place: ChartPlace) -> FoundChart | Fault:
        """Refine and examine a place; one that is near a place refused before is refused for the same reason."""
        corners = np.array(place.corners)
        for before, fault in self._refused:
            if np.hypot(*(corners - before).T).max() < _SAME * place.pitch:
                return fault
        judged = examine(self._picture, refined(self._picture, place), self._reference)
        if not isinstance(judged, FoundChart):
            self._refused.append((corners, judged))
        return judged


def examine(picture: FloatArray, place: ChartPlace, reference: DoubleArray) -> FoundChart | Fault:
    """Return the chart at a place if it passes all tests, or why it does not; parameters: see `Judge`."""
    if not place.lies_in(picture.shape[:2]):
        return _cut_off(place)
    means, roughness = patch_means(picture, place)
    difference = _difference(picture, place, reference)
    if difference > _LARGEST_DIFFERENCE:
        return _wrong_colours(difference)
    if fault := grey_row_fault(means[18:].sum(axis=1), reference[18:, 1]):
        return (difference, fault)
    if np.median(roughness) > _ROUGHEST:
        return (difference, "the patches are not uniform")
    return FoundChart(place, difference)


def _looks_alike(picture: FloatArray, place: ChartPlace, reference: DoubleArray, *, partly: bool = False) -> bool:
    """Return whether the patches' luminances follow the reference at all: a cheap test before the colours are fitted.

    partly: use only the patches inside the frame, and be stricter because there are fewer.
    """
    means, _ = patch_means(picture, place)
    seen, wanted = np.log(np.maximum(means.sum(axis=1), 1e-4)), np.log(reference[:, 1])
    if partly:
        x, y = place.at(*place.cells.T)
        inside = (x > 0) & (x < picture.shape[1]) & (y > 0) & (y < picture.shape[0])
        if inside.sum() < _LEAST_INSIDE:
            return False
        seen, wanted = seen[inside], wanted[inside]
    return bool(seen.std() > 0 and np.corrcoef(seen, wanted)[0, 1] > (_SURELY_ALIKE if partly else _ALIKE))


def _difference(picture: FloatArray, place: ChartPlace, reference: DoubleArray) -> float:
    """Return the mean dE2000 of the patches under the best matrix and light; inf if there is no fit."""
    means, _ = patch_means(picture, place)
    try:
        mean = float(fit_colour(means, reference, place.cells, thorough=False).difference.mean())
    except (InputError, np.linalg.LinAlgError):
        return float("inf")
    return mean if np.isfinite(mean) else float("inf")


def _cut_off(place: ChartPlace) -> Fault:
    return _CUT_OFF, f"its corners {place} lie outside the frame: the chart is cut off"


def _wrong_colours(difference: float) -> Fault:
    limit = f"at most {_LARGEST_DIFFERENCE:.0f}"
    return difference, f"its colours are not a ColorChecker's (mean dE2000 {difference:.0f} after fitting, {limit})"
