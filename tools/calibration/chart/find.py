"""Find the ColorChecker in a shot: propose places, and decide of each by its luminances, colours and grey row.

A place is refined by moving its corners until its patches are uniform and its gaps dark.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from shared import Mosaic
from shared.arrays import DoubleArray, FloatArray
from shared.colorimetry import Matrix, as_rows
from shared.errors import InputError
from shared.progress import SILENT, Progress

from ..colour_matrix import fit_colour, grey_row_fault
from .lattice import lattice_corners
from .picture import linear_picture
from .place import COLUMNS, ROWS, ChartPlace, least_pitch

_SIZES = (500, 900, 1500, 2500)  # longer sides of the pictures that are searched, the likeliest first
_LARGEST_DIFFERENCE = 8.0  # mean dE2000 after the fit: real charts stay below 5, brick walls above 15
_WORTH_REFINING = 16.0  # mean dE2000 before refinement: of charts below 5, of walls and boxes above 20; refining takes a second
_DOUBTFUL = 30.0  # mean dE2000 above which a refused place is not worth mentioning
_ENOUGH = 4.5  # mean dE2000 of a chart good enough to end the search
_ALIKE = 0.5  # correlation of log luminances; a chart half in the shade still has 0.8
_SAME = 0.3  # of a patch: places whose corners are nearer than that are refined to the same one
_ROUGHEST = 0.35  # standard deviation of log luminance inside a patch, median over patches
_MOST = 3  # places of a picture that are refined, which takes a second each
_PROBE = 5  # points across a patch
_BESIDE = 0.045  # of a cell, from the middle of a gap: gaps are 0.12 to 0.16 wide
_EDGE = 0.78  # of a cell: the part that refinement makes uniform, nearly the whole patch


@dataclass(frozen=True, eq=False)
class FoundChart:
    """A chart in a frame, or a place that shows none.

    place: where it lies.
    difference: mean dE2000 to the reference after fitting a matrix and the light; inf = no colours could be fitted.
    fault: why it is no chart; "" = it is one.
    """

    place: ChartPlace
    difference: float
    fault: str = ""


def find_chart(mosaic: Mosaic, reference: DoubleArray, progress: Progress = SILENT) -> FoundChart:
    """Find the ColorChecker Classic in a shot.

    mosaic: the shot.
    reference: (24, 3), XYZ (D50), white = 1.
    progress: receives the searches.

    Places come from `lattice_corners`, at several scales, until one is accepted: its corners lie inside the frame, its grey row is
    monotone and linear, and a matrix explains its colours. Raises InputError with the reason if none is accepted, or if the chart
    is too small for the pattern's period.
    """
    picture = linear_picture(mosaic)
    sizes = [size for smaller, size in pairwise((0, *_SIZES)) if smaller < max(mosaic.shape)]
    progress.stage("looking for the chart", len(sizes))
    judged: dict[ChartPlace, FoundChart] = {}
    for size in sizes:
        for place in _likeliest(picture, reference, size):
            if any(found.fault and _near(place, before) for before, found in judged.items()):
                continue
            judged[place] = _examined(picture, refined(picture, place), reference)
            if not judged[place].fault and judged[place].difference < _ENOUGH:
                break
        progress.advance()
        if charts := [found for found in judged.values() if not found.fault]:
            best = min(charts, key=lambda found: found.difference)
            _check_size(best.place, mosaic)
            return best
    likeliest = min(judged.values(), key=lambda found: found.difference, default=None)
    why = f"; the likeliest place was refused: {likeliest.fault}" if likeliest and likeliest.difference < _DOUBTFUL else ""
    period = mosaic.pattern.period
    raise InputError(
        f"no ColorChecker was found whole inside the frame{why}. Its patches must be at least {least_pitch(period)} pixels "
        f"apart at period {period}; if the chart is there, give its corners: `corners` x,y x,y x,y x,y"
    )


def chart_at(mosaic: Mosaic, corners: Matrix, reference: DoubleArray) -> FoundChart:
    """Return the chart at given corners (see `ChartPlace`), after the same tests. Raises InputError if one of them fails."""
    place = ChartPlace(corners)
    if not place.lies_in(mosaic.shape):
        raise InputError(f"the corners {place} lie outside the frame of {mosaic.shape[1]} x {mosaic.shape[0]} pixels")
    _check_size(place, mosaic)
    found = _examined(linear_picture(mosaic), place, reference)
    if found.fault:
        raise InputError(f"at the corners {place} there is no ColorChecker: {found.fault}")
    return found


def _check_size(place: ChartPlace, mosaic: Mosaic) -> None:
    """Raise InputError if the chart is so small that its patches hold too few colour blocks."""
    needed = least_pitch(mosaic.pattern.period)
    if place.pitch < needed:
        raise InputError(
            f"the chart is too small: its patches are {place.pitch:.0f} pixels apart, and period {mosaic.pattern.period} needs "
            f"{needed}; go nearer, so that the chart is at least {needed * COLUMNS} pixels wide"
        )


def _likeliest(picture: FloatArray, reference: DoubleArray, size: int) -> list[ChartPlace]:
    """Return the `_MOST` places whose colours are most like a chart's, the likeliest first; size: see `lattice_corners`.

    A wall of tiles has hundreds that are roughly alike.
    """
    places: list[ChartPlace] = []
    for _, place in sorted(_plausible(picture, reference, size), key=lambda pair: pair[0]):
        if len(places) < _MOST and not any(_near(place, before) for before in places):
            places.append(place)
    return places


def _plausible(picture: FloatArray, reference: DoubleArray, size: int) -> Iterator[tuple[float, ChartPlace]]:
    """Yield places whose luminances and colours are roughly a chart's, either way up, with their mean dE2000."""
    wanted = np.log(reference[:, 1])
    for corners in lattice_corners(picture, size):
        slack = float(np.hypot(*(corners - np.roll(corners, 1, axis=0)).T).min()) / (2 * ROWS)  # refinement may bring them in
        try:
            place = ChartPlace(as_rows(corners))
        except InputError:  # a window whose perspective is extrapolated may turn inside out
            continue
        if not place.lies_in(picture.shape[:2], slack):
            continue
        luminance = np.log(np.maximum(patch_means(picture, place)[0].sum(axis=1), 1e-4))
        for turned, seen in ((corners, luminance), (np.roll(corners, 2, axis=0), luminance[::-1])):
            if seen.std() > 0 and np.corrcoef(seen, wanted)[0, 1] > _ALIKE:
                place = ChartPlace(as_rows(turned))
                if (difference := _difference(picture, place, reference)) <= _WORTH_REFINING:
                    yield difference, place


