"""Decoded pictures as scenes: which values are linear light already, and which must be
converted.
"""

import re
from dataclasses import replace

import numpy as np

from ...shared import FloatArray, InputError
from ...shared.colorimetry import among, as_rows
from ...shared.white_balance import shades_of_grey
from .clipped import with_white_highlights
from .decoders import Decoded
from .encoding import LINEAR, SRGB, Encoding, through_tables
from .scene import RGB, Scene

# Gehler's colour-checker photographs as L. Shi and B. Funt publish them, the source of the paper's
# scenes: 16-bit PNGs that hold 12-bit samples as the camera wrote them, one pixel for each 2 x 2
# quad of the Bayer sensor. Name of files, black level, camera.
_GEHLERS = ((r"IMG_\d{4}", 129, "Canon 5D"), (r"8D5U\d{4}", 0, "Canon 1D"))
_GEHLERS_WHITE = 4095  # 12 bits
_USUAL_BITS = (8, 10, 12, 14, 16)  # of samples that are stored in wider words


def picture_scene(picture: Decoded, name: str, *, linear: bool = False) -> Scene:
    """Return the scene in a decoded picture; a grey picture gives r = g = b.

    Samples of other channels are linear light. For red, green and blue the first of these rules
    that applies decides:
      1. linear=True: linear light, whatever the file says.
      2. Floating point (scene units): linear light. A profile only gives the primaries.
      3. The file declares an encoding (ICC profile; PNG's cICP, sRGB and gAMA; TIFF's
         TransferFunction; Exif): its curve is undone.
      4. 8 bits: sRGB (IEC 61966-2-1).
      5. More bits: linear light, as cameras and raw developers write it for measurements; a note
         says so.
    Integers are divided by their peak; a note says so if they may have fewer bits than the words
    that hold them.
    Raises InputError for integers wider than 32 bits, and for whatever `Scene` refuses.
    """
    pixels, notes = picture.pixels, [*picture.notes]
    encoding = _encoding(picture, linear, notes)
    if pixels.dtype.kind == "f":
        with np.errstate(over="ignore"):  # `Scene` refuses infinite values
            rgb = pixels.astype(np.float32)
        highest = float(rgb.max(initial=0))
        if 1 < highest < np.inf:
            effect = "1.0 is white, sensors clip the rest; scale it if that is not intended"
            notes.append(f"the brightest value is {highest:.4g}: {effect}")
    elif pixels.dtype.kind == "u" and picture.peak and pixels.dtype.itemsize <= 4:
        if encoding.profile:
            rgb = through_tables(pixels, picture.peak, encoding.profile)
        else:
            rgb = _linearised(picture, picture.peak, encoding)
        _remark_on_bits(int(pixels.max(initial=0)), picture.peak, notes)
    else:
        expected = "expected unsigned integers of 8 to 32 bits or floating point"
        raise InputError(f"the samples are {pixels.dtype}; {expected}")
    channels = picture.channels
    if rgb.shape[2] == 1:
        rgb = np.repeat(rgb, len(channels), axis=2)
    # Red, green and blue among other channels, which have no known colour.
    matrix = as_rows(among(encoding.to_xyz, channels)) if set(RGB) <= set(channels) else None
    known = matrix, (1.0,) * len(channels), picture.metadata, tuple(notes)
    return Scene(rgb, name, *known, channels=channels, eight_bits=(picture.peak or 256) < 256)


def gehler_shi_scene(picture: Decoded, stem: str) -> Scene | None:
    """Return the scene in a picture of Gehler's data set, or None for any other: file name and
    12-bit samples identify it.

    rgb is (code - black) / (white - black); values below black, which noise causes, become 0.
    """
    codes = picture.pixels
    if codes.dtype != np.uint16 or codes.shape[2] != 3 or codes.max() > _GEHLERS_WHITE:
        return None
    for name, black, camera in _GEHLERS:
        if re.fullmatch(name, stem):
            signal = (codes.astype(np.float32) - black) / np.float32(_GEHLERS_WHITE - black)
            rgb, source = np.maximum(signal, 0), f"{camera}, black level {black}"
            note = f"recognised as Gehler's data set in Shi and Funt's version: {source}"
            neutral = shades_of_grey(rgb)
            rgb, clipped = with_white_highlights(rgb, neutral)
            notes = *picture.notes, note, *clipped
            return Scene(rgb, stem, None, neutral, picture.metadata, notes)
    return None


def _encoding(picture: Decoded, linear: bool, notes: list[str]) -> Encoding:
    """Return the encoding by which a picture's values become light, see `picture_scene`. notes:
    gets remarks for the user.
    """
    declared, floating = picture.encoding, picture.pixels.dtype.kind == "f"
    if not floating and picture.channels != RGB:
        return replace(LINEAR, curves=LINEAR.curves[:1] * len(picture.channels))
    assumed = LINEAR if linear or floating or (picture.peak or 0) > 255 else SRGB
    if declared and declared.curves and not (linear or floating):
        return declared
    if linear or floating:
        if declared and not declared.linear:
            why = "floating point is" if floating and not linear else "as requested, the values are"
            notes.append(f"{why} taken as linear light, although the file says {declared.name}")
    elif assumed is LINEAR:
        primaries = "the file's" if declared else "sRGB"
        taken = f"taken as linear light with {primaries} primaries, white balanced"
        notes.append(f"nothing says how the values are encoded: {taken}")
    return replace(assumed, to_xyz=declared.to_xyz) if declared else assumed


def _linearised(picture: Decoded, peak: int, encoding: Encoding) -> FloatArray:
    """Convert integers to linear light; curves of up to 16 bits are applied as tables."""
    pixels = picture.pixels
    if pixels.max() > peak:
        declared = f"but the file declares {peak} as its largest value"
        raise InputError(f"a sample is {pixels.max()}, {declared}")
    linear: FloatArray = np.empty(pixels.shape, np.float32)
    for channel in range(pixels.shape[2]):
        curve, plane = encoding.curves[channel], pixels[..., channel]
        if peak <= 65535:
            linear[..., channel] = curve(np.arange(peak + 1) / peak).astype(np.float32)[plane]
        else:
            linear[..., channel] = curve(plane / peak)
    return linear


def _remark_on_bits(highest: int, peak: int, notes: list[str]) -> None:
    """Add a remark to the notes if samples of a usual number of bits lie at the lower end of wider
    words.

    highest: of the samples.
    peak: the integer that stands for 1.0.
    """
    bits = next((bits for bits in _USUAL_BITS if highest < 1 << bits), 64)
    times = (peak + 1) >> bits
    if highest and times >= 4:
        dark = f"if the samples have {bits} bits, the scene is {times} times too dark"
        remedy = f"multiply them by {times}, and save the picture again"
        notes.append(f"no sample is above {highest}, of {peak}: {dark}; {remedy}")
