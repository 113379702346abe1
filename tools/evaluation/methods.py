"""The methods that are compared, by name. A new rival is a file in `rivals` with METHODS, and its
name in _RIVALS; a function of anybody's own needs no change here.
"""

from functools import cache, partial

from ...offline import PRESETS, RenderSettings, render
from ...shared import FloatArray, InputError, Mosaic
from ...shared.errors import meant
from ..batch.in_memory import linear_preview
from .cameras import Method
from .functions import function
from .rivals import bilinear, bm3d_dlmmse, dlmmse, libraw
from .rivals.network import CHANGED, ENDING, network

Sources = tuple[tuple[str, str], ...]
"""Names of networks and functions, and what each process reads them from."""
_RIVALS = (bilinear, dlmmse, libraw, bm3d_dlmmse)


def render_preset(settings: RenderSettings, mosaic: Mosaic) -> FloatArray:
    """Render a shot with the off-camera renderer.

    Returns float32 (H, W, C), scene units of the shot.
    """
    return render(mosaic, settings).rgb


def _preset(name: str, title: str) -> Method:
    return Method(name, title, partial(render_preset, PRESETS[name]), ours=True)


@cache
def methods() -> dict[str, Method]:
    """All methods but networks, by name: ours, then those of a Bayer camera."""
    titles = {"paper": "paper", "best": "best", "unlearned": "best, unlearned"}
    presets = (_preset(name, f"Sparse colour, {title}") for name, title in titles.items())
    preview = Method("preview", "Sparse colour, preview", linear_preview, ours=True)
    rivals = (method for module in _RIVALS for method in module.METHODS)
    return {method.name: method for method in (*presets, preview, *rivals)}


def default_names() -> list[str]:
    """Names of all methods whose packages are installed."""
    return [name for name, method in methods().items() if method.missing is None]


def missing_packages() -> list[str]:
    """Packages that methods need and that are not installed."""
    return sorted({method.missing for method in methods().values() if method.missing})


def choose(names: list[str]) -> list[Method]:
    """Methods by name, networks by file, functions by source and name, each once.

    Raises InputError for an unknown name, one whose package is not installed, and as `network` and
    `function` do.
    """
    chosen: dict[str, Method] = {}
    for name in names:
        if name.endswith(ENDING) or ":" in name:
            method = _of_source(name)
        elif name in methods():
            method = methods()[name]
        else:
            others = "networks by `rival`, and functions by FILE.py:FUNCTION or MODULE:FUNCTION"
            known = f"{', '.join(methods())}, {others}{meant(name, methods())}"
            raise InputError(f"unknown method {name!r}; there are {known}")
        if method.missing:
            remedy = f"pip install {method.missing}, or leave it out of `methods`"
            raise InputError(f"{name} needs the package {method.missing}: {remedy}")
        chosen[method.name] = method
    return list(chosen.values())


@cache
def find_method(name: str, sources: Sources = ()) -> Method:
    """Return a method by its name, in any process.

    Raises InputError if the file of a network or function has changed or is gone.
    """
    source = dict(sources).get(name)
    method = _of_source(source) if source else methods()[name]
    if method.name != name:
        raise InputError(f"{source}: {CHANGED}")
    return method


def _of_source(source: str) -> Method:
    return network(source) if source.endswith(ENDING) else function(source)
