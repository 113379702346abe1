"""A rendering -> a picture file: which formats hold which numbers, in which colours, and what goes along with them.

A picture is for looking at, or a measurement. Pictures (spaces "srgb", "display-p3", "linear-srgb") are turned upright and carry
the space's ICC profile. Measurements ("camera") are the scene units of the rendering, unclipped where the format can, turned like
the sensor, so that one can be subtracted from another; the orientation is noted where the format has a place for it. Capture data
go into every format that has one.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from shared import CaptureMetadata, SensorCalibration
from shared.arrays import FloatArray
from shared.colorimetry import D65_XY
from shared.display import SPACES, ColourTransform, check_exposure, checked_picture
from shared.dng import encode_picture_dng
from shared.errors import InputError
from shared.tiff import encode_tiff
from shared.writing import OnComplete, write_durably

from .encoders import LONGEST_JPEG_SIDE, encode_exr, encode_jpeg, encode_npy, encode_png, encode_tiff_picture
from .exif_writing import jpeg_directory, picture_directory, software
from .icc_writing import icc_profile
from .samples import quantise, upright

CAMERA = "camera"

# Format -> spaces -> bits; whatever a caller leaves open is the first that fits. Integers hold 0..1 only, so they are for spaces
# that end there; JPEG, PNG and integer TIFF are shown without a thought, so linear light in them would be shown too dark.
POSSIBLE: dict[str, dict[str, tuple[int, ...]]] = {
    "tif": {"srgb": (16, 8), "display-p3": (16, 8), "linear-srgb": (32,), CAMERA: (32,)},
    "png": {"srgb": (8, 16), "display-p3": (8, 16)},
    "jpg": {"srgb": (8,), "display-p3": (8,)},
    "dng": {CAMERA: (16,)},
    "exr": {"linear-srgb": (16, 32), CAMERA: (32, 16)},
    "npy": {CAMERA: (32,), "srgb": (32,), "display-p3": (32,), "linear-srgb": (32,)},
}


@dataclass(frozen=True)
class PictureKind:
    """One of the kinds of picture file in `POSSIBLE`; raises InputError that names the possible ones for any other.

    bits: 8 or 16 = integers (of "exr": half floats), 32 = floating point. space: a name in `SPACES`, or "camera".
    """

    format: str
    bits: int
    space: str

    def __post_init__(self) -> None:
        spaces = _spaces(self.format)
        if self.space not in spaces:
            raise InputError(f"{self.format} does not hold the space {self.space!r}; it holds {_listed(self.format)}")
        if self.bits not in spaces[self.space]:
            raise InputError(f"{self.format} does not hold {self.space} with {self.bits} bits; it holds {_listed(self.format)}")

    @classmethod
    def of(cls, format: str = "tif", bits: int | None = None, space: str | None = None) -> "PictureKind":  # noqa: A002
        """The kind with what is None filled in: the first space with these bits, the first bits of this space."""
        for candidate, possible in _spaces(format).items():
            if space in (None, candidate) and bits in (None, *possible):
                return cls(format, bits or possible[0], candidate)
        if space is None:
            raise InputError(f"{format} does not hold {bits} bits; it holds {_listed(format)}")
        return cls(format, bits or 0, space)  # says what is wrong with it

    @property
    def suffix(self) -> str:
        """Of the file's name, with the dot."""
        return f".{self.format}"


def check_gain(kind: PictureKind, exposure: float) -> None:
    """Raise InputError unless such a picture can be made with `exposure` stops of gain."""
    if kind.space != CAMERA:
        check_exposure(exposure)
    elif exposure != 0:
        raise InputError(
            f"an exposure of {exposure:g} stops with --space camera, which is the scene as measured; choose another space"
        )


def check_output(kind: PictureKind, calibration: SensorCalibration, shape: tuple[int, int], exposure: float = 0.0) -> None:
    """Raise InputError when a rendering of `shape` (rows, columns) cannot become such a file: before the work, not after it."""
    check_gain(kind, exposure)
    if kind.space != CAMERA:
        ColourTransform.to_space(calibration, kind.space)
    if kind.format == "dng":
        if len(calibration.channels) != 3:
            raise InputError(f"dng holds pictures of 3 channels, the sensor has {calibration.channels}; use tif, exr or npy")
        ColourTransform.to_space(calibration)
    if kind.format in ("dng", "jpg") and max(shape) > LONGEST_JPEG_SIDE:
        raise InputError(f"{shape[1]} x {shape[0]} pixels: a side of a {kind.format} holds at most {LONGEST_JPEG_SIDE}; use tif")


