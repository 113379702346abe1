"""Pictures: linear, as measured or rendered, and for the screen."""

from __future__ import annotations  # help() then shows them as they are written here

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from .shared import ByteArray, CaptureMetadata, FloatArray, InputError, SensorCalibration
from .shared.arrays import unmasked
from .shared.reading import File, file_name
from .shared.writing import durable_file
from .tools.io.colour import encode_srgb
from .tools.io.display import ColourTransform, checked_picture

_LONGEST_SHOWN = 1024  # pixels: the longest side of what a notebook shows, and keeps in its file


@dataclass(frozen=True, eq=False, repr=False, match_args=False)
class Image:
    """A picture for the screen. Jupyter shows it; `np.asarray(image)`, matplotlib and Pillow take
    it as an array.

    Attributes
    ----------
    pixels : ByteArray
        uint8 (H, W, 3), sRGB, upright. Read-only.

    Examples
    --------
    >>> import numpy as np
    >>> import panchroma
    >>> image = panchroma.to_srgb(np.full((200, 300, 3), 0.5, np.float32))
    >>> image
    <Image 300 x 200, 8-bit sRGB>
    >>> np.asarray(image)[0, 0].tolist()
    [188, 188, 188]
    >>> image.save("grey.png")
    """

    pixels: ByteArray

    def __post_init__(self) -> None:
        pixels = np.ascontiguousarray(self.pixels)
        if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3 or not pixels.size:
            found = f"this one is {pixels.dtype} {pixels.shape}"
            raise InputError(f"an image is uint8 (rows, columns, 3); {found}")
        pixels = pixels.view()
        pixels.flags.writeable = False
        object.__setattr__(self, "pixels", pixels)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.pixels.shape[0], self.pixels.shape[1]

    def save(
        self,
        path: File,
        *,
        format: str | None = None,  # noqa: A002
        quality: int | None = None,
        overwrite: bool = False,
    ) -> None:
        """Write a PNG or a JPEG, as the name ends.

        Parameters
        ----------
        format : str | None, optional
            "png" or "jpg", for a file object that has no name.
        quality : int | None, optional
            Of a JPEG, 1 to 100; 95 by default. A PNG has none.
        overwrite : bool, optional
            Replace an existing file.
        """
        from .tools.io.development import Development
        from .tools.io.kind import PictureKind

        endings = {"png": "png", "jpg": "jpg", "jpeg": "jpg"}
        ending = _ending(path)
        name = endings.get((format or ending).lower())
        if name is None or (ending and endings.get(ending) != name):
            what = f"{ending!r} by its name, `format` is {format!r}"
            raise InputError(f"{file_name(path)}: {what}; an image is saved as .png or .jpg")
        kind = PictureKind(name, 8, "srgb", quality if name == "jpg" else None)
        development = Development(kind, self.shape, SensorCalibration(), CaptureMetadata())
        with durable_file(path, overwrite=checked_flag(overwrite)) as file:
            kind.kept_as.encode(file, [self.pixels], development, threads=1)

    def __repr__(self) -> str:
        return f"<Image {self.shape[1]} x {self.shape[0]}, 8-bit sRGB>"

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.pixels, dtype, copy=copy)

    def _repr_png_(self) -> bytes:
        import imagecodecs

        return bytes(imagecodecs.png_encode(_reduced(self.pixels)))


