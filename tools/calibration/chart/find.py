"""Find the ColorChecker in a shot: OpenCV proposes places, which are refined and then judged by
colours and grey row.

They are sought in a quick colour picture of the mosaic, which needs no gamma, matrix or white.
"""

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from scipy.ndimage import convolve, map_coordinates
from scipy.optimize import minimize

from ....shared import ByteArray, DoubleArray, FloatArray, InputError, Mosaic
from ....shared.colorimetry import Matrix, as_rows
from ...simulation.perspective import apply_homography, homography, rectangle
from ..colour_matrix import fit_colour, grey_row_fault
from ..places import levels_of, listed_defects
from .place import COLUMNS, INNER, PATCH, ROWS, ChartPlace, least_pitch

# Searches, the likeliest first: pixels of the picture's longer side, exponent of its tone curve,
# quantile of the levels that is shown as white; `adaptiveThreshConstant` and `B0factor` of cv2.mcc.
# The last two find charts of 15 to 20 pixels per patch.
_SEARCHES = (
    (1000, 2.2, 0.99, 7, 1.25),
    (1600, 3.2, 0.95, 7, 1.25),
    (600, 2.2, 0.99, 7, 1.25),
    (2500, 3.2, 0.95, 3, 1.6),
    (3600, 3.2, 0.95, 3, 1.6),
)
# Chart units by which cv2.mcc's box exceeds the chart: its patches are 2.5 wide and 0.25 apart.
_BOX = 0.25 / 2.75 / 2
# Mean dE2000 to the reference after the fit of a matrix: charts stay below 5, before refinement
# too; walls are above 15.
_LARGEST_DIFFERENCE, _WORTH_REFINING = 8.0, 16.0
_ROUGHEST = 0.35  # standard deviation of log luminance inside a patch, median over patches
# Points across a patch; lowest and highest of them that do not count: defects, glints.
_PROBE, _EXTREMES = 5, 5
_IN_GAP = 0.045  # chart units from the middle of a gap: gaps are 0.12 to 0.16 wide
_EDGE = 0.78  # chart units: the square that refinement makes uniform, nearly the whole patch
# pixels: a hole is filled from samples at most this far away; no site of a scattered tile is
# farther from one
_REACH = 2


def find_chart(mosaic: Mosaic, reference: DoubleArray) -> ChartPlace:
    """Find the ColorChecker Classic in a shot.

    A place is accepted if its corners lie inside the frame, its grey row is monotone and linear,
    and a matrix explains its colours.

    mosaic: the shot. reference: XYZ (D50) of the patches, white = 1, (24, 3). Raises InputError
    with the reason: no place was accepted, or the chart is too small for the pattern's period.
    """
    picture, period = linear_picture(mosaic), mosaic.pattern.period
    why = ""
    for size, exponent, white, threshold, factor in _SEARCHES:
        for place in _proposed(shown_picture(picture, exponent, white), size, threshold, factor):
            turned = ChartPlace(as_rows(np.roll(place.corners, 2, axis=0)))
            poses = [(_difference(picture, pose, reference), pose) for pose in (place, turned)]
            difference, upright = min(poses, key=lambda pose: pose[0])
            if difference > _WORTH_REFINING:
                continue
            refined = refine(picture, upright)
            if not (fault := _fault(picture, refined, reference)):
                _check_size(refined, mosaic)
                return refined
            why = f"; the likeliest place was refused: {fault}"
    fault = f"no ColorChecker was found whole inside the frame{why}"
    colours = "Its colours must be those of the `chart` file, if one is given"
    apart = f"its patches be at least {least_pitch(period)} pixels apart at period {period}"
    rules = f"{colours}, its white must read about three quarters, {apart}"
    remedy = "if the chart is there, give its corners: `corners` x,y x,y x,y x,y"
    raise InputError(f"{fault}. {rules}; {remedy}")


def chart_at(mosaic: Mosaic, corners: Matrix, reference: DoubleArray) -> ChartPlace:
    """Return the place of the chart at given corners (see `ChartPlace`), after the same tests.

    Raises InputError if one of them fails.
    """
    place = ChartPlace(corners)
    _check_size(place, mosaic)
    if fault := _fault(linear_picture(mosaic), place, reference):
        raise InputError(f"at the corners {place} there is no ColorChecker: {fault}")
    return place


def _check_size(place: ChartPlace, mosaic: Mosaic) -> None:
    """Raise InputError if the chart is so small that its patches hold too few colour blocks."""
    period = mosaic.pattern.period
    if place.pitch < (needed := least_pitch(period)):
        apart = np.floor(10 * place.pitch) / 10
        far = f"its patches are {apart:g} pixels apart, and period {period} needs {needed}"
        remedy = f"go nearer, so that the chart is at least {needed * COLUMNS} pixels wide"
        raise InputError(f"the chart is too small: {far}; {remedy}")


