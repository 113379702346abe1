"""The kinds of picture files: format, bits and colour space.

A file is either a picture to look at or a measurement. Pictures (spaces "srgb", "display-p3",
"linear-srgb") are turned upright and carry the space's ICC profile. Measurements ("camera") are the
scene units of the rendering, unclipped if the format allows it, and keep the sensor's orientation,
so that one can be subtracted from another; the orientation is noted if the format has a field for
it. Capture data are written to every format that has fields for them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from tempfile import gettempdir

from ...shared import FloatArray, InputError
from ...shared.reading import File
from ...shared.writing import OnComplete, durable_file
from .ahead import ahead
from .development import Bands, Development, FileKind, Format
from .display import joined, turned, upright
from .formats import FORMATS
from .formats.jpg import check_quality

_RENDERING = 4  # threads that render, for each that converts: at most a fifth of their time


@dataclass(frozen=True)
class PictureKind(FileKind):
    """A kind of picture file that one of `FORMATS` holds; for the attributes see `FileKind`.

    Raises InputError for a kind that its format does not hold, and names those that it holds.
    """

    def __post_init__(self) -> None:
        kept_as = _known(self.format)
        check_quality(self.quality)
        if self.quality is not None and not kept_as.has_quality:
            lossy = ", ".join(name for name, written in FORMATS.items() if written.has_quality)
            plain = f"{self.format} is not compressed with loss"
            raise InputError(f"the quality is {self.quality}, but {plain}; use {lossy}")
        if self.bits not in kept_as.spaces.get(self.space, ()):
            requested = f"{self.space} with {self.bits or 'any'} bits"
            spaces = ((space, map(str, sorted(bits))) for space, bits in kept_as.spaces.items())
            listed = ", ".join(f"{space} with {' or '.join(bits)} bits" for space, bits in spaces)
            raise InputError(f"{self.format} does not hold {requested}; it holds {listed}")

    @classmethod
    def of(
        cls,
        name: str,
        bits: int | None = None,
        space: str | None = None,
        quality: int | None = None,
    ) -> "PictureKind":
        """Return the kind with None filled in: the first space that has these bits, the first bits
        of this space.
        """
        kept_as = _known(name)
        for candidate, possible in kept_as.spaces.items():
            if space in (None, candidate) and bits in (None, *possible):
                return cls(name, bits or possible[0], candidate, quality)
        return cls(name, bits or 0, space or "any space", quality)  # raises InputError

    @property
    def kept_as(self) -> Format:
        """The format."""
        return FORMATS[self.format]

    @property
    def suffix(self) -> str:
        """The end of the file's name, with the dot."""
        return f".{self.kept_as.ending or self.format}"


def _known(name: str) -> Format:
    if name not in FORMATS:
        raise InputError(f"unknown picture format {name!r}; there are {', '.join(FORMATS)}")
    return FORMATS[name]


def write_picture(
    path: File,
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

    Raises InputError as `Format.check` does, and if a band is no such picture.

    Parameters
    ----------
    path : File
        The file.
    bands : Iterable[FloatArray]
        floating point (rows, W, C), scene units, C the calibration's channels, from top to bottom;
        any size from 1 x 1.
    overwrite, on_complete : bool, OnComplete | None, optional
        See `durable_file`.
    threads : int, optional
        Number of threads that convert and compress.
    """
    kept_as, turn = FORMATS[development.kind.format], development.turn
    kept_as.check(development)
    convert = partial(kept_as.samples, development=development)
    with durable_file(path, overwrite=overwrite, on_complete=on_complete) as file:
        samples: Bands = ahead(convert, bands, -(-threads // _RENDERING))
        if kept_as.in_bands:
            folder = Path(path).parent if isinstance(path, str | PathLike) else Path(gettempdir())
            samples = turned(samples, development.shape, turn, folder)
        else:
            whole = joined(samples, development.shape[0])
            # A copy, even of one pixel: codecs look at the strides.
            samples = [whole if turn == 1 else upright(whole, turn).copy()]
        kept_as.encode(file, samples, development, threads)