@dataclass(frozen=True, eq=False, repr=False, match_args=False)
class Picture:
    """Linear light at every pixel, such as `render` makes, and the truth of a simulated shot.
    Jupyter shows it.

    `np.asarray(picture)` is `rgb`, so two pictures of a scene are subtracted by `picture.rgb -
    truth.rgb`.

    Attributes
    ----------
    rgb : FloatArray
        float32 (H, W, C), scene units: 1.0 is white, nothing is clipped. C = 3 for red, green and
        blue. Read-only.
    calibration : SensorCalibration
        What the sensor is: `calibration.channels` are the letters of the C channels, and it gives
        the colours. By default red, green and blue with the primaries of sRGB.
    metadata : CaptureMetadata
        Capture data: camera, lens, exposure, orientation (the samples of `rgb` are not turned; what
        is shown or saved is).
    white : float
        What the white of the scene reads, > 0: 1.0, or the amount of light of a simulated shot; the
        peak of `compare`.
    restored : bool
        Nothing is clipped, or highlights are restored, as by `render` but for preset "paper".
        Otherwise all that is as bright as saturated pixels is shown white.
    lost : ByteArray | None
        uint8 (H, W), how far the shot does not show what the light was, 255 = not at all, as in a
        highlight that is smaller than the distance of two colour blocks; shown white. None =
        nowhere.
    facts : Mapping[str, Any]
        Of the picture of a `burst`: its reference, and what became of each frame, as the command
        says with --json.

    Examples
    --------
    >>> import numpy as np
    >>> import panchroma
    >>> picture = panchroma.Picture(np.full((20, 30, 3), 0.5, np.float32))
    >>> picture
    <Picture 30 x 20, linear R, G, B>
    >>> picture.save("grey.tif")
    >>> picture.save("grey.tif")
    Traceback (most recent call last):
    panchroma.shared.errors.OutputError: grey.tif: exists already; use `overwrite=True` to replace
    it
    """

    rgb: FloatArray
    calibration: SensorCalibration = field(default_factory=SensorCalibration)
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)
    white: float = 1.0
    restored: bool = True
    lost: ByteArray | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        rgb = checked_picture(unmasked(self.rgb), len(self.calibration.channels)).view()
        rgb.flags.writeable = False
        object.__setattr__(self, "rgb", rgb)
        if not 0 < self.white < np.inf:
            raise InputError(f"`white` is {self.white}, expected a number above 0")
        if self.lost is not None and (self.lost.shape != self.shape or self.lost.dtype != np.uint8):
            found = f"`lost` is {self.lost.dtype} {self.lost.shape}, expected uint8 {self.shape}"
            remedy = "cut it as the picture, or leave it out (lost=None)"
            raise InputError(f"{found}, as the picture; {remedy}")

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rgb.shape[0], self.rgb.shape[1]

    @property
    def channels(self) -> str:
        """The letters of the channels, in the order of `rgb`."""
        return self.calibration.channels

    def save(
        self,
        path: File,
        *,
        format: str | None = None,  # noqa: A002
        bits: int | None = None,
        space: str | None = None,
        exposure: float = 0.0,
        quality: int | None = None,
        overwrite: bool = False,
    ) -> None:
        """Write a picture file; the end of its name says which: .tif, .png, .jpg, .jxl, .exr, .npy,
        or .dng (linear).

        Parameters
        ----------
        format : str | None, optional
            "uhdr" for an Ultra HDR JPEG, a .jpg that HDR displays show with its highlights; other
            formats go by the name, if `path` is no file object without one.
        bits : int | None, optional
            8, 16 or 32 (floating point); by default what is usual for the format.
        space : str | None, optional
            "srgb", "display-p3", "linear-srgb", or "camera": `rgb` as it is, but in a DNG white
            where light is lost. By default what is usual for the format.
        exposure : float, optional
            Brighten by this many stops; negative ones darken, and what is burnt out stays white.
        quality : int | None, optional
            1 to 100, of a JPEG (95 by default), Ultra HDR, or JPEG XL (without loss by default).
        overwrite : bool, optional
            Replace an existing file. The file is whole or absent at any moment.
        """
        from .tools.io.development import Development
        from .tools.io.formats import OTHER_NAMES
        from .tools.io.kind import PictureKind, write_picture

        ending = _ending(path)
        name = (format or ending).lower()
        kind = PictureKind.of(OTHER_NAMES.get(name, name), bits, space, quality)
        if kind.suffix != f".{OTHER_NAMES.get(ending, ending)}" and (ending or not format):
            what = f"a picture in the format {kind.format!r}"
            raise InputError(f"{file_name(path)}: {what} ends in {kind.suffix}")
        sensor = self.calibration, self.metadata
        development = Development(kind, self.shape, *sensor, exposure, self.restored)
        rgb = development.whitened(self.rgb, self.lost)
        write_picture(path, [rgb], development, overwrite=checked_flag(overwrite))

    def __repr__(self) -> str:
        return f"<Picture {self.shape[1]} x {self.shape[0]}, linear {', '.join(self.channels)}>"

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.rgb, dtype, copy=copy)

    @property
    def _shown(self) -> Image:
        """On a screen: in colour, or where the colours of these channels are unknown all light, in
        grey.
        """
        try:
            return to_srgb(self)
        except InputError:
            full_scale = np.float32(self.calibration.full_scale)
            luminance = self.rgb @ np.array(self.calibration.gamma, np.float32) / full_scale
            grey = np.rint(255 * encode_srgb(luminance)).astype(np.uint8)
            return Image(grey[..., None].repeat(3, axis=2))

    def _repr_png_(self) -> bytes:
        lost = None if self.lost is None else _reduced(self.lost[..., None])[..., 0]
        return replace(self, rgb=_reduced(self.rgb), lost=lost)._shown._repr_png_()