def _near(place: ChartPlace, other: ChartPlace) -> bool:
    return bool(np.hypot(*(np.array(place.corners) - np.array(other.corners)).T).max() < _SAME * place.pitch)


def _examined(picture: FloatArray, place: ChartPlace, reference: DoubleArray) -> FoundChart:
    """Return what a place in a picture (H, W, C), linear, shows."""
    difference, fault = _difference(picture, place, reference), ""
    means, roughness = patch_means(picture, place)
    if not place.lies_in(picture.shape[:2]):
        fault = f"its corners {place} lie outside the frame: the chart is cut off"
    elif difference > _LARGEST_DIFFERENCE:
        limit = f"at most {_LARGEST_DIFFERENCE:.0f}"
        fault = f"its colours are not a ColorChecker's (mean dE2000 {difference:.0f} after fitting, {limit})"
    elif crooked := grey_row_fault(means[18:].sum(axis=1), reference[18:, 1]):
        fault = crooked
    elif np.median(roughness) > _ROUGHEST:
        fault = "the patches are not uniform"
    return FoundChart(place, difference, fault)


def _difference(picture: FloatArray, place: ChartPlace, reference: DoubleArray) -> float:
    """Return the mean dE2000 of the patches under the best matrix and light; inf if there is no fit."""
    try:
        mean = float(fit_colour(patch_means(picture, place)[0], reference, place.cells).difference.mean())
    except (InputError, np.linalg.LinAlgError):
        return float("inf")
    return mean if np.isfinite(mean) else float("inf")