def _proposed(shown: ByteArray, size: int, threshold: float, factor: float) -> Iterator[ChartPlace]:
    """Yield the places that cv2.mcc finds in a picture (H, W, 3), after scaling its longer side;
    see `_SEARCHES`.
    """
    import cv2

    scale = size / max(shown.shape[:2])
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    # As RGB, not BGR: only the greys differ, and of 111 drawn charts one more is found, and none is
    # 0.3 of a patch off.
    small = cv2.resize(shown, None, fx=scale, fy=scale, interpolation=method)
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)
    settings = cv2.mcc.DetectorParametersMCC()
    settings.adaptiveThreshConstant, settings.B0factor = threshold, factor
    detector.setDetectionParams(settings)
    try:
        if not detector.process(small, nc=2):
            return  # asking it for a chart would end the process
    except cv2.error:  # an assertion of OpenCV 5.0 fails on some walls of bricks
        return
    edge = (1 - PATCH) / 2
    box, patches = (rectangle(-off, -off, COLUMNS + off, ROWS + off) for off in (_BOX, -edge))
    for checker in detector.getListColorChecker():
        to_frame = homography(box, np.array(checker.getBox(), float) / scale)
        try:
            yield ChartPlace(as_rows(np.stack(apply_homography(to_frame, *patches.T), axis=1)))
        except InputError:  # not a convex quadrilateral
            continue


def _fault(picture: FloatArray, place: ChartPlace, reference: DoubleArray) -> str:
    """Return why a place in a picture (H, W, C), linear, shows no chart; "" if it does."""
    if not place.lies_in(picture.shape[:2]):
        return f"its corners {place} lie outside the frame: the chart is cut off"
    difference = _difference(picture, place, reference)
    if difference > _LARGEST_DIFFERENCE:
        error = f"mean dE2000 {difference:.0f} after fitting, at most {_LARGEST_DIFFERENCE:.0f}"
        return f"its colours are not a ColorChecker's ({error})"
    means, roughness = patch_means(picture, place)
    if fault := grey_row_fault(means[18:].sum(axis=1), reference[18:, 1]):
        return fault
    return "the patches are not uniform" if np.median(roughness) > _ROUGHEST else ""


def _difference(picture: FloatArray, place: ChartPlace, reference: DoubleArray) -> float:
    """Return the mean dE2000 of the patches under the best matrix and light; inf if there is no
    fit.
    """
    try:
        means, _ = patch_means(picture, place)
        mean = float(fit_colour(means, reference, place.centres).difference.mean())
    except (InputError, np.linalg.LinAlgError):
        return float("inf")
    return mean if np.isfinite(mean) else float("inf")


def refine(picture: FloatArray, place: ChartPlace) -> ChartPlace:
    """Return the place with its corners moved so that patches are uniform inside and the gaps as
    dark as possible.

    Corners that cv2.mcc proposes are off by up to a third of a patch.

    picture: (H, W, C), linear.
    """
    luminance = picture.sum(axis=-1)
    # Once: in every step it would cost a hundred times all else in a large frame.
    root = np.sqrt(np.maximum(luminance, 0))
    best, scale = np.array(place.corners), place.pitch

    def misfit(moved: DoubleArray) -> float:
        """Return how uneven the patches and how bright the gaps are if the best corners move by
        `scale * moved`.

        The gaps take the square root of luminance. With luminance itself only the bright patches
        would fix the grid, and the corner at black would be loose.
        """
        try:
            pose = ChartPlace(as_rows(best + moved.reshape(4, 2) * scale))
        except InputError:
            return 1e3
        _, rough = patch_means(luminance[..., None], pose, _EDGE)
        gaps, patches = (float(_at(root, *pose.at(*xy.T)).mean()) for xy in (_GAPS, pose.centres))
        return float(np.minimum(rough, 0.5).mean() + gaps / max(patches, 1e-6))

    # The second search has a new simplex: in eight dimensions the first may collapse too early.
    for reach in (0.12, 0.04):
        simplex = np.concatenate([np.zeros((1, 8)), reach * np.eye(8)])
        options: Any = {"initial_simplex": simplex, "adaptive": True, "maxfev": 700}
        options |= {"xatol": 1e-3, "fatol": 1e-6}
        minimum = minimize(misfit, np.zeros(8), method="Nelder-Mead", options=options)
        best = best + minimum.x.reshape(4, 2) * scale
    return ChartPlace(as_rows(best))


def patch_means(
    picture: FloatArray, place: ChartPlace, size: float = 0.5
) -> tuple[DoubleArray, DoubleArray]:
    """Return the patches' means without extremes, (24, C), and the standard deviation of log
    luminance inside each, (24,).

    picture: (H, W, C), linear. size: side of the square that is used, chart units.
    """
    step = (np.arange(_PROBE) + 0.5) / _PROBE - 0.5
    across, down = (grid.ravel() * size for grid in np.meshgrid(step, step))
    x, y = place.at(place.centres[:, :1] + across, place.centres[:, 1:] + down)
    values = np.stack([_at(plane, x, y) for plane in np.moveaxis(picture, -1, 0)], axis=-1)
    luminance = np.log(np.maximum(values.sum(axis=-1), 1e-4))
    kept = np.sort(values, axis=1)[:, _EXTREMES:-_EXTREMES]
    return kept.mean(axis=1).astype(np.float64), luminance.std(axis=1)