def to_srgb(picture: Picture | NDArray[np.floating], *, exposure: float = 0.0) -> Image:
    """The picture as a screen shows it: white-balanced, in the colours of sRGB, clipped at white, 8
    bits, upright.

    Parameters
    ----------
    picture : Picture | NDArray[np.floating]
        A `Picture`, or an array (H, W, 3) of linear red, green and blue, 1.0 = white.
    exposure : float, optional
        Brighten by this many stops, -16 to 16; negative ones darken, and what is burnt out stays
        white.

    Raises
    ------
    PanchromaError
        For channels whose colours nobody knows (see `Picture.calibration`).

    Examples
    --------
    >>> import numpy as np
    >>> import panchroma
    >>> ramp = np.linspace(0, 1, 5, dtype=np.float32).reshape(1, 5, 1).repeat(3, axis=2)
    >>> np.asarray(panchroma.to_srgb(ramp))[0, :, 0].tolist()
    [0, 137, 188, 225, 255]
    """
    from .tools.io.display import display_codes, upright

    shown = picture if isinstance(picture, Picture) else Picture(unmasked(picture))
    transform = ColourTransform.to_space(shown.calibration, restored=shown.restored)
    rgb = transform.whitened(shown.rgb, shown.lost, exposure)
    return Image(upright(display_codes(rgb, transform, 8, exposure), shown.metadata.orientation))


def _ending(file: File) -> str:
    """The end of a file's name, without the dot; "" for a file object without a name."""
    return Path(file_name(file)).suffix.lower().removeprefix(".")


def checked_flag(overwrite: object) -> bool:
    """`overwrite` if it is True or False: any text is true, and would replace a file."""
    if not isinstance(overwrite, bool):
        raise TypeError(f"`overwrite` is {overwrite!r}, expected True or False")
    return overwrite


def _reduced(pixels: NDArray[Any]) -> NDArray[Any]:
    """Means of squares of (H, W, C) samples, so that no side is longer than a notebook shows,
    unless a strip is narrower than a square; of the same type.
    """
    size = min(-(-max(pixels.shape[:2]) // _LONGEST_SHOWN), *pixels.shape[:2])
    rows, columns = (side // size for side in pixels.shape[:2])
    whole = pixels[: rows * size, : columns * size]
    squares = whole.reshape(rows, size, columns, size, pixels.shape[2])
    means: NDArray[Any] = squares.mean(axis=(1, 3), dtype=np.float32)
    return means.astype(pixels.dtype)
