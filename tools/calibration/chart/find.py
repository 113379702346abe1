"""Find the ColorChecker in a shot, and believe it only when it behaves like one."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from shared import Mosaic
from shared.arrays import ByteArray, DoubleArray, FloatArray
from shared.errors import InputError
from shared.progress import SILENT, Progress
from tools.scenes.drawn.perspective import apply_homography, homography

from ..colour_matrix import fit_colour, grey_row_fault
from .detector import BOX_MARGIN, calmed, detect, resized
from .lattice import SIZES, lattice_corners
from .picture import displayed, linear_picture
from .place import COLUMNS, INNER, PATCH, ROWS, ChartPlace, least_pitch

# Of the detector: pieces of the frame per side, longer side of what it gets; the likeliest first.
_SEARCHES = (*((1, size) for size in (600, 850, 1200, 420, 1700, 2400)), (2, 600), (2, 1200))
_LARGEST_SCALE = 2.0  # a chart large enough for any period is seen at twice its size at the latest: more takes time alone
_MOST = 30  # candidates of one search
LARGEST_DIFFERENCE = 8.0  # mean dE2000 after the fit: real charts stay below 5, brick walls above 15
_ALIKE, _SURELY_ALIKE = 0.5, 0.9  # correlation of log luminances; half in shade a chart still has 0.8
_LEAST_INSIDE = 8  # patches of a chart that is cut off
_DOUBTFUL = 30.0  # mean dE2000 of a place that is not worth mentioning
_ENOUGH = 4.5  # a candidate as good as that ends the search
_PROBE = 5  # points across a patch when its place is refined
_BESIDE = 0.045  # of a cell: from the middle of a gap, which is 0.12 to 0.16 wide
_EDGE = 0.78  # of a cell: what refinement holds uniform, nearly the whole patch
_SAME = 0.3  # of a patch: corners nearer to those of a place that was refined and refused lead to it again
_ROUGHEST = 0.35  # standard deviation of log luminance inside a patch, median over patches: more is no chart


@dataclass(frozen=True, eq=False)
class FoundChart:
    """A chart in a frame, and how well it fits: mean dE2000 after fitting matrix and light (inf for corners by hand)."""

    place: ChartPlace
    difference: float


def find_chart(mosaic: Mosaic, reference: DoubleArray, progress: Progress = SILENT) -> FoundChart:
    """The ColorChecker Classic in a shot; reference: (24, 3) XYZ (D50).

    The detector proposes, at several scales and on parts of the frame; a proposal is accepted when its corners lie inside the
    frame, its grey row is monotone and linear, and a matrix explains its colours. Raises InputError with the reason when none is,
    or when the chart is too small for the pattern's period.
    """
    picture = linear_picture(mosaic)
    best: FoundChart | None = None
    faults: list[tuple[float, str]] = []
    judge = _Judge(picture, reference)
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
    needed = least_pitch(mosaic.pattern.period)
    if best is None:
        likeliest = min(faults, default=(np.inf, ""))
        why = f"; the likeliest place was refused: {likeliest[1]}" if likeliest[0] < _DOUBTFUL else ""
        raise InputError(
            f"no ColorChecker was found whole inside the frame{why}. Its patches must be at least {needed} pixels apart at period "
            f"{mosaic.pattern.period}; if it is there, give its corners: --corners x,y x,y x,y x,y"
        )
    check_size(best.place, mosaic)
    return best


def chart_at(mosaic: Mosaic, corners: tuple[tuple[float, float], ...], reference: DoubleArray) -> FoundChart:
    """The chart at corners given by hand, held to the same tests. Raises InputError when it fails one."""
    place = ChartPlace(corners)
    if not place.lies_in(mosaic.shape):
        raise InputError(f"the corners {_named(place)} lie outside the frame of {mosaic.shape[1]} x {mosaic.shape[0]} pixels")
    check_size(place, mosaic)
    judged = _tested(linear_picture(mosaic), place, reference)
    if not isinstance(judged, FoundChart):
        raise InputError(f"at the corners {_named(place)} there is no ColorChecker: {judged[1]}")
    return judged


def check_size(place: ChartPlace, mosaic: Mosaic) -> None:
    """Raise InputError when colour blocks are too far apart for a chart so small."""
    needed = least_pitch(mosaic.pattern.period)
    if place.pitch < needed:
        raise InputError(
            f"the chart is too small: its patches are {place.pitch:.0f} pixels apart, and period {mosaic.pattern.period} needs "
            f"{needed}; go nearer, so that the chart is at least {needed * COLUMNS} pixels wide"
        )


def patch_means(picture: FloatArray, place: ChartPlace, size: float = 0.5) -> tuple[DoubleArray, DoubleArray]:
    """Means (24, C) of a linear picture over the patches, and the standard deviation of log luminance inside each, (24,)."""
    step = (np.arange(_PROBE) + 0.5) / _PROBE - 0.5
    across, down = (grid.ravel() * size for grid in np.meshgrid(step, step))
    x, y = place.at(place.cells[:, :1] + across, place.cells[:, 1:] + down)
    inside = [map_coordinates(plane, [y - 0.5, x - 0.5], order=1, mode="nearest") for plane in np.moveaxis(picture, -1, 0)]
    values = np.stack(inside, axis=-1)
    luminance = np.log(np.maximum(values.sum(axis=-1), 1e-4))
    return values.mean(axis=1), luminance.std(axis=1)


def overlay(mosaic: Mosaic, place: ChartPlace) -> ByteArray:
    """The shot with the measured part of each patch outlined, uint8 (H, W, 3) RGB."""
    import cv2

    shown = displayed(linear_picture(mosaic)).copy()
    width = max(1, round(place.pitch / 40))
    for quad, colour in ((place.patch_corners(PATCH), (255, 255, 255)), (place.patch_corners(INNER), (255, 0, 255))):
        cv2.polylines(shown, list(np.rint(quad).astype(np.int32)), True, colour, width, cv2.LINE_AA)
    cv2.polylines(shown, [np.rint(np.array(place.corners)).astype(np.int32)], True, (0, 255, 255), width, cv2.LINE_AA)
    return shown


def _searches(picture: FloatArray) -> list[Callable[[], Iterable[DoubleArray]]]:
    """Each proposes corners of the patch area, by the detector or by lattices of blobs; the cheapest first.

    What would only enlarge the picture further is left out.
    """
    shown = displayed(picture)
    variants = (shown, calmed(shown))
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
    """What the detector sees on each of parts x parts overlapping pieces."""
    height, width = picture.shape[:2]
    found: list[DoubleArray] = []
    for down, across in product(range(2 * parts - 1), repeat=2):
        top, left = down * height // (2 * parts), across * width // (2 * parts)
        piece = picture[top : top + -(-height // parts), left : left + -(-width // parts)]
        scale = size / max(piece.shape[:2])
        corner = np.array([left, top])
        found += [_patch_area(box / scale) + corner for box in detect(resized(piece, scale), _MOST)]
    return found


def _patch_area(box: DoubleArray) -> DoubleArray:
    """The detector's box, drawn in to the outer corners of the corner patches."""
    wide, high = COLUMNS + 2 * BOX_MARGIN, ROWS + 2 * BOX_MARGIN
    try:
        to_frame = homography(np.array([(0, 0), (wide, 0), (wide, high), (0, high)], float), box)
    except np.linalg.LinAlgError:
        return box
    edge = BOX_MARGIN + (1 - PATCH) / 2
    x, y = apply_homography(
        to_frame, np.array([edge, wide - edge, wide - edge, edge]), np.array([edge, edge, high - edge, high - edge])
    )
    return np.stack([x, y], axis=-1)


