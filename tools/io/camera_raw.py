"""Camera RAWs as scenes: each 2 x 2 quad of a Bayer sensor becomes one pixel with all three
colours.

This follows L. Shi and B. Funt's re-processing of Gehler's colour-checker data set, with one
departure: the red and the blue sample of a quad lie half a pixel of the scene apart, to either side
of the mean of the greens, and both are interpolated at the middle of the quad. Without it every
edge has a coloured fringe that no scene has.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import datetime
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np

from ...shared import CaptureMetadata, CodeArray, DoubleArray, FloatArray, InputError
from ...shared.colorimetry import D65_XY, Matrix, adaptation, as_rows, xyz
from ...shared.dng.exif import WANTED, metadata_from, printable
from ...shared.dng.tags import TAG, Photometric, tags_of
from ...shared.lights import LightMatrices, between, illuminant_xy, mixed, share_of
from ...shared.pattern import BAYER_ORDERS
from ...shared.tiff_reading import StoredDirectories, StoredField, StoredFields, read_directories
from ...shared.white_balance import clipped_share, normalised, shades_of_grey
from .clipped import SHOULDER, saturation, with_white_highlights
from .damage import data_bytes, guarded
from .limited import Facts, run_limited
from .scene import RGB, Scene, check_size
from .tiff import opened_tiff, tag_numbers

_DELTAS = "BlackLevelDeltaV", "BlackLevelDeltaH"
_QUARTER = 0.25  # pixels of a scene: from a sample to the middle of its quad, down and across
_OF_LIGHTS = "ColorMatrix", "CalibrationIlluminant", "CameraCalibration"
_LIGHTS = [[TAG[f"{name}{number}"] for name in _OF_LIGHTS] for number in (1, 2)]
_SIGNATURES = TAG["CameraCalibrationSignature"], TAG["ProfileCalibrationSignature"]
_WHITE_TAGS = "AnalogBalance AsShotNeutral AsShotWhiteXY ColorMatrix3"
_COLOUR_TAGS = {*chain(*_LIGHTS), *_SIGNATURES, *tags_of(_WHITE_TAGS)}
# Exif's LightSource values; all others are treated as D65.
_ILLUMINANTS: dict[float, str] = {3: "A", 17: "A", 24: "3200", 23: "D50", 11: "D75", 22: "D75"}
_ILLUMINANTS |= dict.fromkeys((1, 4, 9, 20), "D55")
_LOADED = ("rawpy",)  # before the time is counted: that takes longer than a RAW does
_SEARCHED = 1 << 20  # bytes at the beginning of a RAW that is not a TIFF
_TIFF_STARTS = (b"II*\0\x08\0\0\0", b"MM\0*\0\0\0\x08")
_EXPECTED = "CR2, NEF, ARW, DNG, ... or TIFF, PNG, JPEG, EXR, NPY"
NO_RAW = f"neither a picture nor a camera RAW {{}}; expected {_EXPECTED}"
# LibRaw's flip -> TIFF's orientation
_ORIENTATIONS = {0: 1, 1: 2, 2: 4, 3: 3, 4: 5, 5: 8, 6: 6, 7: 7}
Quads = tuple[FloatArray, FloatArray]
"""One pixel per quad, (H, W, 3), scene units; and how far each sample is clipped, alike."""


def camera_raw_scene(path: Path, max_pixels: int, *, registered: bool) -> Scene:
    """Read the scene in a Bayer RAW (CR2, CRW, NEF, ARW, DNG, ...) at half its width and height.

    The scene is neither rotated nor white-balanced. rgb is (sample - black) / (white - black) of
    the visible area, with the two greens averaged and an odd last row or column left out. There is
    one black level per colour; white is the camera's saturation level. Values below black, which
    noise causes, become 0: light is not negative. Samples above the white level exceed 1. Clipped
    samples become white (see `clipped`), and a note says so.

    Raises InputError, with the reason, for sensors without a 2 x 2 Bayer pattern and for files
    without sensor samples.

    max_pixels: larger files are refused. registered: red and blue are interpolated at the middle of
    each quad; False = as Shi and Funt leave them.
    """
    # LibRaw decodes whatever size the JPEGs inside a RAW declare: it can take minutes and all
    # memory for two kilobytes.
    samples, facts = run_limited(path, _LOADED, unpack_raw, str(path), max_pixels, True)
    rgb, gone = _quads(samples, facts, _black_deltas(path, samples.shape))
    if registered:
        rgb, gone = register_quads(rgb, gone, facts)
    return camera_scene(path, rgb, gone, facts)


def camera_raw_samples(path: Path, max_pixels: int) -> CodeArray:
    """Read the samples of the visible area of any RAW with one sample per pixel, whatever its
    filters: uint16 (H, W).

    Raises InputError, with the reason, for files without such samples.

    max_pixels: larger files are refused.
    """
    return run_limited(path, _LOADED, unpack_raw, str(path), max_pixels, False)[0]


def unpack_raw(path: str, max_pixels: int, quads: bool) -> tuple[CodeArray, Facts]:
    """Return the samples of the visible area as LibRaw reads them, uint16 (H, W); and what it knows
    of a Bayer RAW. Call it by `run_limited`.

    quads: it has to be a Bayer RAW; otherwise it may be any, and there are no facts.
    """
    import rawpy

    with rawpy.RawPy() as raw:
        with _decoding(path):
            raw.open_file(path)
            sizes = raw.sizes
        check_size(sizes.raw_width, sizes.raw_height, 2, data_bytes(path), max_pixels)
        with _decoding(path):
            raw.unpack()
        filters = bayer_filters(raw) if quads else ""
        _check_mosaic(raw, "give a file with the samples of the sensor")
        with _decoding(path):
            samples, facts = np.array(raw.raw_image_visible), Facts()
            if filters:
                taken, blacks = raw.other.timestamp, raw.black_level_per_channel
                facts = {
                    "filters": filters,
                    "blacks": [float(blacks[index]) for index in raw.raw_pattern.flat],
                    # Not camera_white_level_per_channel: some makers set it below samples that are
                    # still linear, and relative to another black.
                    "white": float(raw.white_level),
                    "balance": np.array(raw.camera_whitebalance[:3], np.float64).tolist(),
                    # LibRaw has a table of cameras
                    "matrix": np.array(raw.rgb_xyz_matrix[:3], np.float64).tolist(),
                    "flip": int(raw.sizes.flip),
                    "lens": str(raw.lens.model or ""),
                    "artist": str(raw.other.artist or ""),
                    "taken": taken.isoformat() if taken and taken.year > 1970 else "",
                    "f_number": float(raw.other.aperture),
                    "iso": round(raw.other.iso_speed),
                    "focal_length": float(raw.other.focal_length),
                    "exposure_time": float(raw.other.shutter_speed),
                }
            return samples, facts


@contextmanager
def _decoding(path: str) -> Iterator[None]:
    """A `guarded` block for LibRaw, which tells files that it does not know from damaged ones."""
    import rawpy

    try:
        with guarded(path):
            yield
    except InputError as error:
        if not isinstance(error.__cause__, rawpy.LibRawFileUnsupportedError | rawpy.LibRawIOError):
            raise
        raise InputError(NO_RAW.format("that LibRaw knows, or cut short")) from error.__cause__


def _black_deltas(path: Path, shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Return by how much black of each row, (H, 1), and column, (1, W), of the mosaic of a DNG
    differs from the level that LibRaw knows, which is their mean (BlackLevelDeltaV, -H); 0 where
    the file does not say it.
    """
    deltas = [np.zeros((size, 1), np.float32) for size in shape]
    if path.suffix.lower() == ".dng":
        with opened_tiff(path, tags_of(" ".join(_DELTAS))) as (_, file, _), guarded():
            pages = (file.pages.first, *(file.pages.first.pages or ()))
            for page, axis in product(pages, (0, 1)):
                stated = tag_numbers(page, _DELTAS[axis])
                fits = stated.size == shape[axis] and np.isfinite(stated).all()
                if fits and page.photometric == Photometric.CFA:
                    deltas[axis][:, 0] = stated - stated.mean()
    return deltas[0], deltas[1].T


