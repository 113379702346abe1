"""Output of picture decoders, and what decoders share: errors, names of channels, transparency."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...shared import CaptureMetadata, InputError
from ...shared.tiff_reading import StoredField, read_directories
from .encoding import ADOBE_RGB, SRGB, Encoding
from .scene import RGB, scene_channels

_MOST_SAMPLES = 4  # of a picture: RGB and transparency
MOST_PAGES = 26
"""Pages of a file that are taken together: one more than a pattern has channels."""
_COLOR_SPACE, _INTEROPERABILITY_INDEX = 40961, 1  # Exif tags


@dataclass(frozen=True, eq=False)
class Decoded:
    """A decoded picture, its values as stored in the file.

    Attributes
    ----------
    pixels : NDArray[Any]
        (H, W, C), C = 1 for a grey picture, otherwise one for each channel.
    peak : int | None
        The integer that stands for 1.0; None for floating point.
    encoding : Encoding | None
        How the file says its values are encoded; None if it does not say.
    metadata : CaptureMetadata
        Capture data.
    notes : Sequence[str]
        Remarks for the user, such as what was left out.
    channels : str
        Letters of the channels; a grey picture has them all alike.
    """

    pixels: NDArray[Any]
    peak: int | None
    encoding: Encoding | None = None
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)
    notes: Sequence[str] = ()
    channels: str = RGB


class PictureFormat(NamedTuple):
    """A format of picture files.

    Attributes
    ----------
    name : str
        For people.
    start : bytes
        Pattern (`re`) of the first bytes.
    endings : tuple[str, ...]
        Of the names of its files, the usual one first.
    decode : Callable[[Path, int, str], Decoded]
        (file, limit of pixels, channels of the pattern that will see it) -> picture.
    """

    name: str
    start: bytes
    endings: tuple[str, ...]
    decode: Callable[[Path, int, str], Decoded]


def channels_of(
    count: int, requested: str, notes: list[str], *, declared: bool = False, pages: int = 1
) -> str:
    """Return which channels `count` samples per pixel without names are: `requested`, or "" for a
    grey or RGB picture.

    Raises InputError when there are more samples than a picture has, or one that is neither a
    colour nor declared to be transparency, and another number than `requested`.

    Parameters
    ----------
    notes : list[str]
        Gets remarks for the user.
    declared : bool, optional
        They are declared to be red, green and blue, or one of them to be transparency.
    pages : int, optional
        That they come from.
    """
    stacked = f"{pages} pages" if pages > 1 else f"{count} channels"
    of_rgb = count == len(RGB) and set(scene_channels(requested)) <= set(RGB)
    known = declared or of_rgb
    if count == len(requested) and not known:
        order = f"{', '.join(requested)}, in this order"
        notes.append(f"its {stacked} have no names: they are taken as linear light of {order}")
        return requested
    if count > 1 and (count > _MOST_SAMPLES or not known or (pages > 1 and not of_rgb)):
        pattern = f"the pattern the {len(requested)} channels {requested}"
        raise InputError(
            f"has {stacked}, and {pattern}; a scene has as many channels as the pattern "
            "(`pattern`), or red, green and blue: leave others out (array[..., :3]), declare "
            "transparency (ExtraSamples of a TIFF), or in Python name those of an array with bands"
        )
    return ""


def without_alpha(pixels: NDArray[Any], notes: list[str]) -> NDArray[Any]:
    """Return (H, W) or (H, W, 1 to 4) without a transparency channel, (H, W, 1 or 3).

    notes: gets a remark for the user.
    """
    pixels = np.atleast_3d(pixels)
    if pixels.shape[2] in (1, 3):
        return pixels
    notes.append("transparency is left out")
    return pixels[..., :-1]


def exif_encoding(exif: IO[bytes], notes: list[str]) -> Encoding | None:
    """Return the encoding that a block of Exif declares; None without one.

    ColorSpace is 1 for sRGB and 65535 for any other space (CIPA DC-008, 4.6.6). Of those, cameras
    have Adobe RGB, and mark it by the interoperability index R03 (DCF 2.0, CIPA DC-009); some write
    2 for it.

    notes: gets a remark for the user.
    """
    stored = read_directories(exif, {_COLOR_SPACE, _INTEROPERABILITY_INDEX})
    space = stored.exif.get(_COLOR_SPACE, StoredField(0)).numbers[:1]
    option = stored.interoperability.get(_INTEROPERABILITY_INDEX, StoredField(0)).data[:3]
    if space == (1,):
        return SRGB
    if space == (2,) or option == b"R03":
        return ADOBE_RGB
    if space and option != b"R98":
        unnamed = "the colours are not those of sRGB, and not which they are"
        notes.append(f"Exif says that {unnamed}; sRGB's are assumed")
    return None


def remark_on_unused(names: Iterable[str], notes: list[str]) -> None:
    """Add one remark for the user on what a file has besides, and is not used, to its notes."""
    if listed := ", ".join(names):
        notes.append(f"not used: {listed}")
