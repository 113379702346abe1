"""Write a rendering as a picture file: the possible formats, bits and colour spaces, and the data written with the pixels.

A file is either a picture to look at or a measurement. Pictures (spaces "srgb", "display-p3", "linear-srgb") are turned upright and
carry the space's ICC profile. Measurements ("camera") are the scene units of the rendering, unclipped if the format allows it, and
keep the sensor's orientation, so that one can be subtracted from another; the orientation is noted if the format has a field for
it. Capture data are written to every format that has fields for them.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared import CaptureMetadata, SensorCalibration
from shared.arrays import ByteArray, FloatArray
from shared.colorimetry import D65_XY
from shared.display import SPACES, ColourTransform, check_exposure, checked_picture
from shared.dng import PART, EncodedPart, encode_part, join_parts
from shared.dng.exif_reading import altitude, place
from shared.dng.tags import LONGEST_SIDE
from shared.errors import InputError
from shared.spelling import meant
from shared.tiff import Directory, encode_tiff
from shared.writing import OnComplete, write_durably
from tools.host.ahead import ahead

from .encoders import check_quality, encode_exr, encode_jpeg, encode_npy, encode_png, encode_tiff_picture, regrouped
from .exif_writing import jpeg_directory, picture_directory, software
from .gain_map import GainMap
from .icc_writing import icc_profile
from .jpegxl import check_jpegxl, encode_jpegxl
from .samples import quantise, upright
from .ultra_hdr import encode_ultra_hdr_bands

CAMERA = "camera"

# Format -> spaces -> bits; the first that fits is the default. Integers hold only 0..1, so they are for spaces with these limits.
# Programs show JPEG, PNG and integer TIFF as they are, so linear light in them would look too dark.
POSSIBLE: dict[str, dict[str, tuple[int, ...]]] = {
    "tif": {"srgb": (16, 8), "display-p3": (16, 8), "linear-srgb": (32,), CAMERA: (32,)},
    "png": {"srgb": (8, 16), "display-p3": (8, 16)},
    "jpg": {"srgb": (8,), "display-p3": (8,)},
    "jxl": {"srgb": (16, 8), "display-p3": (16, 8), "linear-srgb": (32,)},
    "uhdr": {"srgb": (8,), "display-p3": (8,)},
    "dng": {CAMERA: (16,)},
    "exr": {"linear-srgb": (16, 32), CAMERA: (32, 16)},
    "npy": {CAMERA: (32,), "srgb": (32,), "display-p3": (32,), "linear-srgb": (32,)},
}
OTHER_NAMES = {"tiff": "tif", "jpeg": "jpg"}
"""What else the formats are called: name -> key of `POSSIBLE`, which is also the ending of the file's name, but of "uhdr"."""
QUALITIES = ("jpg", "jxl", "uhdr")
"""The formats that have a quality."""


@dataclass(frozen=True)
class PictureKind:
    """A kind of picture file; one of those in `POSSIBLE`.

    format: a key of `POSSIBLE`.
    bits: 8 or 16 = integers (in "exr" half floats), 32 = floating point.
    space: a key of `SPACES`, or "camera".
    quality: of one of `QUALITIES`, 1 to 100; None = the usual one.

    Raises InputError for any other kind, and names the possible ones.
    """

    format: str
    bits: int
    space: str
    quality: int | None = None

    def __post_init__(self) -> None:
        check_quality(self.quality)
        if self.quality is not None and self.format not in QUALITIES:
            raise InputError(
                f"the quality is {self.quality}, but {self.format} is not compressed with loss; use {', '.join(QUALITIES)}"
            )
        if self.format == "jxl":
            check_jpegxl()
        spaces = _spaces(self.format)
        if self.space not in spaces:
            raise InputError(f"{self.format} does not hold the space {self.space!r}; it holds {_listed(self.format)}")
        if self.bits not in spaces[self.space]:
            raise InputError(f"{self.format} does not hold {self.space} with {self.bits} bits; it holds {_listed(self.format)}")

    @classmethod
    def of(
        cls,
        format: str = "tif",  # noqa: A002
        bits: int | None = None,
        space: str | None = None,
        quality: int | None = None,
    ) -> "PictureKind":
        """Return the kind with None filled in: the first space that has these bits, the first bits of this space."""
        for candidate, possible in _spaces(format).items():
            if space in (None, candidate) and bits in (None, *possible):
                return cls(format, bits or possible[0], candidate, quality)
        if space is None:
            raise InputError(f"{format} does not hold {bits} bits; it holds {_listed(format)}")
        return cls(format, bits or 0, space)  # raises InputError with the reason

    @property
    def has_white_balance(self) -> bool:
        """Whether pictures are balanced, or (a linear DNG) state how to: all but measurements in scene units."""
        return self.space != CAMERA or self.format == "dng"

    def shown(self, rgb: FloatArray, lost: ByteArray | None, calibration: SensorCalibration) -> FloatArray:
        """A rendering or some rows of it as pictures of this kind show it: white where light is lost (`Rendering.lost`).

        rgb: (H, W, C), scene units; linear pictures and measurements keep it.
        """
        if lost is None or self.space == CAMERA:
            return rgb
        return ColourTransform.to_space(calibration, self.space).whitened(rgb, lost)

    @property
    def suffix(self) -> str:
        """The file name's ending, with the dot."""
        return ".jpg" if self.format == "uhdr" else f".{self.format}"