class _Judge:
    """Judges proposed corners in one picture, and refines no place twice: that is what takes time."""

    def __init__(self, picture: FloatArray, reference: DoubleArray) -> None:
        self._picture, self._reference = picture, reference
        self._refused: list[tuple[DoubleArray, tuple[float, str]]] = []

    def __call__(self, corners: DoubleArray) -> FoundChart | tuple[float, str]:
        """The chart there, turned the right way and refined; or how bad it is (dE2000) and why it is refused."""
        picture, reference = self._picture, self._reference
        try:
            place = ChartPlace(tuple(map(tuple, corners.tolist())))
        except InputError as error:
            return (np.inf, str(error))
        worst: tuple[float, str] = (np.inf, "no way round shows a ColorChecker")
        for quarter in (0, 2):
            turned = place.turned(quarter)
            if not _near(turned, picture.shape[:2]):
                if _looks_alike(picture, turned, reference, partly=True):
                    worst = min(worst, (_DOUBTFUL - 1, _cut_off(turned)))
                continue
            rough = _coloured(picture, turned, reference) if _looks_alike(picture, turned, reference) else float("inf")
            if rough > 3 * LARGEST_DIFFERENCE:
                worst = min(worst, (rough, _not_its_colours(rough)))
                continue
            judged = self._refined_once(turned)
            if isinstance(judged, FoundChart):
                return judged
            worst = min(worst, judged)
        return worst

    def _refined_once(self, place: ChartPlace) -> FoundChart | tuple[float, str]:
        """The place after refinement, or why it is refused; as the time before where it was refused before."""
        corners = np.array(place.corners)
        for before, fault in self._refused:
            if np.hypot(*(corners - before).T).max() < _SAME * place.pitch:
                return fault
        judged = _tested(self._picture, _refined(self._picture, place), self._reference)
        if not isinstance(judged, FoundChart):
            self._refused.append((corners, judged))
        return judged


