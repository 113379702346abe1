"""The methods that are compared, by name. A new rival is a file in `rivals` with METHODS, and its name in _RIVALS."""

from collections.abc import Iterable
from dataclasses import asdict
from functools import cache, partial

from offline import PRESETS, RenderSettings, render
from offline.version import ALGORITHM
from shared import Mosaic
from shared.arrays import FloatArray
from shared.errors import InputError
from shared.spelling import meant
from tools.batch.previews import linear_preview, preview_version

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
Networks = tuple[tuple[str, str], ...]
"""Names of networks, and the files that each process reads them from."""
_RIVALS = (planes, interpolation, dlmmse, integers, demosaicnet, denoising)


class _Methods(dict[str, Method]):
    """The methods that anyone has; and by its name, but not in the list, each network that was chosen in this process."""

    def __init__(self, known: Iterable[tuple[str, Method]]) -> None:
        super().__init__(known)
        self.networks: dict[str, Method] = {}  # a name tells the content, so that none ever means another network

    def __missing__(self, name: str) -> Method:
        return self.networks[name]


@cache
def methods() -> _Methods:
    """All methods by name: ours, then the others for any pattern, then those of a Bayer camera."""
    known = (*_OURS, *(method for module in _RIVALS for method in module.METHODS))
    return _Methods((method.name, method) for method in known)


def default_names() -> list[str]:
    """Names of all methods whose packages are installed."""
    return [name for name, method in methods().items() if method.missing is None]


def missing_packages() -> list[str]:
    """Packages that methods need and that are not installed."""
    return sorted({method.missing for method in methods().values() if method.missing})


def choose(names: list[str]) -> list[Method]:
    """Methods by name, or network by its file, each once.

    Raises InputError for an unknown name, one whose package is not installed, and as `network.network` does.
    """
    chosen: dict[str, Method] = {}
    for name in names:
        if name.endswith(network.ENDING):
            method = network.network(name)
            methods().networks[method.name] = method
        elif name in methods() or name in methods().networks:
            method = methods()[name]
        else:
            raise InputError(f"unknown method {name!r}; there are {', '.join(methods())}{meant(name, methods())}")
        if method.missing:
            raise InputError(f"{name} needs the package {method.missing}: {method.remedy}, or leave it out of `methods`")
        chosen[method.name] = method
    return list(chosen.values())


def method_of(name: str, networks: Networks) -> Method:
    """Return a method by its name, in any process. Raises InputError for a network whose file has changed or is gone."""
    file = dict(networks).get(name)
    if file and all(method.name != name for method in choose([file])):
        raise InputError(f"{file}: {network.CHANGED}")
    return methods()[name]