def check_gain(kind: PictureKind, exposure: float) -> None:
    """Raise InputError if a picture of this kind cannot have a gain of `exposure` stops."""
    if kind.space != CAMERA:
        check_exposure(exposure)
    elif exposure != 0:
        raise InputError(
            f'an exposure of {exposure:g} stops with `space="camera"`, which is the scene as measured; choose another space'
        )


def check_output(kind: PictureKind, calibration: SensorCalibration, shape: tuple[int, int], exposure: float = 0.0) -> None:
    """Raise InputError if a rendering of `shape` (rows, columns) cannot become such a file. Call it before rendering."""
    check_gain(kind, exposure)
    if kind.space != CAMERA:
        ColourTransform.to_space(calibration, kind.space)
    if kind.format == "dng":
        if len(calibration.channels) != 3:
            raise InputError(f"dng holds pictures of 3 channels, the sensor has {calibration.channels}; use tif, exr or npy")
        ColourTransform.to_space(calibration)
    if kind.format in ("dng", "jpg", "uhdr") and max(shape) > LONGEST_SIDE:
        raise InputError(f"{shape[1]} x {shape[0]} pixels: a side of a {kind.format} holds at most {LONGEST_SIDE}; use tif")


def write_picture(
    path: Path | str,
    rgb: FloatArray,
    kind: PictureKind,
    *,
    calibration: SensorCalibration,
    metadata: CaptureMetadata,
    exposure: float = 0.0,
    restored: bool = True,
    overwrite: bool = False,
    on_complete: OnComplete | None = None,
) -> None:
    """Encode a rendering (see `encode_picture`) and write it atomically (see `write_durably`, also for `on_complete`)."""
    data = encode_picture(rgb, kind, calibration=calibration, metadata=metadata, exposure=exposure, restored=restored)
    write_durably(path, data, overwrite=overwrite, on_complete=on_complete)


def encode_picture(
    rgb: FloatArray,
    kind: PictureKind,
    *,
    calibration: SensorCalibration,
    metadata: CaptureMetadata,
    exposure: float = 0.0,
    restored: bool = True,
) -> bytes:
    """Return a rendering as the content of a picture file.

    rgb: (H, W, C), floating point, scene units, C the calibration's channels, from `offline.render`; any size from 1 x 1.
    kind: format, bits and space of the file.
    calibration: of the sensor; it gives the colours.
    metadata: capture data; its orientation turns pictures upright.
    exposure: gain in stops; 0 for "camera".
    restored: see `ColourTransform.to_space`.

    Raises InputError if rgb is not such a picture, and as `check_output` does.
    """
    rgb = checked_picture(rgb, len(calibration.channels))
    check_output(kind, calibration, (rgb.shape[0], rgb.shape[1]), exposure)
    if kind.format == "dng":
        return encode_tiff(linear_dng([rgb], (rgb.shape[0], rgb.shape[1]), calibration, metadata, restored=restored))
    channels, icc, metadata, turn = labels(kind, calibration, metadata)
    samples = to_samples(upright(rgb, turn), kind, calibration, exposure, restored=restored)
    srgb = kind.space == "srgb"
    match kind.format:
        case "tif":
            return encode_tiff_picture(samples, picture_directory(metadata, srgb=srgb), icc=icc, rgb=channels == "RGB")
        case "png":
            exif = encode_tiff(picture_directory(metadata, srgb=srgb))
            return encode_png(samples, title=SPACES[kind.space].title, icc=icc, exif=exif)
        case "jpg":
            return encode_jpeg(
                samples, icc=icc, exif=encode_tiff(jpeg_directory(metadata, samples.shape, srgb=srgb)), quality=kind.quality
            )
        case "uhdr":
            exif = encode_tiff(jpeg_directory(metadata, samples.shape, srgb=srgb))
            gains = GainMap(ColourTransform.to_space(calibration, kind.space, restored=restored), exposure)
            whole = samples.shape[0], samples.shape[1]
            return encode_ultra_hdr_bands([samples], whole, gains=gains, icc=icc, exif=exif, quality=kind.quality)
        case "jxl":
            exif = encode_tiff(picture_directory(metadata, srgb=srgb))
            return encode_jpegxl(samples, kind.space, exif=exif, quality=kind.quality)
        case "exr":
            return encode_exr(samples, channels, kind.bits, _exr_attributes(metadata, kind.space))
    return encode_npy(samples)


