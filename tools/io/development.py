"""Conversion of a rendering to a picture file: its kind, its colours, its capture data; and the
interface of all picture formats.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, BinaryIO, ClassVar

from numpy.typing import NDArray

from ...shared import ByteArray, CaptureMetadata, FloatArray, InputError, SensorCalibration
from ...shared.dng.exif import metadata_directory
from ...shared.dng.tags import MAKER, TAG
from ...shared.tiff import Directory, FieldType
from .display import ColourTransform, check_exposure, checked_picture, display_codes
from .encoding import icc_profile
from .versions import package_version

Bands = Iterable[NDArray[Any]]
"""Rows of a picture, (rows, W, any), from top to bottom: of a rendering, or of samples."""
CAMERA = "camera"
"""The space of measurements: the scene units of a rendering."""
AS_MEASURED = "this is the scene as measured; choose another format or space, such as tif and srgb"
"""Why a measurement cannot be changed, and the remedy, for messages."""

_SRGB, _UNCALIBRATED = 1, 65535  # values of Exif's ColorSpace


@dataclass(frozen=True)
class FileKind:
    """A kind of picture file, see `kind.PictureKind`.

    Attributes
    ----------
    format : str
        A key of `FORMATS`.
    bits : int
        8 or 16 = integers (in "exr" half floats), 32 = floating point.
    space : str
        A key of `SPACES`, or "camera".
    quality : int | None
        Of a format that has one, 1 to 100; None = the usual one.
    """

    format: str
    bits: int
    space: str
    quality: int | None = None

    @property
    def has_white_balance(self) -> bool:
        """True if pictures are balanced, or (a linear DNG) state how to: all but measurements in
        scene units.
        """
        return self.space != CAMERA or self.format == "dng"

    def check_exposure(self, exposure: float) -> None:
        """Raise InputError if a picture of this kind cannot have a gain of `exposure` stops."""
        if self.space != CAMERA:
            check_exposure(exposure)
        elif exposure != 0:
            raise InputError(f"`exposure` is {exposure:g} stops, but {AS_MEASURED}")


@dataclass(frozen=True)
class Development:
    """Conversion of a rendering to a picture file.

    Attributes
    ----------
    kind : FileKind
        Format, bits and space of the file.
    shape : tuple[int, int]
        (H, W) of the rendering.
    calibration : SensorCalibration
        Of the sensor; it gives the colours.
    metadata : CaptureMetadata
        Capture data; its orientation turns pictures upright.
    exposure : float
        Gain in stops; 0 for the space "camera".
    restored : bool
        See `ColourTransform.to_space`.
    """

    kind: FileKind
    shape: tuple[int, int]
    calibration: SensorCalibration
    metadata: CaptureMetadata
    exposure: float = 0.0
    restored: bool = True

    @cached_property
    def shown(self) -> ColourTransform:
        """The colours of the picture, those of sRGB for a measurement.

        Raises InputError if those of the sensor are unknown.
        """
        space = "srgb" if self.kind.space == CAMERA else self.kind.space
        return ColourTransform.to_space(self.calibration, space, restored=self.restored)

    def whitened(self, rgb: FloatArray, lost: ByteArray | None) -> FloatArray:
        """A rendering or some rows of it as such a picture shows it: white where light is lost
        (`offline.Rendering.lost`).

        rgb: (H, W, C), scene units; measurements keep it, but a DNG for raw developers.
        """
        if lost is None or not self.kind.has_white_balance:
            return rgb
        return self.shown.whitened(rgb, lost, self.exposure)

    @property
    def channels(self) -> str:
        """The letters of the file's channels."""
        return self.calibration.channels if self.kind.space == CAMERA else "RGB"

    @property
    def icc(self) -> bytes:
        """The colour profile; b"" = none."""
        return b"" if self.kind.space == CAMERA else icc_profile(self.kind.space)

    @property
    def turn(self) -> int:
        """The orientation (TIFF 6.0, tag 274) by which the picture is turned upright; 1 = it is not
        turned.
        """
        return 1 if self.kind.space == CAMERA else self.metadata.orientation

    @property
    def noted(self) -> CaptureMetadata:
        """The capture data of the file."""
        return self.metadata if self.kind.space == CAMERA else replace(self.metadata, orientation=1)

    @property
    def directory(self) -> Directory:
        """The capture data as a TIFF directory, with its Exif directory."""
        return picture_directory(self.noted, srgb=self.kind.space == "srgb")

    @property
    def written_shape(self) -> tuple[int, int]:
        """(rows, columns) of the file."""
        return self.shape[::-1] if self.turn >= 5 else self.shape


