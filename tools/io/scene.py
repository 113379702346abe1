"""The scene: the light that falls on a simulated sensor."""

from dataclasses import dataclass, field

import numpy as np

from ...shared import CaptureMetadata, FloatArray, InputError
from ...shared.reading import MAX_PIXELS

RGB = "RGB"
BROADBAND = {"C": "GB", "M": "RB", "Y": "RG"}
"""Transmission of cyan, magenta and yellow filters for red, green and blue."""
# decoded bytes per byte of file: photographs stay below 50, decompression bombs reach 1000 and more
MAX_EXPANSION = 200
# Pixels that are believed, of 8 bytes at most: even light and drawn charts are pictures, and
# compress as well as bombs. So many take less than a second and 300 MB.
_BELIEVED, _BELIEVED_BYTES = 12_000_000, 8
DARKEST = -1e-3  # of the brightest value: rounding and resampling may go this far below zero


@dataclass(frozen=True, eq=False)
class Scene:
    """The light of a scene, as a camera that measures all colours at every pixel would record it.
    Checked when made.

    Raises InputError if rgb has another shape, is empty, is not finite, or is clearly negative.

    Attributes
    ----------
    rgb : FloatArray
        float32 (H, W, N), linear light in scene units: 1.0 = the white level of the source. 0 or
        more, may exceed 1. Most scenes have N = 3, camera RGB. Read-only. Small negative values,
        from rounding, become 0.
    name : str
        For the names of output files.
    camera_to_xyz : tuple[tuple[float, ...], ...] | None
        (3, N), rgb to CIE XYZ (D50 white) under the light of the shot; it takes neutral to white.
        None = unknown.
    neutral : tuple[float, ...] | None
        (N,), what a white surface reads under the light of the shot, at most 1; None = unknown.
    metadata : CaptureMetadata
        Capture data.
    notes : tuple[str, ...]
        Remarks for the user on how the file was interpreted.
    neutral_estimated : bool
        The neutral is an estimate from the scene, because the file states none.
    channels : str
        The N letters of the channels, in the order of rgb.
    eight_bits : bool
        It was read from a picture of 8 bits, which somebody has developed.
    """

    rgb: FloatArray
    name: str
    camera_to_xyz: tuple[tuple[float, ...], ...] | None = None
    neutral: tuple[float, ...] | None = None
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)
    notes: tuple[str, ...] = ()
    neutral_estimated: bool = False
    channels: str = RGB
    eight_bits: bool = False

    def __post_init__(self) -> None:
        rgb = np.ascontiguousarray(self.rgb, np.float32)
        if rgb.ndim != 3 or rgb.shape[2] != len(self.channels) or rgb.size == 0:
            array = f"an array (rows, columns, {len(self.channels)})"
            raise InputError(f"a scene is {array}; this one has shape {np.shape(self.rgb)}")
        lowest, highest = float(rgb.min()), float(rgb.max())
        if not (np.isfinite(lowest) and np.isfinite(highest)):  # min and max propagate NaN
            counted = f"{int((~np.isfinite(rgb)).sum())} of {rgb.size} values"
            reason = "are not finite (NaN or infinite); replace them before simulating"
            raise InputError(f"{counted} {reason}")
        if lowest < min(0.0, DARKEST * highest):
            fault = f"the lowest value is {lowest:.4g}, but light is not negative"
            other = "clip the picture at 0 if it is sharpened, or has colours outside its space"
            raise InputError(f"{fault}. Subtract the black level correctly, or {other}")
        if lowest < 0:
            rgb = np.maximum(rgb, 0)
        rgb = rgb.view()
        rgb.flags.writeable = False
        object.__setattr__(self, "rgb", rgb)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rgb.shape[0], self.rgb.shape[1]


def scene_channels(channels: str) -> str:
    """The channels of a scene from which filters with these letters are made.

    Examples
    --------
    >>> scene_channels("CMYN"), scene_channels("VGN")
    ('RGBN', 'VGN')
    """
    if not set(channels) & set(BROADBAND):
        return channels
    return RGB + "".join(letter for letter in channels if letter not in (*RGB, *BROADBAND))


def check_size(
    width: int, height: int, pixel_bytes: int = 0, file_bytes: int = 0, max_pixels: int = MAX_PIXELS
) -> None:
    """Raise InputError if the declared size of a picture is empty, too large, or that of a
    decompression bomb.

    Parameters
    ----------
    width, height : int
        Pixels.
    pixel_bytes : int, optional
        Decoded bytes of a pixel.
    file_bytes : int, optional
        Length of the file; 0 = do not compare it with the decoded size.
    max_pixels : int, optional
        The limit for width * height.
    """
    if width < 1 or height < 1:
        raise InputError(f"the picture is {width} x {height} pixels: it is empty")
    if width * height > max_pixels:
        limit = f"the limit of {max_pixels}; `max_pixels` raises it"
        raise InputError(f"{width} x {height} pixels are more than {limit}")
    decoded = width * height * pixel_bytes
    believed = width * height <= _BELIEVED and decoded <= _BELIEVED * _BELIEVED_BYTES
    if file_bytes and not believed and decoded > MAX_EXPANSION * file_bytes:
        claimed = f"{width} x {height} pixels ({decoded // 2**20} MB)"
        reason = "the file is damaged, or made to fill the memory"
        remedy = "if it is a picture, save it without compression"
        raise InputError(f"{file_bytes} bytes claim to hold {claimed}: {reason}; {remedy}")