def write_picture(
    path: Path | str,
    rgb: FloatArray,
    kind: PictureKind,
    *,
    calibration: SensorCalibration,
    metadata: CaptureMetadata,
    exposure: float = 0.0,
    overwrite: bool = False,
    on_complete: OnComplete | None = None,
) -> None:
    """Encode as `encode_picture` does, and write it whole or not at all; raises also what `write_durably` raises."""
    data = encode_picture(rgb, kind, calibration=calibration, metadata=metadata, exposure=exposure)
    write_durably(path, data, overwrite=overwrite, on_complete=on_complete)


def encode_picture(
    rgb: FloatArray, kind: PictureKind, *, calibration: SensorCalibration, metadata: CaptureMetadata, exposure: float = 0.0
) -> bytes:
    """The file of a rendering.

    rgb: (H, W, C) floating-point scene units, C the calibration's channels, as `offline.render` makes it; any size from 1 x 1.
    exposure: stops of gain; 0 for "camera".
    Raises InputError for what is no such picture, and as `check_output` does.
    """
    rgb = checked_picture(rgb, len(calibration.channels))
    check_output(kind, calibration, (rgb.shape[0], rgb.shape[1]), exposure)
    if kind.format == "dng":
        return _encode_dng(rgb, calibration, metadata)
    if kind.space == CAMERA:
        pixels, channels, icc = rgb, calibration.channels, b""
    else:
        pixels = ColourTransform.to_space(calibration, kind.space).apply(upright(rgb, metadata.orientation), exposure)
        channels, icc, metadata = "RGB", icc_profile(kind.space), replace(metadata, orientation=1)
    match kind.format:
        case "tif":
            samples = pixels if kind.bits == 32 else quantise(pixels, kind.bits)
            return encode_tiff_picture(
                samples, picture_directory(metadata, srgb=kind.space == "srgb"), icc=icc, rgb=channels == "RGB"
            )
        case "png":
            exif = encode_tiff(picture_directory(metadata, srgb=kind.space == "srgb"))
            return encode_png(quantise(pixels, kind.bits), title=SPACES[kind.space].title, icc=icc, exif=exif)
        case "jpg":
            exif = encode_tiff(jpeg_directory(metadata, pixels.shape, srgb=kind.space == "srgb"))
            return encode_jpeg(quantise(pixels, 8).astype(np.uint8, copy=False), icc=icc, exif=exif)
        case "exr":
            return encode_exr(pixels, channels, kind.bits, _exr_attributes(metadata, kind.space))
    return encode_npy(pixels)


def _encode_dng(rgb: FloatArray, calibration: SensorCalibration, metadata: CaptureMetadata) -> bytes:
    """A raw file with the colours and the white of our own rendering.

    Code 65535 is 1.0 in all files: brightness does not depend on a picture's brightest spot, and a raw developer finds clipped
    highlights where it looks for them, at the white level, and makes them white.
    """
    shown = ColourTransform.to_space(calibration)
    preview = quantise(shown.apply(rgb), 8).astype(np.uint8, copy=False)
    camera_to_xyz = shown.space.to_xyz @ np.array(shown.matrix)
    return encode_picture_dng(rgb, metadata, camera_to_xyz, shown.white, preview, white=1.0)


def _exr_attributes(metadata: CaptureMetadata, space: str) -> dict[str, Any]:
    """Capture data as OpenEXR's standard optional attributes, and chromaticities where they are known."""
    attributes: dict[str, Any] = {
        "cameraMake": metadata.make,
        "cameraModel": metadata.model,
        "lensModel": metadata.lens,
        "owner": metadata.artist,
        "comments": metadata.description,
        "capDate": metadata.taken and metadata.taken.strftime("%Y:%m:%d %H:%M:%S"),
        "expTime": metadata.exposure_time,
        "aperture": metadata.f_number,
        "isoSpeed": metadata.iso and float(metadata.iso),
        "nominalFocalLength": metadata.focal_length,
    }
    known = {name: value for name, value in attributes.items() if value}
    known["software"] = software()
    if space in SPACES:
        known["chromaticities"] = tuple(value for point in (*SPACES[space].primaries, D65_XY) for value in point)
    else:
        known["Orientation"] = metadata.orientation  # no standard name; OpenImageIO reads this one
    return known


def _spaces(name: str) -> dict[str, tuple[int, ...]]:
    if name not in POSSIBLE:
        raise InputError(f"unknown picture format {name!r}; there are {', '.join(POSSIBLE)}")
    return POSSIBLE[name]


def _listed(name: str) -> str:
    return ", ".join(f"{space} with {' or '.join(map(str, sorted(bits)))} bits" for space, bits in POSSIBLE[name].items())
