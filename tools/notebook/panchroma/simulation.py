"""Photographing scenes with a simulated camera."""

from __future__ import annotations  # help() then shows them as they are written here

from collections.abc import Sequence
from typing import Any, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from .pictures import Picture
from .shared import CfaPattern, InputError
from .shared.arrays import unmasked
from .shared.pattern import PANCHROMATIC
from .shared.reading import MAX_PIXELS, File, file_name, is_file
from .shots import Shot, with_notes_shown
from .tools.io.decoders import Decoded, decode_array
from .tools.io.picture import picture_scene
from .tools.io.scene import Scene
from .tools.simulation.lens import Lens
from .tools.simulation.load import load_scene, named_file
from .tools.simulation.pattern_text import camera_and_pattern
from .tools.simulation.protocols import chosen_protocol
from .tools.simulation.simulated_camera import SimulatedBurst, SimulatedCamera, burst_frames


class _Options(TypedDict, total=False):
    """The options of `simulate` that do not decide what it returns."""

    pattern: str | int | CfaPattern | None
    channels: str | None
    origin: tuple[int, int] | None
    sensor_bits: int | None
    sigma: float | None
    light: float | None
    rng: int | np.random.Generator | np.random.SeedSequence | None
    shading: tuple[float, float] | None
    motion: float
    bracket: Sequence[float]
    reduce: int
    bands: str | None
    linear: bool
    camera: File | None
    max_pixels: int


@overload
def simulate(
    scene: File | Picture | ArrayLike, *, burst: None = None, **options: Unpack[_Options]
) -> Shot: ...
@overload
def simulate(
    scene: File | Picture | ArrayLike, *, burst: int, **options: Unpack[_Options]
) -> list[Shot]: ...
def simulate(
    scene: File | Picture | ArrayLike,
    *,
    pattern: str | int | CfaPattern | None = None,
    channels: str | None = None,
    origin: tuple[int, int] | None = None,
    sensor_bits: int | None = None,
    sigma: float | None = None,
    light: float | None = None,
    rng: int | np.random.Generator | np.random.SeedSequence | None = 0,
    shading: tuple[float, float] | None = None,
    burst: int | None = None,
    motion: float = 0.0,
    bracket: Sequence[float] = (),
    reduce: int = 1,
    bands: str | None = None,
    linear: bool = False,
    camera: File | None = None,
    max_pixels: int = MAX_PIXELS,
) -> Shot | list[Shot]:
    """Photograph a scene with this camera. The shot keeps what it saw as its `truth`.

    Parameters
    ----------
    scene : File | Picture | ArrayLike
        A file, a camera RAW (CR2, NEF, ARW, DNG ...) or a picture (TIFF, PNG, JPEG, EXR, NPY);
        "builtin:1800x1200", leaves and charts of any size, the smaller the finer; a `Picture`, such
        as the truth of another shot; or an array (H, W, C), or (H, W) of grey: floating point is
        linear light, 1.0 = white; uint8 is sRGB; wider integers are linear light too, white is
        their largest value.
    pattern : str | int | CfaPattern | None, optional
        The filters of one tile of the sensor, row by row, W is panchromatic, such as
        "WBWG/BWGW/WGWR/GWRW"; rows may also be parted by blanks or lines. "kodak", "sony", "honda",
        "kaizu", "rccb", "rccg" and "rccc" are names of tiles. A number is the period of the paper's
        pattern, one 2 x 2 Bayer block in K x K pixels; that with 6 is the default. It can also be
        the name of a file with the letters. Letters other than R, G and B are channels that the
        scene has, or C, M and Y made from its colours.
    channels : str | None, optional
        Letters of the channels of the picture, one of which may have no filter: it is what W sees
        beyond the others. By default RGB where the filters are two of these.
    origin : tuple[int, int] | None, optional
        (row, column) of the first block; (0, 0) by default.
    sensor_bits : int | None, optional
        That the sensor delivers, 8 to 16; by default 12, or those of `camera`.
    sigma : float | None, optional
        Noise as in the paper: additive, Gaussian, of this standard deviation in scene units. By
        default there is none.
    light : float | None, optional
        Noise as in a sensor, at this amount of light (1 = a full exposure, 1/4 = two stops less):
        shot and read noise, clipping, quantisation. Give sigma or light, not both.
    rng : int | np.random.Generator | np.random.SeedSequence | None, optional
        Source of the noise and of the motion: a seed, or a generator, which goes on; None = other
        noise at every call.
    shading : tuple[float, float] | None, optional
        (2, 15) is a lens whose corners are two stops darker, with 15 % less of the first channel
        there and as much more of the last one than of panchromatic light.
    burst : int | None, optional
        Make this many frames of a hand-held series, the first of which has not moved. The result
        is then a list of shots.
    motion : float, optional
        Pixels by which the other frames are at most displaced.
    bracket : Sequence[float], optional
        Exposure of each frame in stops, such as (0, -2, 2).
    reduce : int, optional
        Make one pixel from this many of the scene, each way, after the motion.
    bands : str | None, optional
        Letters of an array's channels, in their order; by default "RGB", or those of the pattern if
        there are as many.
    linear : bool, optional
        Take the values of a picture file, or an array of integers, as linear light.
    camera : File | None, optional
        A camera.json (from `panchroma calibrate`), whose gamma, noise, levels, colours and lens it
        has.
    max_pixels : int, optional
        A larger file is refused.

    Raises
    ------
    PanchromaError
        For a scene that cannot be read, or that lacks channels of the pattern.

    Examples
    --------
    >>> import numpy as np
    >>> import panchroma
    >>> panchroma.simulate("builtin:120x90", pattern="WBWG/BWGW/WGWR/GWRW", light=1 / 4)
    <Shot builtin-120x90: 120 x 90, R, G, B in 8 of 4 x 4 pixels>
    >>> bands = np.random.default_rng(0).random((60, 60, 4), np.float32)
    >>> shot = panchroma.simulate(bands, pattern="ABWWWW CDWWWW WWWWWW WWWWWW WWWWWW WWWWWW",
    ...     sigma=0.01)
    >>> shot.truth
    <Picture 60 x 60, linear A, B, C, D>
    >>> len(panchroma.simulate("builtin:240x180", burst=3, motion=4, light=1 / 8))
    3
    """
    kind, level = chosen_protocol(sigma, light)
    protocol = kind() if level is None else kind(level)
    try:
        source = np.random.default_rng(rng)
    except (TypeError, ValueError) as error:
        expected = "a seed of 0 or more, a NumPy generator or seed sequence, or None"
        raise InputError(f"`rng` is {rng!r}, expected {expected}") from error
    series, lens = SimulatedBurst.of(burst, motion, bracket), Lens.of(shading)
    measured, tile = camera_and_pattern(camera, pattern, channels, origin)
    if measured:
        lens.check(measured.calibration, camera)
    photographed = _scene(scene, tile.channels, bands, linear, max_pixels)
    simulated = SimulatedCamera(tile, measured, protocol, bits=sensor_bits, lens=lens)
    peak = scene.white if isinstance(scene, Picture) else 1.0
    shots = []
    for frame in burst_frames(photographed.rgb, series, source, reduce):
        mosaic, seen, white = simulated.shoot(photographed, source, frame)
        truth = Picture(seen, mosaic.calibration, mosaic.metadata, white * peak)
        shots.append(with_notes_shown(Shot(mosaic, truth, photographed.name, photographed.notes)))
    return shots[0] if burst is None else shots


