"""The methods that are compared, by name. A new rival is a file in `rivals` with METHODS, and its name in _RIVALS."""

from dataclasses import asdict
from functools import cache, partial

from offline import PRESETS, RenderSettings, render
from offline.version import ALGORITHM
from shared import Mosaic
from shared.arrays import FloatArray
from shared.errors import InputError
from shared.spelling import meant
from tools.pictures.previews import linear_preview, preview_version

from .method import Method
from .rivals import demosaicnet, denoising, dlmmse, integers, interpolation, network, planes


def render_preset(settings: RenderSettings, mosaic: Mosaic) -> FloatArray:
    """Render a shot with the off-camera renderer. Returns float32 (H, W, C), scene units of the shot."""
    return render(mosaic, settings).rgb


def _preset(name: str, title: str, seconds: float) -> Method:
    settings = PRESETS[name]
    version, packages = [ALGORITHM, asdict(settings)], ("onnxruntime",) if settings.learned.used else ()
    function = partial(render_preset, settings)
    return Method(name, f"Sparse colour, {title}", function, version, ours=True, sparse=True, packages=packages, seconds=seconds)


def _preview() -> Method:
    title, packages = "Sparse colour, preview", ("onnxruntime",)
    return Method("preview", title, linear_preview, preview_version(), ours=True, sparse=True, packages=packages, seconds=0.1)


_OURS = (_preset("paper", "paper", 0.3), _preset("best", "best", 2), _preset("unlearned", "best, unlearned", 2), _preview())
_RIVALS = (planes, interpolation, dlmmse, integers, demosaicnet, denoising)


class _Methods(dict[str, Method]):
    """The methods, and those of networks by the names of their files: every process that is told a name finds its method."""

    def __missing__(self, name: str) -> Method:
        if not name.endswith(network.ENDING):
            raise KeyError(name)
        return network.network(name)  # not kept: the list is of methods that anyone has


@cache
def methods() -> dict[str, Method]:
    """All methods by name: ours, then the others for any pattern, then those of a Bayer camera; and any network by its file's."""
    known = (*_OURS, *(method for module in _RIVALS for method in module.METHODS))
    return _Methods((method.name, method) for method in known)


def default_names() -> list[str]:
    """Names of all methods whose packages are installed."""
    return [name for name, method in methods().items() if method.missing is None]


def missing_packages() -> list[str]:
    """Packages that methods need and that are not installed."""
    return sorted({method.missing for method in methods().values() if method.missing})


def choose(names: list[str]) -> list[Method]:
    """Methods by name, each once. Raises InputError for an unknown name, or one whose package is not installed."""
    chosen = []
    for name in dict.fromkeys(names):
        if name not in methods() and not name.endswith(network.ENDING):
            raise InputError(f"unknown method {name!r}; there are {', '.join(methods())}{meant(name, methods())}")
        method = methods()[name]
        if method.missing:
            raise InputError(f"{name} needs the package {method.missing}: {method.remedy}, or leave it out of `methods`")
        chosen.append(method)
    return chosen
