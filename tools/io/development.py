"""Conversion of a rendering to a picture file: its kind, its colours, its capture data."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property

from ...shared import ByteArray, CaptureMetadata, FloatArray, SensorCalibration
from ...shared.tiff import Directory
from .display import ColourTransform
from .embedded import picture_directory
from .icc import icc_profile

CAMERA = "camera"
"""The space of measurements: the scene units of a rendering."""


@dataclass(frozen=True)
class FileKind(ABC):
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

    @abstractmethod
    def check(self, development: "Development") -> None:
        """Raise InputError if this rendering cannot become such a file."""


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

    def check(self) -> None:
        """Raise InputError if such a rendering cannot become such a file. Call it before
        rendering.
        """
        self.kind.check(self)

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

        rgb: (H, W, C), scene units; linear pictures and measurements keep it.
        """
        return rgb if lost is None or self.kind.space == CAMERA else self.shown.whitened(rgb, lost)

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
