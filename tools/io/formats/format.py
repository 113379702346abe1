"""Interface of all picture formats."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any, BinaryIO, ClassVar

from numpy.typing import NDArray

from ....shared import FloatArray, InputError
from ..development import CAMERA, Development
from ..display import checked_picture, display_codes

Bands = Iterable[NDArray[Any]]
"""Rows of a picture, (rows, W, any), from top to bottom: of a rendering, or of samples."""


class Format(ABC):
    """One format of picture files.

    Attributes
    ----------
    name : ClassVar[str]
        Of the format, and the end of its files' names unless `ending` is.
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