def _gap_points(lines: int, length: int) -> DoubleArray:
    """Return points in chart units (N, 2), across and along gaps: in the middle and near both sides
    of each.
    """
    across = np.arange(lines + 1)[:, None] + [-_IN_GAP, 0.0, _IN_GAP]
    along = np.arange(length)[:, None] + [0.2, 0.4, 0.6, 0.8]
    return np.array(list(product(across.ravel(), along.ravel())))


_GAPS = np.concatenate([_gap_points(COLUMNS, ROWS), _gap_points(ROWS, COLUMNS)[:, ::-1]])


def _at(plane: FloatArray, x: DoubleArray, y: DoubleArray) -> FloatArray:
    """Return a plane's values at points in pixels, interpolated bilinearly."""
    return map_coordinates(plane, [y - 0.5, x - 0.5], order=1, mode="nearest")


def linear_picture(mosaic: Mosaic) -> FloatArray:
    """Return every channel at every pixel, float32 (H, W, C), in parts of full scale.

    Where luminance was not measured it is the local mean. The chromaticity of a block is the ratio
    of its samples to luminance (gamma is not used), interpolated bilinearly.
    """
    levels, pattern = levels_of(mosaic).copy(), mosaic.pattern
    # A defect gets the level of the next sample of its kind.
    rows, columns = listed_defects(mosaic)
    step = np.where(rows < pattern.period, pattern.period, -pattern.period)
    levels[rows, columns] = levels[np.minimum(rows + step, mosaic.shape[0] - 1), columns]
    luminance = _luminance(mosaic, levels)
    grid = pattern.grid(mosaic.shape)
    rows, columns = grid.whole_rows, grid.whole_columns
    ratios = np.zeros((rows.size, columns.size, len(pattern.channels)), np.float32)
    below = np.zeros_like(ratios)
    for row, column, channel in pattern.sites:
        places = np.ix_(rows + row, columns + column)
        ratios[..., channel] += levels[places]
        below[..., channel] += luminance[places]
    ratios = np.clip(ratios / np.maximum(below, 1e-6), 0, 2)
    if pattern.derived is not None:  # in its place, luminance tells as much
        ratios[..., pattern.derived] = 1
    middle = np.array([rows[0], columns[0]]) + (np.array(grid.block_shape) - 1) / 2
    steps = (np.indices(mosaic.shape) - middle[:, None, None]) / pattern.period
    planes = np.moveaxis(ratios, -1, 0)
    filled = [map_coordinates(plane, steps, order=1, mode="nearest") for plane in planes]
    return (np.stack(filled, axis=-1) * luminance[..., None]).astype(np.float32)


def shown_picture(picture: FloatArray, exponent: float = 2.0, white: float = 0.99) -> ByteArray:
    """Return a linear picture (H, W, C) as uint8 RGB (H, W, 3), each channel stretched by itself.

    The first, middle and last channel are shown as red, green and blue.

    exponent: of the tone curve. white: quantile of a channel that is shown as white.
    """
    chosen = picture[..., [0, picture.shape[-1] // 2, -1]]
    bright = np.quantile(chosen[::4, ::4].reshape(-1, 3), white, axis=0)
    levels = np.clip(chosen / np.maximum(bright, 1e-6), 0, 1)
    return (255 * levels ** (1 / exponent)).astype(np.uint8)


def overlay(mosaic: Mosaic, place: ChartPlace) -> ByteArray:
    """Return the shot with the chart and the measured part of each patch outlined, uint8 RGB (H, W,
    3).
    """
    from PIL import Image, ImageDraw

    image = Image.fromarray(shown_picture(linear_picture(mosaic)))
    draw, width = ImageDraw.Draw(image), max(1, round(place.pitch / 40))
    quads = (place.patch_corners(PATCH), place.patch_corners(INNER), np.array([place.corners]))
    for outlines, colour in zip(quads, ("white", "magenta", "cyan"), strict=True):
        for quad in outlines:
            draw.polygon(quad.ravel().tolist(), outline=colour, width=width)
    return np.asarray(image)


def _luminance(mosaic: Mosaic, levels: FloatArray) -> FloatArray:
    """Return the panchromatic samples with the holes filled from their neighbours, weighted by
    distance.
    """
    measured = mosaic.pattern.panchromatic_mask(mosaic.shape)
    reach = _REACH if mosaic.pattern.is_scattered else max(_REACH, *mosaic.pattern.block_shape)
    steps = np.arange(-reach, reach + 1)
    kernel = (1.0 / (steps[:, None] ** 2 + steps**2 + 1.0) ** 2).astype(np.float32)
    total = convolve(np.where(measured, levels, np.float32(0)), kernel, mode="mirror")
    weight = convolve(measured.astype(np.float32), kernel, mode="mirror")
    return np.where(measured, levels, total / np.maximum(weight, 1e-6)).astype(np.float32)