def _scene(source: Any, requested: str, bands: str | None, linear: bool, max_pixels: int) -> Scene:
    """The scene before a pattern with the channels `requested`."""
    if bands is not None and (isinstance(source, Picture) or is_file(source)):
        remedy = "a picture or a file has its own"
        raise InputError(f"`bands` is {bands!r}, but it names those of an array; {remedy}")
    if isinstance(source, Picture):
        light, known = np.maximum(source.rgb, 0), source.calibration  # negative light is noise
        colours = known.camera_to_xyz, known.neutral, source.metadata
        return Scene(light, "picture", *colours, channels=known.channels)
    if is_file(source):
        try:
            with named_file(source) as name:
                return load_scene(name, linear=linear, max_pixels=max_pixels, channels=requested)
        except InputError as error:
            raise type(error)(f"{file_name(source)}: {error}") from None
    try:
        array = unmasked(source)
    except InputError:
        raise
    except ValueError:  # rows of different lengths
        array = np.array(None)
    if bands is None:
        return picture_scene(decode_array(array, requested), "array", linear=linear)
    if PANCHROMATIC in bands or len({*bands}) < len(bands):
        reason = "each channel has a letter of its own, and W is what all see together"
        raise InputError(f"`bands` is {bands!r}; {reason}")
    if array.shape[2:] != (len(bands),):
        shape = f"(rows, columns, {len(bands)})"
        stated = f"`bands` is {bands!r}, but the array has shape {array.shape}"
        raise InputError(f"{stated}; expected {shape}")
    peak = np.iinfo(array.dtype).max if array.dtype.kind == "u" else None
    return picture_scene(Decoded(array, peak, channels=bands), "array", linear=linear)
