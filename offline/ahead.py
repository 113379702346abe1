"""Kernels that a render needs, so that a program can compile them before the first one, side by
side in several processes.

Kernels that are not compiled ahead are compiled when they are first called. Nothing in `offline`
starts processes.
"""

from importlib import import_module

from .numerics.compile import ParallelKernel, kernels, writable_cache
from .settings import RenderSettings

# Those that take longest to compile come first, so that several processes end at about the same
# time.
_LONGEST = "solve_fields", "average", "denoise", "fill_blocks", "shrink_once"
_SETTINGS = {"colour_lines": "lines", "colour_network": "learned"}  # that use other stages' modules
_RARE = "solve_linked"  # for scattered colour sites, and for bursts


def used_kernels(*settings: RenderSettings) -> list[str]:
    """Names of the kernels of the stages that renders with these settings use, and of those that
    stages share; without any settings of all kernels.

    Those that only scattered colour sites need are not among them: they are compiled when they are
    called.
    """
    used = [
        name
        for name, kernel in (kernels if settings else _all_kernels()).items()
        if not settings or (name != _RARE and any(_is_used(kernel, preset) for preset in settings))
    ]
    return sorted(
        used, key=lambda name: (_LONGEST.index(name) if name in _LONGEST else len(_LONGEST), name)
    )


def _is_used(kernel: ParallelKernel[...], settings: RenderSettings) -> bool:
    *_, room, module = kernel.function.__module__.split(".")
    if room == "stages":
        return getattr(settings, _SETTINGS.get(module, module)).used
    return room == "numerics"


def kernels_to_compile(*settings: RenderSettings) -> list[str]:
    """Names of the kernels that renders with these settings may call and that are neither loaded
    nor on the disk yet, see `used_kernels`.

    Parameters
    ----------
    settings : RenderSettings
        Without any, all kernels.

    Returns
    -------
    list[str]
        Those that take longest first.

    Raises
    ------
    OutputError
        When there are some, and no folder to keep them in.

    Examples
    --------
    >>> from panchroma.offline import BEST, PAPER, kernels_to_compile
    >>> set(kernels_to_compile(PAPER)) <= set(kernels_to_compile(PAPER, BEST))
    True
    """
    used = used_kernels(*settings)
    names = [name for name in used if not (kernels[name].ready or kernels[name].kept())]
    if names:
        writable_cache()
    return names


def compile_kernel(name: str) -> None:
    """Compile a kernel and keep it on the disk; reads it if it is there already.

    Raises
    ------
    KeyError
        For an unknown name.

    Examples
    --------
    >>> from panchroma.offline import compile_kernel, kernels_to_compile
    >>> compile_kernel("mix")
    >>> "mix" in kernels_to_compile()
    False
    """
    _all_kernels()[name].compile()


def _all_kernels() -> dict[str, ParallelKernel[...]]:
    """The kernels by name, those of bursts among them."""
    import_module(f"{__package__}.burst")  # a kernel is known once its module is imported
    return kernels
