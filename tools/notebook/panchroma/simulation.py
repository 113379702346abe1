"""Photographing scenes with a simulated camera."""

from __future__ import annotations  # help() then shows them as they are written here

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .pictures import Picture
from .shared import CfaPattern, read_camera
from .shared.errors import InputError
from .shared.reading import MAX_PIXELS
from .shots import Shot, with_notes_shown
from .tools.io.decoded import Decoded
from .tools.io.decoders import decode_array
from .tools.io.picture import picture_scene
from .tools.io.scene import Scene
from .tools.simulation.lens import Lens
from .tools.simulation.load import load_scene
from .tools.simulation.protocols import chosen_protocol
from .tools.simulation.simulated_camera import SimulatedCamera


def simulate(
    scene: str | Path | Picture | ArrayLike,
    *,
    pattern: str | int | CfaPattern | None = None,
    sigma: float | None = None,
    light: float | None = None,
    bits: int | None = None,
    seed: int = 0,
    channels: str | None = None,
    linear: bool = False,
    camera: str | Path | None = None,
    shading: tuple[float, float] | None = None,
    max_pixels: int = MAX_PIXELS,
) -> Shot:
    """Photograph a scene with this camera. The shot keeps what it saw as its `truth`.

    Parameters
    ----------
    scene : str | Path | Picture | ArrayLike
        One of the name of a file: a camera RAW (CR2, NEF, ARW, DNG ...), or a picture (TIFF, PNG,
        JPEG, EXR, NPY), "builtin:1800x1200", leaves and charts of any size, the smaller the finer,
        an array (H, W, C), or (H, W) of grey: floating point is linear light, 1.0 = white; uint8 is
        sRGB; wider integers are linear light too, white is their largest value, a `Picture`, such
        as the truth of another shot.
    pattern : str | int | CfaPattern | None, optional
        The filters of one tile of the sensor, row by row, W is panchromatic, such as
        "WBWG/BWGW/WGWR/GWRW"; rows may also be parted by blanks or lines. "kodak", "sony", "honda",
        "kaizu", "rccb", "rccg" and "rccc" are names of tiles. A number is the period of the paper's
        pattern, one 2 x 2 Bayer block in K x K pixels; that with 6 is the default. Letters other
        than R, G and B are channels that the scene has, or C, M and Y made from its colours.
    sigma : float | None, optional
        Noise as in the paper: additive, Gaussian, of this standard deviation in scene units. By
        default there is none.
    light : float | None, optional
        Noise as in a sensor, at this amount of light (1 = a full exposure, 1/4 = two stops less):
        shot and read noise, clipping, quantisation. Give sigma or light, not both.
    bits : int | None, optional
        Of a sample, 8 to 16; 12 by default.
    seed : int, optional
        Of the noise.
    channels : str | None, optional
        Letters of an array's channels, in their order; by default "RGB", or those of the pattern if
        there are as many.
    linear : bool, optional
        Take the values of a picture file, or an array of integers, as linear light.
    camera : str | Path | None, optional
        A camera.json (from `panchroma calibrate`), whose gamma, noise, levels, colours and lens it
        has.
    shading : tuple[float, float] | None, optional
        (2, 15) is a lens whose corners are two stops darker, with 15 % less of the first channel
        there and as much more of the last one than of panchromatic light.
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
    """
    kind, level = chosen_protocol(sigma, light)
    protocol = kind() if level is None else kind(level)
    if seed < 0:
        raise InputError(f"`seed` is {seed}, expected 0 or more")
    measured = None if camera is None else read_camera(camera)
    lens = Lens.of(shading)
    tile = _pattern(measured.pattern if measured and pattern is None else pattern)
    if measured:
        measured.check_pattern(tile)
        lens.check(measured.calibration, camera)
    photographed = _scene(scene, tile.channels, channels, linear, max_pixels)
    simulated = SimulatedCamera.of(tile, measured, protocol, bits=bits, lens=lens)
    exposed = simulated.shoot(photographed, np.random.default_rng(seed))
    white = exposed.white * (scene.white if isinstance(scene, Picture) else 1.0)
    truth = Picture(exposed.truth, exposed.mosaic.calibration, photographed.metadata, white)
    return with_notes_shown(Shot(exposed.mosaic, truth, photographed.name, exposed.notes))


def _pattern(pattern: str | int | CfaPattern | None) -> CfaPattern:
    if isinstance(pattern, CfaPattern):
        return pattern
    if pattern is None:
        return CfaPattern.bayer()
    return CfaPattern.of_letters(pattern if isinstance(pattern, str) else f"K={pattern}")


def _scene(
    source: Any, requested: str, channels: str | None, linear: bool, max_pixels: int
) -> Scene:
    """The scene before a pattern with the channels `requested`."""
    if channels is not None and isinstance(source, Picture | str | Path):
        remedy = "a picture or a file has its own"
        raise InputError(f"`channels` is {channels!r}, but it names those of an array; {remedy}")
    if isinstance(source, Picture):
        light, known = np.maximum(source.rgb, 0), source.calibration  # negative light is noise
        colours = known.camera_to_xyz, known.neutral, source.metadata
        return Scene(light, "picture", *colours, channels=known.channels)
    if isinstance(source, str | Path):
        try:
            return load_scene(str(source), linear=linear, max_pixels=max_pixels, channels=requested)
        except InputError as error:
            raise type(error)(f"{source}: {error}") from None
    try:
        array = np.asarray(source)
    except ValueError:  # rows of different lengths
        array = np.array(None)
    if channels is not None and array.shape[2:] != (len(channels),):
        shape = f"(rows, columns, {len(channels)})"
        stated = f"`channels` is {channels!r}, but the array has shape {array.shape}"
        raise InputError(f"{stated}; expected {shape}")
    if channels is None:
        decoded = decode_array(array, requested)
    else:
        peak = np.iinfo(array.dtype).max if array.dtype.kind == "u" else None
        decoded = Decoded(array, peak, channels=channels)
    return picture_scene(decoded, "array", linear=linear)
