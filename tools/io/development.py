"""Conversion of a rendering to a picture file: its kind, its colours, its capture data."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from ...shared import CaptureMetadata, SensorCalibration
from ...shared.arrays import ByteArray, FloatArray
from ...shared.tiff import Directory
from ...shared.writing import OnComplete, durable_file
from .display import ColourTransform
from .embedded import picture_directory
from .icc import icc_profile

if TYPE_CHECKING:
    from .kind import PictureKind

CAMERA = "camera"
"""The space of measurements: the scene units of a rendering."""


@dataclass(frozen=True)
class Development:
    """Conversion of a rendering to a picture file.

    Attributes
    ----------
    kind : PictureKind
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

    kind: "PictureKind"
    shape: tuple[int, int]
    calibration: SensorCalibration
    metadata: CaptureMetadata
    exposure: float = 0.0
    restored: bool = True

    def check(self) -> None:
        """Raise InputError if such a rendering cannot become such a file. Call it before
        rendering.
        """
        self.kind.check_exposure(self.exposure)
        if self.kind.space != CAMERA:
            _ = self.shown
        self.kind.kept_as.check(self)

    @cached_property
    def shown(self) -> ColourTransform:
        """The colours of the picture, those of sRGB for a measurement.

        Raises
        ------
        InputError
            If those of the sensor are unknown.
        """
        space = "srgb" if self.kind.space == CAMERA else self.kind.space
        return ColourTransform.to_space(self.calibration, space, restored=self.restored)

    def whitened(self, rgb: FloatArray, lost: ByteArray | None) -> FloatArray:
        """A rendering or some rows of it as such a picture shows it: white where light is lost
        (`offline.Rendering.lost`).

        Parameters
        ----------
        rgb : FloatArray
            (H, W, C), scene units; linear pictures and measurements keep it.
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


def write_picture(
    path: Path | str,
    bands: Iterable[FloatArray],
    development: Development,
    *,
    overwrite: bool = False,
    on_complete: OnComplete | None = None,
    threads: int = 1,
) -> None:
    """Write the bands of a rendering as they arrive, atomically; the file does not depend on how
    the picture is divided into bands.

    The bands are taken in this thread. Others convert, compress and write those that have arrived.

    Pictures in bands that must be rotated or flipped vertically are assembled in an anonymous
    temporary file in the same folder. Exceptions raised by `bands` pass through, and leave no file.

    Parameters
    ----------
    path : Path | str
        The file.
    bands : Iterable[FloatArray]
        floating point (rows, W, C), scene units, C the calibration's channels, from top to bottom;
        any size from 1 x 1.
    overwrite, on_complete : bool, OnComplete | None, optional
        See `durable_file`.
    threads : int, optional
        Number of threads that convert and compress.

    Raises
    ------
    InputError
        As `Development.check` does, and if a band is no such picture.
    """
    development.check()
    with durable_file(path, overwrite=overwrite, on_complete=on_complete) as file:
        development.kind.kept_as.write(file, bands, development, threads, Path(path).parent)