def _quads(samples: CodeArray, facts: Facts, deltas: tuple[FloatArray, FloatArray]) -> Quads:
    """Return the samples of a RAW, one pixel per quad: (H // 2, W // 2, 3), scene units; and how
    far each is clipped.

    samples, facts: see `unpack_raw`. deltas: see `_black_deltas`.
    """
    rows, columns = (size // 2 for size in samples.shape)
    if not rows or not columns:
        area = f"{samples.shape[1]} x {samples.shape[0]} pixels"
        raise InputError(f"the visible area is {area}: no 2 x 2 quad fits")
    blacks, white = facts["blacks"], facts["white"]
    if not max(blacks) < white:
        levels = f"black level {max(blacks):g} is not below white level {white:g}"
        raise InputError(f"{levels}: the file's levels are damaged")
    rgb: FloatArray = np.zeros((rows, columns, 3), np.float32)
    gone = np.zeros_like(rgb)
    for index, letter in enumerate(facts["filters"]):
        (row, column), black, channel = divmod(index, 2), blacks[index], RGB.index(letter)
        codes = samples[row : 2 * rows : 2, column : 2 * columns : 2]
        limit = saturation(codes, white, black)
        of_rows, of_columns = deltas[0][row::2][:rows], deltas[1][:, column::2][:, :columns]
        signal = (codes - np.float32(black) - of_rows - of_columns) / np.float32(white - black)
        rgb[..., channel] += signal
        # One of two greens may be clipped: then so is their mean.
        weight = clipped_share(signal, (limit - black) / (white - black), SHOULDER)
        np.maximum(gone[..., channel], weight, out=gone[..., channel])
    rgb[..., 1] /= 2
    return np.maximum(rgb, 0, out=rgb), gone


def register_quads(rgb: FloatArray, gone: FloatArray, facts: Facts) -> Quads:
    """Return the light of quads, (H, W, 3), with red and blue at the middle of each quad; and how
    far each is clipped.

    Cubic splines, between 0 and the brightest sample. The samples at row and column 0 of a quad lie
    a quarter of a pixel above and left of its middle, those at 1 below and right of it.

    rgb, gone: see `_quads`. facts: see `unpack_raw`.
    """
    from scipy.ndimage import shift  # takes longer to load than all of ours

    registered, clipped = rgb.copy(), gone.copy()
    for index, letter in enumerate(facts["filters"]):
        if letter != "G":
            channel = RGB.index(letter)
            move = [_QUARTER if step else -_QUARTER for step in divmod(index, 2)]
            moved, top = shift(rgb[..., channel], move, mode="mirror"), rgb[..., channel].max()
            np.clip(moved, 0, top, out=registered[..., channel])
            clipped[..., channel] = shift(gone[..., channel], move, order=1, mode="mirror")
    return registered, clipped


def bayer_filters(raw: Any) -> str:
    """Return the letters of the filters of the first visible quad, by rows.

    Raises InputError that says what the sensor has instead.
    """
    no_quads = "a scene needs 2 x 2 Bayer quads; take another file"
    _check_mosaic(raw, no_quads)
    try:
        pattern = raw.raw_pattern
    except NotImplementedError:
        pattern = None
    if pattern is None or raw.num_colors < 3:
        raise InputError(f"the RAW is monochrome, or its filters are irregular: {no_quads}")
    letters = raw.color_desc.decode("ascii", "replace")
    filters = "".join(letters[index] for index in pattern.ravel().tolist())
    if pattern.shape != (2, 2) or filters not in BAYER_ORDERS:
        size = f"{pattern.shape[1]} x {pattern.shape[0]} pixels"
        raise InputError(f"the filters are {filters}, in {size}: {no_quads}")
    return filters


def _check_mosaic(raw: Any, remedy: str) -> None:
    import rawpy

    if raw.raw_type != rawpy.RawType.Flat or raw.raw_image is None:
        several = "several samples per pixel (Foveon, sRAW)"
        raise InputError(f"the RAW holds {several}, not a mosaic: {remedy}")


def camera_scene(path: Path, rgb: FloatArray, gone: FloatArray | None, facts: Facts) -> Scene:
    """Return the scene that a camera recorded.

    Parameters
    ----------
    path : Path
        The file, which has colour matrices and capture data. Without a neutral it is estimated from
        the scene, and a note says so.
    rgb : FloatArray
        Camera RGB, (H, W, 3), scene units.
    gone : FloatArray | None
        How far each sample is clipped (see `with_white_highlights`); None = none is.
    facts : Facts
        What LibRaw knows of it, see `unpack_raw`; empty = nothing.
    """
    directories = raw_directories(path)
    metadata, fields = metadata_from(directories), directories.main
    if facts:
        metadata = _completed(metadata, facts, fields)
    as_shot = _as_shot(fields, facts) or _neutral_under(fields)
    neutral, notes = as_shot or shades_of_grey(rgb), list[str]()
    if not as_shot:
        estimate = "the scene is too dark or too bright to estimate one"
        if neutral:
            figures = ", ".join(f"{value:.3f}" for value in neutral)
            estimate = f"neutral {figures} is estimated from the scene"
        notes.append(f"the file has no white balance: {estimate}")
    matrix = colour_matrix(fields, neutral, facts.get("matrix")) if neutral else None
    if matrix is None:
        effect = "colours can be balanced, but not matched"
        notes.append(f"the camera's colour matrix is unknown: {effect}")
    if TAG["ColorMatrix3"] in fields:
        notes.append("not used: the colour matrix for a third light")
    if gone is not None:
        rgb, clipped = with_white_highlights(rgb, neutral, gone)
        notes += clipped
    is_estimated = not as_shot and neutral is not None
    return Scene(rgb, path.stem, matrix, neutral, metadata, tuple(notes), is_estimated)


def _as_shot(fields: StoredFields, facts: Facts) -> tuple[float, ...] | None:
    """Return the neutral of the camera's white balance, or the one that a DNG states; None if the
    file states none.
    """
    stated = np.array(facts["balance"] if facts else _numbers(fields, TAG["AsShotNeutral"]))
    if stated.shape != (3,) or not np.isfinite(stated).all() or stated.min() <= 0:
        return None
    # Equal factors mean that the file has no white balance (no sensor is white-balanced by itself),
    # or a photographer's "UniWB".
    if facts and np.ptp(stated) == 0:
        return None
    return normalised(1 / stated if facts else stated)


def colour_matrix(tags: StoredFields, neutral: tuple[float, ...], fallback: Any) -> Matrix | None:
    """Return the matrix from camera RGB to XYZ (D50 white) under the light of the shot, which takes
    `neutral` to D50: from a DNG's ColorMatrix, or else `fallback` (3, 3), for D65; None without
    one.

    With matrices for two lights it is the one for the light of the neutral, see `between`. What
    this camera reads of what its model reads is a factor (DNG 1.7.1, chapter 6).

    With a matrix for one light DNG 1.7.1 maps camera RGB to XYZ by ForwardMatrix diag(1 / neutral).
    A ColorMatrix M implies a ForwardMatrix: under its illuminant w the camera's neutral is n = M w,
    so F = Bradford(w -> D50) M^-1 diag(n), and F (1, 1, 1) = D50. Balancing in camera RGB also
    works far from w, where M^-1 neutral may not even be a real colour. Raises
    numpy.linalg.LinAlgError for a singular matrix.

    neutral: (3,), what white reads in camera RGB under the light of the shot; largest entry 1.
    """
    lights, own = _calibrated(tags)
    if len(lights) == 2 and (found := between(lights, neutral, own)):
        return found
    if not lights and (matrix := _usable(fallback)) is not None:
        lights, own = [(D65_XY, matrix)], [np.eye(3)]
    if not lights:
        return None
    nearest = min(range(len(lights)), key=lambda index: abs(lights[index][0][0] - D65_XY[0]))
    white, to_camera = xyz(*lights[nearest][0]), own[nearest] @ lights[nearest][1]
    forward = adaptation(white) @ np.linalg.inv(to_camera) @ np.diag(to_camera @ white)
    return as_rows(forward / np.array(neutral))


def _calibrated(tags: StoredFields) -> tuple[LightMatrices, list[DoubleArray]]:
    """Return the chromaticity of each light, two at most, and DNG's ColorMatrix for it; and for
    each AnalogBalance times CameraCalibration.
    """
    lights, own = dict[tuple[float, float], DoubleArray](), list[DoubleArray]()
    names = {tags.get(tag, StoredField(0)).data.rstrip(b"\0") for tag in _SIGNATURES}
    gains = _usable(np.diag(_numbers(tags, TAG["AnalogBalance"])))
    gains = np.eye(3) if gains is None else gains
    for matrix_tag, light_tag, own_tag in _LIGHTS:
        xy = illuminant_xy(_ILLUMINANTS.get((*_numbers(tags, light_tag), 0)[0], "D65"))
        matrix, factor = (_usable(_numbers(tags, tag)) for tag in (matrix_tag, own_tag))
        if matrix is not None and xy not in lights:
            lights[xy] = matrix
            # one for another profile than the file's is none
            own.append(gains if factor is None or len(names) > 1 else gains @ factor)
    return list(lights.items()), own


def _neutral_under(tags: StoredFields) -> tuple[float, ...] | None:
    """Return the reading of a DNG's AsShotWhiteXY, which may stand for a neutral; None without."""
    lights, own = _calibrated(tags)
    xy = _numbers(tags, TAG["AsShotWhiteXY"])
    if not (lights and len(xy) == 2 and min(xy) > 0 and sum(xy) < 1):
        return None
    share = share_of(xy, lights) if len(lights) == 2 else 0
    reading = mixed(lights, share, own) @ xyz(*xy)
    return normalised(reading) if reading.min() > 0 else None


def _usable(values: Any) -> DoubleArray | None:
    """Return a ColorMatrix, (3, 3); None if it is none, or says nothing."""
    figures = np.array(values, np.float64)
    matrix = figures.reshape(3, 3) if figures.size == 9 else np.eye(3)
    # DNG requires a matrix: programs that do not know the camera write a unit matrix.
    says_something = np.isfinite(matrix).all() and not np.allclose(matrix, np.eye(3))
    return matrix if says_something and np.linalg.matrix_rank(matrix) == 3 else None


def _numbers(tags: StoredFields, tag: int) -> tuple[float, ...]:
    return tags.get(tag, StoredField(0)).numbers


def raw_directories(path: Path) -> StoredDirectories:
    """Return the capture data and colour matrices of a camera RAW, as fields.

    Most RAWs are based on TIFF. Others begin with a preview or a box that holds a whole TIFF
    structure (RAF, RW2, MRW, CR3).
    """
    with path.open("rb") as file:
        directories = read_directories(file, WANTED | _COLOUR_TAGS)
        if directories.main or directories.exif:
            return directories
        file.seek(0)
        start = file.read(_SEARCHED)
        places = [place for mark in _TIFF_STARTS if (place := start.find(mark)) >= 0]
        return read_directories(file, WANTED, min(places)) if places else directories


def _completed(metadata: CaptureMetadata, facts: Facts, fields: StoredFields) -> CaptureMetadata:
    """Return the capture data in the fields of a file, and for what they lack what LibRaw read."""
    # LibRaw knows lenses from makers' notes. Its other fields are used only without Exif: it turns
    # odd fields into odd numbers.
    values: dict[str, Any] = {"lens": metadata.lens or printable(facts["lens"])}
    if not fields:
        known = "iso", "f_number", "focal_length", "exposure_time"
        values |= {name: facts[name] for name in known} | {"artist": printable(facts["artist"])}
        values["taken"] = datetime.fromisoformat(facts["taken"]) if facts["taken"] else None
    for name, value in values.items():
        if value:
            with suppress(InputError, TypeError):
                metadata = replace(metadata, **{name: value})
    # LibRaw knows makers' notes on it, but takes 0 for 8, and a preview's before that of a DNG.
    stated = _numbers(fields, TAG["Orientation"])
    if not stated or (stated == (1,) and TAG["UniqueCameraModel"] not in fields):
        metadata = replace(metadata, orientation=_ORIENTATIONS.get(facts["flip"], 1))
    return metadata
