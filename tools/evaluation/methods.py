"""The methods that are compared, by name. A new rival is a file in `rivals` with METHODS, and its
name in _RIVALS.
"""

from dataclasses import asdict
from functools import cache, partial

from ...offline import PRESETS, RenderSettings, render
from ...offline.version import ALGORITHM
from ...shared import Mosaic
from ...shared.arrays import FloatArray
from ...shared.errors import InputError
from ...shared.spelling import meant
from ..batch.previews import linear_preview, preview_version
from .method import Method
from .rivals import bilinear, bm3d_dlmmse, dlmmse, libraw
from .rivals.network import CHANGED, ENDING, network

Networks = tuple[tuple[str, str], ...]
"""Names of networks, and the files that each process reads them from."""
_RIVALS = (bilinear, dlmmse, libraw, bm3d_dlmmse)


def render_preset(settings: RenderSettings, mosaic: Mosaic) -> FloatArray:
    """Render a shot with the off-camera renderer.

    Returns
    -------
    FloatArray
        Float32 (H, W, C), scene units of the shot.
    """
    return render(mosaic, settings).rgb


def _preset(name: str, title: str) -> Method:
    settings = PRESETS[name]
    version, function = [ALGORITHM, asdict(settings)], partial(render_preset, settings)
    packages = ("onnxruntime",) if settings.learned.used else ()
    return Method(name, title, function, version, True, packages=packages)


@cache
def methods() -> dict[str, Method]:
    """All methods but networks, by name: ours, then those of a Bayer camera."""
    title, version, packages = "Sparse colour, preview", preview_version(), ("onnxruntime",)
    ours = [
        _preset("paper", "Sparse colour, paper"),
        _preset("best", "Sparse colour, best"),
        _preset("unlearned", "Sparse colour, best, unlearned"),
        Method("preview", title, linear_preview, version, True, packages=packages),
    ]
    rivals = (method for module in _RIVALS for method in module.METHODS)
    return {method.name: method for method in (*ours, *rivals)}


def default_names() -> list[str]:
    """Names of all methods whose packages are installed."""
    return [name for name, method in methods().items() if method.missing is None]


def missing_packages() -> list[str]:
    """Packages that methods need and that are not installed."""
    return sorted({method.missing for method in methods().values() if method.missing})


def choose(names: list[str]) -> list[Method]:
    """Methods by name, or network by its file, each once.

    Raises
    ------
    InputError
        For an unknown name, one whose package is not installed, and as `network` does.
    """
    chosen: dict[str, Method] = {}
    for name in names:
        if name.endswith(ENDING):
            method = network(name)
        elif name in methods():
            method = methods()[name]
        else:
            known = f"{', '.join(methods())}, and networks by `rival`{meant(name, methods())}"
            raise InputError(f"unknown method {name!r}; there are {known}")
        if method.missing:
            remedy = f"pip install {method.missing}, or leave it out of `methods`"
            raise InputError(f"{name} needs the package {method.missing}: {remedy}")
        chosen[method.name] = method
    return list(chosen.values())


@cache
def find_method(name: str, networks: Networks = ()) -> Method:
    """Return a method by its name, in any process.

    Raises
    ------
    InputError
        If the file of a network has changed or is gone.
    """
    file = dict(networks).get(name)
    method = network(file) if file else methods()[name]
    if method.name != name:
        raise InputError(f"{file}: {CHANGED}")
    return method
