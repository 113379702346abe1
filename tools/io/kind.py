"""The kinds of picture files: format, bits and colour space.

A file is either a picture to look at or a measurement. Pictures (spaces "srgb", "display-p3",
"linear-srgb") are turned upright and carry the space's ICC profile. Measurements ("camera") are the
scene units of the rendering, unclipped if the format allows it, and keep the sensor's orientation,
so that one can be subtracted from another; the orientation is noted if the format has a field for
it. Capture data are written to every format that has fields for them.
"""

from dataclasses import dataclass

from ...shared.errors import InputError
from .development import CAMERA
from .display import check_exposure
from .formats import FORMATS, Format
from .formats.jpg import check_quality

AS_MEASURED = "this is the scene as measured; choose another format or space, such as tif and srgb"
"""Why a measurement cannot be changed, and the remedy, for messages."""


@dataclass(frozen=True)
class PictureKind:
    """A kind of picture file.

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

    Raises
    ------
    InputError
        For a kind that its format does not hold, and names those that it holds.
    """

    format: str
    bits: int
    space: str
    quality: int | None = None

    def __post_init__(self) -> None:
        kept_as = _known(self.format)
        check_quality(self.quality)
        if self.quality is not None and not kept_as.has_quality:
            lossy = ", ".join(name for name, written in FORMATS.items() if written.has_quality)
            plain = f"{self.format} is not compressed with loss"
            raise InputError(f"the quality is {self.quality}, but {plain}; use {lossy}")
        if self.bits not in kept_as.spaces.get(self.space, ()):
            requested = f"{self.space} with {self.bits or 'any'} bits"
            listed = ", ".join(
                f"{space} with {' or '.join(map(str, sorted(bits)))} bits"
                for space, bits in kept_as.spaces.items()
            )
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
        return self.kept_as.suffix

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


def _known(name: str) -> Format:
    if name not in FORMATS:
        raise InputError(f"unknown picture format {name!r}; there are {', '.join(FORMATS)}")
    return FORMATS[name]
