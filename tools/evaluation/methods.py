"""The methods compared, each by name: what renders, what it needs, and what its results depend on."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import cast

import numpy as np

from offline import BEST, PAPER, RenderSettings, render
from shared import Mosaic
from shared.arrays import FloatArray
from shared.errors import InputError
from tools.host.versions import package_version

from .code_digest import digest
from .protocol import BayerShot
from .rivals import demosaic_bilinear
from .rivals.bayer import sites
from .rivals.denoising import denoise_bayer
from .rivals.dlmmse import demosaic_dlmmse
from .rivals.libraw import ALGORITHMS, demosaic_libraw
from .rivals.packages import demosaic_malvar, demosaic_menon, demosaic_opencv

Demosaic = Callable[[FloatArray, str], FloatArray]
Neutral = tuple[float, ...]
_ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Method:
    """One way from a scene's light to a picture.

    title: for people. sparse: renders a shot of ours; None for a rival. demosaic: of a rival, on the samples as they are, or with
    `balanced` on white-balanced ones; with `denoised` BM3D comes first. settings, files (a folder of ours) and packages
    (distributions): what its results depend on besides code of ours. seconds: of work per megapixel, roughly, for the time left.
    """

    name: str
    title: str
    sparse: Callable[[Mosaic], FloatArray] | None = None
    demosaic: Demosaic | None = None
    balanced: bool = False
    denoised: bool = False
    settings: str = ""
    files: str = ""
    packages: tuple[str, ...] = ()
    seconds: float = 1.0

    @property
    def short(self) -> str:
        """The title without the name of the sensor."""
        return self.title.partition(", ")[2] or self.title

    @property
    def ours(self) -> bool:
        """Whether it is of the sparse-colour camera."""
        return self.sparse is not None

    @property
    def missing(self) -> str | None:
        """A package that is needed and not installed."""
        return next((package for package in self.packages if package_version(package) is None), None)

    def identity(self) -> tuple[str, ...]:
        """What the results depend on, from the photograph to the figures; equal for methods that do the same.

        Of code it is what can be reached: a result outlives changes of everything else.
        """
        own = self.settings or f"{self.name.removeprefix('bm3d+')} {self.balanced} {self.denoised}"
        call = self.sparse or self.demosaic
        function = call.func if isinstance(call, partial) else call
        code = digest(f"{function.__module__}:{function.__qualname__}", *(_SPARSE if self.ours else _BAYER)) if function else ""
        files = (_content(self.files),) if self.files else ()
        return (own, code, *files, *(f"{each} {package_version(each)}" for each in self.packages))


_HERE = "tools.evaluation"
_SPARSE = (f"{_HERE}.protocol:Protocol.sparse_shot", f"{_HERE}.methods:render_sparse", f"{_HERE}.measures:Measures.of")
_BAYER = (f"{_HERE}.protocol:Protocol.bayer_shot", f"{_HERE}.methods:render_bayer", f"{_HERE}.measures:Measures.of")


def _offline(settings: RenderSettings, mosaic: Mosaic) -> FloatArray:
    return render(mosaic, settings).rgb


def _preview(mosaic: Mosaic) -> FloatArray:
    from device import Preview

    return cast(FloatArray, Preview.for_mosaic(mosaic, scale=1, linear=True, threads=1).run(mosaic))


def _libraw(algorithm: str, samples: FloatArray, order: str) -> FloatArray:
    return demosaic_libraw(samples, algorithm, order)


def _registry() -> dict[str, Method]:
    ours = [
        Method("paper", "Sparse colour, paper", partial(_offline, PAPER), settings=repr(PAPER), seconds=0.3),
        Method("best", "Sparse colour, best", partial(_offline, BEST), settings=repr(BEST), seconds=2),
        Method("preview", "Sparse colour, preview", _preview, files="device/models", packages=("onnxruntime",), seconds=0.1),
    ]
    colour, bm3d = ("colour-demosaicing",), ("bm3d",)
    plain = [
        Method("bilinear", "Bayer, bilinear", demosaic=demosaic_bilinear, seconds=0.05),
        Method("malvar", "Bayer, Malvar 2004", demosaic=demosaic_malvar, packages=colour, seconds=0.1),
        Method("menon", "Bayer, Menon 2007", demosaic=demosaic_menon, packages=colour, seconds=0.3),
        Method("menon-wb", "Bayer, Menon, balanced", demosaic=demosaic_menon, balanced=True, packages=colour, seconds=0.3),
        Method("dlmmse", "Bayer, DLMMSE 2005", demosaic=demosaic_dlmmse, seconds=0.15),
        Method("dlmmse-wb", "Bayer, DLMMSE, balanced", demosaic=demosaic_dlmmse, balanced=True, seconds=0.15),
    ]
    libraw = [
        Method(
            name, f"Bayer, LibRaw {name.upper()}", demosaic=partial(_libraw, name), balanced=True, packages=("rawpy",), seconds=0.2
        )
        for name in ALGORITHMS
    ]
    # One of several distributions that hold the same module.
    cv = next((name for name in _OPENCV if package_version(name)), _OPENCV[0])
    opencv = [Method("ea", "Bayer, OpenCV edge-aware", demosaic=demosaic_opencv, packages=(cv,), seconds=0.05)]
    low_light = [
        Method(
            f"bm3d+{each.name}",
            each.title.replace("Bayer, ", "Bayer, BM3D + "),
            demosaic=each.demosaic,
            balanced=each.balanced,
            denoised=True,
            packages=(*each.packages, *bm3d),
            seconds=each.seconds + DENOISING_SECONDS,
        )
        for each in plain
        if each.name in ("menon", "menon-wb", "dlmmse", "dlmmse-wb")
    ]
    return {method.name: method for method in (*ours, *plain, *libraw, *opencv, *low_light)}


DENOISING_SECONDS = 40  # per megapixel, once for all methods that begin with it
_OPENCV = ("opencv-contrib-python-headless", "opencv-python-headless", "opencv-contrib-python", "opencv-python")


@cache
def methods() -> dict[str, Method]:
    """All methods by name, ours first."""
    return _registry()


def default_names() -> list[str]:
    """Every method that can run here; `best` only where it differs from `paper`."""
    return [name for name, method in methods().items() if method.missing is None and not (name == "best" and BEST == PAPER)]


def choose(names: list[str]) -> list[Method]:
    """Methods by name, each once. Raises InputError for an unknown name, and for one whose package is not installed."""
    chosen = []
    for name in dict.fromkeys(names):
        if name not in methods():
            raise InputError(f"unknown method {name!r}; there are {', '.join(methods())}")
        if missing := methods()[name].missing:
            extra = "rivals" if missing == "bm3d" else "evaluation"
            raise InputError(f"{name} needs the package {missing}: pip install -e '.[{extra}]', or leave it out of --methods")
        chosen.append(methods()[name])
    return chosen


def render_sparse(method: Method, mosaic: Mosaic, gain: float) -> FloatArray:
    """A picture, float32 (H, W, 3), scene units of the scene, by a method of ours."""
    if method.sparse is None:
        raise InputError(f"{method.name} renders Bayer shots")
    picture = method.sparse(mosaic)
    return picture / np.float32(gain) if gain != 1 else picture


def render_bayer(method: Method, shot: BayerShot, neutral: Neutral | None, denoised: FloatArray | None = None) -> FloatArray:
    """A picture, float32 (H, W, 3), scene units, by a rival.

    neutral: what white reads, for the methods that balance before they interpolate, as raw developers do. denoised: the samples
    after `denoise`, where they are at hand.
    """
    if method.demosaic is None:
        raise InputError(f"{method.name} renders sparse-colour shots")
    samples = shot.samples
    if method.denoised:
        samples = denoise(shot) if denoised is None else denoised
    if not method.balanced or neutral is None:
        return method.demosaic(samples, shot.order)
    white = np.array(neutral, np.float32)
    white /= white.max()
    balanced = samples.copy()
    for channel, row, column in sites(shot.order):
        balanced[row::2, column::2] /= white[channel]
    return method.demosaic(balanced, shot.order) * white


def denoise(shot: BayerShot) -> FloatArray:
    """The samples after BM3D, which is told the noise."""
    return denoise_bayer(shot.samples, shot.shot, shot.read)


@cache
def _content(folder: str) -> str:
    """Digest of the files in a folder of ours."""
    total = hashlib.sha256()
    for path in sorted((_ROOT / folder).iterdir()):
        total.update(path.name.encode() + b"\0" + path.read_bytes())
    return total.hexdigest()[:16]
