"""Find the ColorChecker in a shot: search for places that may show one, and judge each."""

from collections.abc import Callable, Iterable
from functools import partial
from itertools import product

import numpy as np

from shared import Mosaic
from shared.arrays import ByteArray, DoubleArray, FloatArray
from shared.colorimetry import Matrix
from shared.errors import InputError
from shared.perspective import apply_homography, homography, rectangle
from shared.progress import SILENT, Progress

from .detector import BOX_MARGIN, detect, median_filtered, resized
from .judge import FoundChart, Judge, examine
from .lattice import SIZES, lattice_corners
from .picture import displayed, linear_picture
from .place import COLUMNS, PATCH, ROWS, ChartPlace, least_pitch

# Searches with the detector, the likeliest first: pieces of the frame per side, longer side in pixels of what it gets.
_SEARCHES = (*((1, size) for size in (600, 850, 1200, 420, 1700, 2400)), (2, 600), (2, 1200))
_LARGEST_SCALE = 2.0  # further enlargement finds no more charts that are large enough, and takes time
_MOST = 30  # candidates per search
_DOUBTFUL = 30.0  # mean dE2000 above which a refused place is not worth mentioning
_ENOUGH = 4.5  # mean dE2000 of a candidate good enough to end the search


def find_chart(mosaic: Mosaic, reference: DoubleArray, progress: Progress = SILENT) -> FoundChart:
    """Find the ColorChecker Classic in a shot.

    mosaic: the shot.
    reference: (24, 3), XYZ (D50), white = 1.
    progress: receives the searches.

    Candidates come from OpenCV's detector and from `lattice_corners`, at several scales and on parts of the frame. A candidate is
    accepted if its corners lie inside the frame, its grey row is monotone and linear, and a matrix explains its colours. Raises
    InputError with the reason if none is accepted, or if the chart is too small for the pattern's period.
    """
    picture = linear_picture(mosaic)
    best: FoundChart | None = None
    faults: list[tuple[float, str]] = []
    judge = Judge(picture, reference)
    searches = _searches(picture)
    progress.stage("looking for the chart", len(searches))
    for search in searches:
        for corners in search():
            judged = judge(corners)
            if isinstance(judged, FoundChart):
                best = judged if best is None or judged.difference < best.difference else best
                if best.difference < _ENOUGH:
                    break
            else:
                faults.append(judged)
        progress.advance()
        if best:
            break
    if best is None:
        difference, fault = min(faults, default=(np.inf, ""))
        why = f"; the likeliest place was refused: {fault}" if difference < _DOUBTFUL else ""
        period = mosaic.pattern.period
        raise InputError(
            f"no ColorChecker was found whole inside the frame{why}. Its patches must be at least {least_pitch(period)} pixels "
            f"apart at period {period}; if the chart is there, give its corners: `corners` x,y x,y x,y x,y"
        )
    _check_size(best.place, mosaic)
    return best


def chart_at(mosaic: Mosaic, corners: Matrix, reference: DoubleArray) -> FoundChart:
    """Return the chart at given corners (see `ChartPlace`), after the same tests. Raises InputError if one of them fails."""
    place = ChartPlace(corners)
    if not place.lies_in(mosaic.shape):
        raise InputError(f"the corners {place} lie outside the frame of {mosaic.shape[1]} x {mosaic.shape[0]} pixels")
    _check_size(place, mosaic)
    judged = examine(linear_picture(mosaic), place, reference)
    if not isinstance(judged, FoundChart):
        raise InputError(f"at the corners {place} there is no ColorChecker: {judged[1]}")
    return judged


def _check_size(place: ChartPlace, mosaic: Mosaic) -> None:
    """Raise InputError if the chart is so small that its patches hold too few colour blocks."""
    needed = least_pitch(mosaic.pattern.period)
    if place.pitch < needed:
        raise InputError(
            f"the chart is too small: its patches are {place.pitch:.0f} pixels apart, and period {mosaic.pattern.period} needs "
            f"{needed}; go nearer, so that the chart is at least {needed * COLUMNS} pixels wide"
        )


def _searches(picture: FloatArray) -> list[Callable[[], Iterable[DoubleArray]]]:
    """Return functions that propose corners of the patch area, by the detector or from lattices; the cheapest first.

    Searches that would only enlarge the picture further are left out.
    """
    shown = displayed(picture)
    variants = (shown, median_filtered(shown))
    longest = max(picture.shape[:2])
    sizes = [size for smaller, size in zip((0, *SIZES), SIZES, strict=False) if smaller < longest]
    searches: list[Callable[[], Iterable[DoubleArray]]] = []
    for number, (parts, size) in enumerate(_SEARCHES):
        if size * parts <= _LARGEST_SCALE * longest:
            searches += [partial(_detected, variant, parts, size) for variant in variants]
        if number % 2 == 0 and sizes:
            searches.append(partial(lattice_corners, picture, sizes.pop(0)))
    return searches


def _detected(picture: ByteArray, parts: int, size: int) -> list[DoubleArray]:
    """Return the detector's proposals on each of the overlapping pieces, `parts` per side; `size`: longer side of a piece."""
    height, width = picture.shape[:2]
    found: list[DoubleArray] = []
    for down, across in product(range(2 * parts - 1), repeat=2):
        top, left = down * height // (2 * parts), across * width // (2 * parts)
        piece = picture[top : top + -(-height // parts), left : left + -(-width // parts)]
        scale = size / max(piece.shape[:2])
        found += [_patch_area(box / scale) + np.array([left, top]) for box in detect(resized(piece, scale), _MOST)]
    return found


def _patch_area(box: DoubleArray) -> DoubleArray:
    """Return the outer corners of the corner patches, (4, 2), in the detector's box (4, 2)."""
    wide, high = COLUMNS + 2 * BOX_MARGIN, ROWS + 2 * BOX_MARGIN
    try:
        to_frame = homography(rectangle(0, 0, wide, high), box)
    except np.linalg.LinAlgError:
        return box
    edge = BOX_MARGIN + (1 - PATCH) / 2
    return np.stack(apply_homography(to_frame, *rectangle(edge, edge, wide - edge, high - edge).T), axis=-1)
