"""The methods that are compared, by name. A new rival is a file in `rivals` with METHODS, and its name in this file."""

from functools import cache

from shared.errors import InputError
from shared.spelling import meant

from . import ours
from .method import Method
from .rivals import bilinear, colour_demosaicing, demosaicnet, denoising, dlmmse, libraw, network, opencv, plane_denoising, planes

_RIVALS = (planes, plane_denoising, bilinear, colour_demosaicing, dlmmse, libraw, opencv, demosaicnet, denoising)


class _Methods(dict[str, Method]):
    """The methods, and those of networks by the names of their files: every process that is told a name finds its method."""

    def __missing__(self, name: str) -> Method:
        if not name.endswith(network.ENDING):
            raise KeyError(name)
        return network.network(name)  # not kept: the list is of methods that anyone has


@cache
def methods() -> dict[str, Method]:
    """All methods by name: ours, then the others for any pattern, then those of a Bayer camera; and any network by its file's."""
    return _Methods((method.name, method) for module in (ours, *_RIVALS) for method in module.METHODS)


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