def _tested(picture: FloatArray, place: ChartPlace, reference: DoubleArray) -> FoundChart | tuple[float, str]:
    if not place.lies_in((picture.shape[0], picture.shape[1])):
        return (_DOUBTFUL - 1, _cut_off(place))
    means, roughness = patch_means(picture, place)
    difference = _coloured(picture, place, reference)
    if difference > LARGEST_DIFFERENCE:
        return (difference, _not_its_colours(difference))
    if fault := grey_row_fault(means[18:].sum(axis=1), reference[18:, 1]):
        return (difference, fault)
    if np.median(roughness) > _ROUGHEST:
        return (difference, "the patches are not uniform")
    return FoundChart(place, difference)


def _looks_alike(picture: FloatArray, place: ChartPlace, reference: DoubleArray, *, partly: bool = False) -> bool:
    """Whether the patches' luminances follow the reference at all: a cheap test before the colours are fitted.

    partly: of the patches inside the frame alone, and strictly, because there are fewer.
    """
    means, _ = patch_means(picture, place)
    seen, wanted = np.log(np.maximum(means.sum(axis=1), 1e-4)), np.log(reference[:, 1])
    if partly:
        x, y = place.at(place.cells[:, 0], place.cells[:, 1])
        inside = (x > 0) & (x < picture.shape[1]) & (y > 0) & (y < picture.shape[0])
        if inside.sum() < _LEAST_INSIDE:
            return False
        seen, wanted = seen[inside], wanted[inside]
    return bool(seen.std() > 0 and np.corrcoef(seen, wanted)[0, 1] > (_SURELY_ALIKE if partly else _ALIKE))


def _coloured(picture: FloatArray, place: ChartPlace, reference: DoubleArray) -> float:
    """Mean dE2000 of the patches under the best matrix and light; inf where it cannot be fitted."""
    means, _ = patch_means(picture, place)
    try:
        fit = fit_colour(means, reference, place.cells, thorough=False)
    except (InputError, np.linalg.LinAlgError):
        return float("inf")
    mean = float(fit.difference.mean())
    return mean if np.isfinite(mean) else float("inf")


def _refined(picture: FloatArray, place: ChartPlace) -> ChartPlace:
    """The corners moved so that patches are uniform inside and the gaps between them as dark as can be."""
    luminance = picture.sum(axis=-1)
    best, scale = np.array(place.corners), place.pitch
    for reach in (0.12, 0.04):  # The second search starts afresh: in eight dimensions a simplex may collapse too early.
        start = best

        def misfit(moved: DoubleArray, start: DoubleArray = start) -> float:
            return _misfit(luminance, start + moved.reshape(4, 2) * scale)

        simplex = np.concatenate([np.zeros((1, 8)), reach * np.eye(8)])
        found = minimize(
            misfit,
            np.zeros(8),
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 700, "xatol": 1e-3, "fatol": 1e-6, "adaptive": True},
        )
        best = start + found.x.reshape(4, 2) * scale
    return ChartPlace(tuple(map(tuple, best.tolist())))


def _misfit(luminance: FloatArray, corners: DoubleArray) -> float:
    """How uneven the patches and how bright the gaps are with these corners."""
    try:
        place = ChartPlace(tuple(map(tuple, corners.tolist())))
    except InputError:
        return 1e3
    _, rough = patch_means(luminance[..., None], place, _EDGE)
    return float(np.minimum(rough, 0.5).mean()) + _gap_brightness(np.sqrt(np.maximum(luminance, 0)), place)


def _gap_brightness(root: FloatArray, place: ChartPlace) -> float:
    """Mean in the gaps, in the middle and near both sides of each, over that of the patches.

    root: of luminance, or the bright patches alone would hold the grid, and the corner at black would float.
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
    gaps, patches = (
        float(map_coordinates(root, [y - 0.5, x - 0.5], order=1, mode="nearest").mean())
        for x, y in (place.at(u, v), place.at(place.cells[:, 0], place.cells[:, 1]))
    )
    return gaps / max(patches, 1e-6)


def _near(place: ChartPlace, shape: tuple[int, ...]) -> bool:
    """Whether all corners are inside the frame, or within half a patch of it: refinement may bring them in."""
    slack = place.pitch / 2
    return all(-slack <= x <= shape[1] + slack and -slack <= y <= shape[0] + slack for x, y in place.corners)


def _cut_off(place: ChartPlace) -> str:
    return f"its corners {_named(place)} lie outside the frame: the chart is cut off"


def _not_its_colours(difference: float) -> str:
    return f"its colours are not a ColorChecker's (mean dE2000 {difference:.0f} after fitting, at most {LARGEST_DIFFERENCE:.0f})"


def _named(place: ChartPlace) -> str:
    return " ".join(f"{x:.0f},{y:.0f}" for x, y in place.corners)
