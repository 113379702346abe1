"""The methods that are compared, by name: ours and the rivals."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

from shared.arrays import FloatArray
from shared.errors import InputError
from shared.spelling import meant
from tools.host.code_digest import digest
from tools.host.versions import package_version

from .camera_preview import render_preview
from .cameras import CameraPair, Denoise
from .presets import PRESETS, UNLEARNED, render_preset
from .rivals.bilinear import demosaic_bilinear
from .rivals.demosaicnet import PACKAGES, demosaic_demosaicnet
from .rivals.denoising import denoise_bayer
from .rivals.dlmmse import demosaic_dlmmse
from .rivals.libraw import ALGORITHMS, demosaic_libraw
from .rivals.packages import demosaic_malvar, demosaic_menon, demosaic_opencv
from .rivals.plane_denoising import denoised_planes
from .rivals.planes import planes, sharpened_planes

DENOISING_SECONDS = 40  # per megapixel, once for all methods that begin with it
PLANES, SHARPENED_PLANES, DENOISED_PLANES = "planes", "planes+w", "bm3d+planes"  # what anyone can do with the shot of any pattern
# Distributions that all install the module cv2.
_OPENCV = ("opencv-contrib-python-headless", "opencv-python-headless", "opencv-contrib-python", "opencv-python")
# The code between the light of a scene and its figures: every result depends on it.
MEASURING = (
    "shared",
    "tools/scenes/scene.py",
    "tools/camera/filters.py",
    *(f"tools/evaluation/{name}.py" for name in ("protocol", "rivals/bayer", "tiles", "cameras")),
    *(f"tools/evaluation/{name}.py" for name in ("hue", "measures", "metrics", "ssim")),
)


@dataclass(frozen=True)
class Method:
    """A way from a shot to a picture.

    title: name for people.
    function: makes the picture, from a Mosaic if the method is for any pattern, from Bayer samples and their order if it is not.
    code: all files and folders that results depend on besides MEASURING, relative to the repository. If one is missing here,
        results are kept although it has changed.
    ours: whether it is Panchroma's.
    sparse: whether it renders shots of the sparse-colour camera, of any pattern.
    balanced: a rival that gets white-balanced samples.
    denoise: applied to a rival's samples first.
    packages: distributions that it needs; their versions count too.
    seconds: rough duration per megapixel, from which the time left is estimated.
    """

    name: str
    title: str
    function: Callable[..., FloatArray]
    code: tuple[str, ...] = ()
    ours: bool = False
    sparse: bool = False
    balanced: bool = False
    denoise: Denoise | None = None
    packages: tuple[str, ...] = ()
    seconds: float = 1.0

    @property
    def short(self) -> str:
        """Title without the name of the sensor."""
        return self.title.partition(", ")[2] or self.title

    @property
    def missing(self) -> str | None:
        """A package that the method needs and that is not installed."""
        return next((package for package in self.packages if package_version(package) is None), None)

    def identity(self) -> tuple[str, ...]:
        """What results depend on besides scene, noise and pattern; equal for methods that do the same."""
        call = self.function if isinstance(self.function, partial) else partial(self.function)
        return (
            f"{call.func.__module__}.{call.func.__qualname__} {call.args} {call.keywords}",
            f"balanced {self.balanced}, denoised {self.denoise is not None}",
            digest(*MEASURING),
            digest(*self.code),
            *(f"{each} {package_version(each)}" for each in self.packages),
        )

    def render(self, cameras: CameraPair) -> FloatArray:
        """Render the shot of the camera that this method is for. Returns float32 (H, W, N), scene units."""
        if self.sparse:
            return cameras.render_sparse(self.function)
        return cameras.render_bayer(self.function, balanced=self.balanced, denoise=self.denoise)


@cache
def methods() -> dict[str, Method]:
    """All methods by name: ours, then the others for any pattern, then those of a Bayer camera."""
    paper, best, unlearned = (partial(render_preset, each) for each in (PRESETS["paper"], PRESETS["best"], UNLEARNED))
    render_code = "tools/evaluation/presets.py", "offline"
    preview_code = "tools/evaluation/camera_preview.py", "device"
    ours = [
        Method("paper", "Sparse colour, paper", paper, render_code, ours=True, sparse=True, seconds=0.3),
        Method("best", "Sparse colour, best", best, render_code, ours=True, sparse=True, packages=("onnxruntime",), seconds=2),
        Method("unlearned", "Sparse colour, best, unlearned", unlearned, render_code, ours=True, sparse=True, seconds=2),
        Method(
            "preview",
            "Sparse colour, preview",
            render_preview,
            preview_code,
            ours=True,
            sparse=True,
            packages=("onnxruntime",),
            seconds=0.1,
        ),
    ]
    plain = Method(PLANES, "Interpolated planes", planes, _rivals("planes"), sparse=True, seconds=0.1)
    interpolated = [
        plain,
        replace(plain, name=SHARPENED_PLANES, title="Interpolated planes + W", function=sharpened_planes),
        replace(
            plain,
            name=DENOISED_PLANES,
            title="BM3D + interpolated planes",
            function=denoised_planes,
            code=(*plain.code, *_rivals("plane_denoising", "denoising")),
            packages=("bm3d",),
            seconds=15,
        ),
    ]
    wrapped = _rivals("packages", "integers")
    colour = ("colour-demosaicing",)
    malvar = Method("malvar", "Bayer, Malvar 2004", demosaic_malvar, wrapped, packages=colour, seconds=0.1)
    menon = Method("menon", "Bayer, Menon 2007", demosaic_menon, wrapped, packages=colour, seconds=0.3)
    dlmmse = Method("dlmmse", "Bayer, DLMMSE 2005", demosaic_dlmmse, _rivals("dlmmse"), seconds=0.15)
    interpolating = [
        menon,
        replace(menon, name="menon-wb", title="Bayer, Menon, balanced", balanced=True),
        dlmmse,
        replace(dlmmse, name="dlmmse-wb", title="Bayer, DLMMSE, balanced", balanced=True),
    ]
    libraw = [
        Method(
            name,
            f"Bayer, LibRaw {name.upper()}",
            partial(demosaic_libraw, algorithm=name),
            _rivals("libraw", "integers"),
            balanced=True,
            packages=("rawpy",),
            seconds=0.2,
        )
        for name in ALGORITHMS
    ]
    opencv = next((name for name in _OPENCV if package_version(name)), _OPENCV[0])
    low_light = [
        replace(
            each,
            name=f"bm3d+{each.name}",
            title=each.title.replace("Bayer, ", "Bayer, BM3D + "),
            code=(*each.code, *_rivals("denoising")),
            denoise=denoise_bayer,
            packages=(*each.packages, "bm3d"),
            seconds=each.seconds + DENOISING_SECONDS,
        )
        for each in interpolating
    ]
    rivals = [
        Method("bilinear", "Bayer, bilinear", demosaic_bilinear, _rivals("bilinear"), seconds=0.05),
        malvar,
        *interpolating,
        *libraw,
        Method("ea", "Bayer, OpenCV edge-aware", demosaic_opencv, wrapped, packages=(opencv,), seconds=0.05),
        Method(
            "demosaicnet",
            "Bayer, Gharbi 2016, balanced",
            demosaic_demosaicnet,
            _rivals("demosaicnet"),
            balanced=True,
            packages=PACKAGES,
            seconds=8,
        ),
        *low_light,
    ]
    return {method.name: method for method in (*ours, *interpolated, *rivals)}


def _rivals(*modules: str) -> tuple[str, ...]:
    return tuple(f"tools/evaluation/rivals/{module}.py" for module in modules)


def default_names() -> list[str]:
    """Names of all methods whose packages are installed."""
    return [name for name, method in methods().items() if method.missing is None]


def missing_packages() -> list[str]:
    """Packages that methods need and that are not installed."""
    return sorted({method.missing for method in methods().values() if method.missing})


def remedy(package: str) -> str:
    """The command that installs a package which a method needs."""
    extra = {"bm3d": "rivals", **dict.fromkeys(PACKAGES, "learned-rivals")}.get(package, "evaluation")
    return f"pip install -e '.[{extra}]'"


def choose(names: list[str]) -> list[Method]:
    """Methods by name, each once. Raises InputError for an unknown name, or one whose package is not installed."""
    chosen = []
    for name in dict.fromkeys(names):
        if name not in methods():
            raise InputError(f"unknown method {name!r}; there are {', '.join(methods())}{meant(name, methods())}")
        if missing := methods()[name].missing:
            raise InputError(f"{name} needs the package {missing}: {remedy(missing)}, or leave it out of --methods")
        chosen.append(methods()[name])
    return chosen