def written_shape(kind: PictureKind, shape: tuple[int, int], metadata: CaptureMetadata) -> tuple[int, int]:
    """Return (rows, columns) of the file that a rendering of `shape` becomes: pictures are turned upright."""
    turned = kind.space != CAMERA and metadata.orientation >= 5
    return shape[::-1] if turned else shape


def labels(kind: PictureKind, calibration: SensorCalibration, metadata: CaptureMetadata) -> tuple[str, bytes, CaptureMetadata, int]:
    """Return the letters of a file's channels, its ICC profile, its capture data, and the orientation to turn the picture by."""
    if kind.space == CAMERA:
        return calibration.channels, b"", metadata, 1
    return "RGB", icc_profile(kind.space), replace(metadata, orientation=1), metadata.orientation


def to_samples(
    rgb: FloatArray, kind: PictureKind, calibration: SensorCalibration, exposure: float, *, restored: bool
) -> NDArray[Any]:
    """Convert a rendering or some rows of it, (H, W, C) scene units, to the samples of the file: uint8, uint16 or float32.

    exposure, restored: see `encode_picture`. Those of "uhdr" are four: the picture's, and the codes of their gains.
    """
    floating = kind.bits == 32 or kind.format == "exr"
    if kind.space == CAMERA:
        return rgb if floating else quantise(rgb, kind.bits)
    shown = ColourTransform.to_space(calibration, kind.space, restored=restored)
    if floating:
        return shown.apply(rgb, exposure)
    codes = display_codes(rgb, shown, kind.bits, exposure)
    if kind.format == "uhdr":
        return np.dstack([codes, GainMap(shown, exposure).codes(rgb, codes)])
    return codes


def display_codes(rgb: FloatArray, shown: ColourTransform, bits: int, exposure: float = 0.0) -> NDArray[Any]:
    """`quantise(shown.apply(rgb, exposure), bits)`, by a few rows at a time that stay in the processor's cache."""
    codes = np.empty((*rgb.shape[:2], 3), np.uint8 if bits == 8 else np.uint16)
    for rows, channel, plane in shown.planes(rgb, exposure):
        codes[rows, :, channel] = quantise(plane, bits)
    return codes


def linear_dng(
    bands: Iterable[FloatArray],
    shape: tuple[int, int],
    calibration: SensorCalibration,
    metadata: CaptureMetadata,
    threads: int = 1,
    *,
    restored: bool,
) -> Directory:
    """Return a linear DNG, to be written as a TIFF, with the colours and the white of our own rendering.

    Code 65535 stands for 1.0 in all files: the brightness does not depend on the picture's brightest spot, and raw developers find
    clipped highlights at the white level and make them white.

    bands: (rows, W, 3) scene units, any number of rows each. shape: (H, W) of the whole picture.
    threads: number of threads that compress.
    restored: see `ColourTransform.to_space`; otherwise what is saturated gets the white level in every channel.
    """
    shown = ColourTransform.to_space(calibration, restored=restored)
    camera_to_xyz = shown.space.to_xyz @ np.array(shown.matrix)

    def encode(rgb: FloatArray) -> EncodedPart:
        rgb = shown.whitened(rgb, shown.saturated(rgb))
        return encode_part(rgb, display_codes(rgb, shown, 8), shape)

    parts = list(ahead(encode, regrouped(bands, PART), threads))
    return join_parts(parts, shape, metadata, camera_to_xyz, shown.white)


def _exr_attributes(metadata: CaptureMetadata, space: str) -> dict[str, Any]:
    """Return the capture data as OpenEXR's standard optional attributes, and the chromaticities if they are known."""
    attributes: dict[str, Any] = {
        "cameraMake": metadata.make,
        "cameraModel": metadata.model,
        "lensModel": metadata.lens,
        "owner": metadata.artist,
        "copyright": metadata.copyright,
        "comments": metadata.description,
        "capDate": metadata.taken and metadata.taken.strftime("%Y:%m:%d %H:%M:%S"),
        "expTime": metadata.exposure_time,
        "aperture": metadata.f_number,
        "isoSpeed": metadata.iso and float(metadata.iso),
        "nominalFocalLength": metadata.focal_length,
    }
    known = {name: value for name, value in attributes.items() if value}
    if where := place(metadata):
        known |= {"latitude": where[0], "longitude": where[1]}
    if (height := altitude(metadata)) is not None:
        known["altitude"] = height
    known["software"] = software()
    if space in SPACES:
        known["chromaticities"] = tuple(value for point in (*SPACES[space].primaries, D65_XY) for value in point)
    else:
        known["Orientation"] = metadata.orientation  # not a standard name, but OpenImageIO reads it
    return known


def _spaces(name: str) -> dict[str, tuple[int, ...]]:
    if name not in POSSIBLE:
        raise InputError(f"unknown picture format {name!r}; there are {', '.join(POSSIBLE)}{meant(name, POSSIBLE)}")
    return POSSIBLE[name]


def _listed(name: str) -> str:
    return ", ".join(f"{space} with {' or '.join(map(str, sorted(bits)))} bits" for space, bits in POSSIBLE[name].items())