def refined(picture: FloatArray, place: ChartPlace) -> ChartPlace:
    """Return the place with its corners moved so that patches are uniform inside and the gaps as dark as possible.

    picture: (H, W, C), linear.
    """
    luminance = picture.sum(axis=-1)
    root = np.sqrt(np.maximum(luminance, 0))  # once: in every step it would cost a hundred times all else in a large frame
    best, scale = np.array(place.corners), place.pitch
    for reach in (0.12, 0.04):  # The second search has a new simplex: in eight dimensions the first may collapse too early.
        simplex = np.concatenate([np.zeros((1, 8)), reach * np.eye(8)])
        found = minimize(
            _misfit,
            np.zeros(8),
            args=(luminance, root, best, scale),
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 700, "xatol": 1e-3, "fatol": 1e-6, "adaptive": True},
        )
        best = best + found.x.reshape(4, 2) * scale
    return ChartPlace(as_rows(best))


def patch_means(picture: FloatArray, place: ChartPlace, size: float = 0.5) -> tuple[DoubleArray, DoubleArray]:
    """Return the patches' means (24, C), and the standard deviation of log luminance inside each, (24,).

    picture: (H, W, C), linear.
    size: side of the part of a cell that is used.
    """
    step = (np.arange(_PROBE) + 0.5) / _PROBE - 0.5
    across, down = (grid.ravel() * size for grid in np.meshgrid(step, step))
    x, y = place.at(place.cells[:, :1] + across, place.cells[:, 1:] + down)
    values = np.stack([_at(plane, x, y) for plane in np.moveaxis(picture, -1, 0)], axis=-1)
    luminance = np.log(np.maximum(values.sum(axis=-1), 1e-4))
    return values.mean(axis=1), luminance.std(axis=1)


def _misfit(moved: DoubleArray, luminance: FloatArray, root: FloatArray, corners: DoubleArray, scale: float) -> float:
    """Return a measure of how uneven the patches and how bright the gaps are if the corners move by `scale * moved`.

    root: see `_gap_brightness`.
    """
    try:
        place = ChartPlace(as_rows(corners + moved.reshape(4, 2) * scale))
    except InputError:
        return 1e3
    _, rough = patch_means(luminance[..., None], place, _EDGE)
    return float(np.minimum(rough, 0.5).mean()) + _gap_brightness(root, place)


def _gap_brightness(root: FloatArray, place: ChartPlace) -> float:
    """Return the mean in the gaps, in the middle and near both sides of each, over the mean of the patches.

    root: square root of luminance. With luminance itself only the bright patches would fix the grid, and the corner at black would
    be loose.
    """
    along = np.array([-0.3, -0.1, 0.1, 0.3])
    beside = np.array([-_BESIDE, 0.0, _BESIDE])
    points = []
    for lines, length, flip in ((COLUMNS, ROWS, False), (ROWS, COLUMNS, True)):
        across = (np.arange(lines + 1)[:, None] + beside).ravel()
        down = (np.arange(length)[:, None] + 0.5 + along).ravel()
        u, v = (grid.ravel() for grid in np.meshgrid(across, down))
        points.append((v, u) if flip else (u, v))
    u, v = (np.concatenate(parts) for parts in zip(*points, strict=True))
    gaps, patches = (float(_at(root, *place.at(*places)).mean()) for places in ((u, v), place.cells.T))
    return gaps / max(patches, 1e-6)


def _at(plane: FloatArray, x: DoubleArray, y: DoubleArray) -> FloatArray:
    """Return a plane's values at points in pixels, interpolated bilinearly."""
    return map_coordinates(plane, [y - 0.5, x - 0.5], order=1, mode="nearest")