def picture_directory(metadata: CaptureMetadata, *, srgb: bool) -> Directory:
    """Return the TIFF directory, with its Exif directory, of a picture in sRGB or in another
    space.
    """
    directory = metadata_directory(metadata)
    directory.fields[TAG["Software"]] = FieldType.ASCII, software()
    directory.children[TAG["ExifTag"]].fields |= {
        TAG["ColorSpace"]: (FieldType.SHORT, [_SRGB if srgb else _UNCALIBRATED]),
        TAG["FlashpixVersion"]: (FieldType.UNDEFINED, b"0100"),
    }
    return directory


def software() -> str:
    """Return name and version of the program; a checkout that is not installed has no version."""
    return " ".join(filter(None, (MAKER, package_version("panchroma"))))


class Format(ABC):
    """One format of picture files.

    Attributes
    ----------
    name : ClassVar[str]
        Of the format; also the end of its files' names, unless `ending` states another.
    spaces : ClassVar[Mapping[str, tuple[int, ...]]]
        Space -> bits; the first that fits is the default. Integers hold only 0..1, so they are for
        spaces with these limits. Programs show JPEG, PNG and integer TIFF as they are, so linear
        light in them would look too dark.
    ending : ClassVar[str]
        The end of its files' names, without the dot; "" = the name.
    aliases : ClassVar[tuple[str, ...]]
        What else it is called.
    about : ClassVar[str]
        What its name does not say, for the help; "" = nothing.
    has_quality : ClassVar[bool]
        It loses something, and `PictureKind.quality` says how much.
    in_bands : ClassVar[bool]
        A picture goes to the file as it is rendered; otherwise it is held as a whole.
    longest_side : ClassVar[int | None]
        Pixels; None = any.
    memory_per_pixel : ClassVar[float]
        Bytes, measured at 1 to 100 megapixels and rounded up (`tests/tools/batch/test_memory.py`
        measures again). Of a format in bands: what is kept while it is rendered. Of another: what a
        picture of 3 channels needs when it is encoded, beside the picture, but without what the
        rendering needed.
    """

    name: ClassVar[str]
    spaces: ClassVar[Mapping[str, tuple[int, ...]]]
    ending: ClassVar[str] = ""
    aliases: ClassVar[tuple[str, ...]] = ()
    about: ClassVar[str] = ""
    has_quality: ClassVar[bool] = False
    in_bands: ClassVar[bool] = False
    longest_side: ClassVar[int | None] = None
    memory_per_pixel: ClassVar[float] = 0.0

    def check(self, development: Development) -> None:
        """Raise InputError if such a picture cannot be in this format, or cannot be developed as
        asked. Call it before rendering.
        """
        development.kind.check_exposure(development.exposure)
        if development.kind.has_white_balance:
            _ = development.shown  # raises InputError for unknown colours
        height, width = development.shape
        if self.longest_side is not None and max(height, width) > self.longest_side:
            reason = f"a side of a {self.name} holds at most {self.longest_side}; use tif"
            raise InputError(f"{width} x {height} pixels: {reason}")

    def memory(self, shape: tuple[int, int], channels: int, rendering: int, threads: int) -> float:
        """Bytes that are needed to render a frame of this shape to a file, beside the frame and the
        program.

        rendering: what the rendering needs. threads: that render.
        """
        pixels = shape[0] * shape[1]
        if self.in_bands:
            return self.memory_per_pixel * pixels + rendering
        encoding = round(self.memory_per_pixel * pixels * max(channels / 3, 1))
        return 4 * channels * pixels + max(rendering, encoding)

    def samples(self, rgb: FloatArray, development: Development) -> NDArray[Any]:
        """A rendering or some rows of it, (H, W, C) scene units, as samples of the file (H, W,
        any).

        Raises InputError for a picture that `checked_picture` refuses.
        """
        if development.kind.space == CAMERA:
            return checked_picture(rgb, len(development.calibration.channels))
        if development.kind.bits == 32 or development.shown.space.linear:
            return development.shown.apply(rgb, development.exposure)
        return display_codes(rgb, development.shown, development.kind.bits, development.exposure)

    @abstractmethod
    def encode(self, file: BinaryIO, bands: Bands, development: Development, threads: int) -> None:
        """Write a file, empty and seekable, of samples (rows, W, any), upright, from top to bottom;
        without `in_bands` in one piece. threads: that compress.
        """
