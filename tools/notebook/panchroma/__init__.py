"""Panchroma for notebooks: a sparse-colour camera, simulated, and its shots, rendered.

The sensor is panchromatic, except for a few pixels in each tile that see a colour; a render
computes the colours of all others. ::

    import panchroma

    shot = panchroma.simulate("builtin:1800x1200", sigma=0.01)  # or "IMG_0001.CR2", or an array
    shot                                    # Jupyter shows the camera's own preview
    picture = panchroma.render(shot)        # the full-quality picture, linear light
    picture.save("house.tif")               # .tif .png .jpg .jxl .exr .npy .dng; format="uhdr"
    panchroma.compare(picture, shot.truth)  # how near it is to the truth
    panchroma.burst("shots/house")          # one picture of a series of shots

    shot.save("house.dng")                  # the camera's own file ...
    shot = panchroma.open("house.dng")      # ... and back

Samples of your own sensor are an array of codes (rows, columns), described by its filters and its
levels: without these colours are wrong. A calibration (panchroma.calibrate, or camera.json) says
more::

    from panchroma.shared import CfaPattern, Mosaic, SensorCalibration

    # 12 bits, black 64, white 4095: as the data sheet says, or a dark frame and a clipped one
    levels = SensorCalibration.of_bits(12, headroom=False, black_level=(64, 64, 64, 64))
    mosaic = Mosaic(codes, CfaPattern.of_letters("kodak"), levels)
    picture = panchroma.render(panchroma.Shot(mosaic))

What each returns:

- open, simulate: a Shot; shot.mosaic has the samples, shot.truth what a simulated camera saw
- render, burst: a Picture; picture.rgb is float32 (rows, columns, channels), 1.0 = white
- calibrate: a Calibration; the camera, and how well it is known
- preview, to_srgb: an Image; image.pixels is uint8 (rows, columns, 3), sRGB
- compare: a Comparison, PSNR, and how much of the picture has a wrong hue

Jupyter shows shots, pictures and images; NumPy and matplotlib take pictures and images as arrays:
plt.imshow(panchroma.to_srgb(picture)).

Any filter pattern works, with any channels. A tile is written row by row, and W is panchromatic::

    panchroma.simulate("house.jpg", pattern=4)  # the paper's Bayer block, in 4 x 4 pixels
    panchroma.simulate("house.jpg", pattern="WBWG/BWGW/WGWR/GWRW")  # Kodak's, or pattern="kodak"
    panchroma.simulate("house.jpg", pattern="CMWWWW/YCWWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW")  # CMY

A render uses all processors. Several threads of a program may render at once, and so may processes,
however they are started.

What cannot be done with a shot, a file or a value raises panchroma.PanchromaError, whose message
says what to do instead; an argument of another type may raise TypeError.
A file is given by its name, or as a file object that is open for bytes, such as io.BytesIO.
Nothing overwrites a file unless it is told to (overwrite=True). The command `panchroma` does more:
thousands of shots, connected cameras, comparison with Bayer cameras; `panchroma --help` lists it.
`panchroma.shared` and `panchroma.offline` are the libraries underneath.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .calibration import Calibration, calibrate
    from .pictures import Image, Picture, to_srgb
    from .quality import Comparison, compare
    from .shared.errors import PanchromaError as PanchromaError
    from .shots import Shot, burst, open, preview, render  # noqa: A004  (panchroma.open is what it is called)
    from .simulation import simulate

    __version__: str

# A camera imports panchroma.shared and panchroma.device: names load when they are first used, with
# what they need.
_NAMES = {
    "calibration": ("Calibration", "calibrate"),
    "pictures": ("Image", "Picture", "to_srgb"),
    "quality": ("Comparison", "compare"),
    "shared.errors": ("PanchromaError",),
    "shots": ("Shot", "burst", "open", "preview", "render"),
    "simulation": ("simulate",),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = ["Calibration", "Comparison", "Image", "Picture", "Shot"]
__all__ += ["burst", "calibrate", "compare", "open", "preview", "render", "simulate", "to_srgb"]


if not TYPE_CHECKING:  # which then refuses names that there are not

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            return import_module(".tools.io.versions", __name__).program_version()
        if name not in _MODULES:
            known = ", ".join(__all__)
            raise AttributeError(f"module {__name__!r} has no {name!r}; it has {known}")
        return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES, "__version__"})
