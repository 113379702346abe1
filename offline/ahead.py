"""Which kernels a render needs, so that a program can compile them before the first one, side by side in several processes.

Kernels that are not compiled ahead are compiled when they are first called. Nothing in `offline` starts processes.
"""

from collections.abc import Callable

from .kernels import displacement, merging, smoothing, spreading  # noqa: F401 - bursts use it, and no render: only this import makes it known here
from .kernels.compile import kernel_cache, kernels
from .settings import RenderSettings

# Kernel -> what uses it. Those that take longest to compile come first, so that several processes end at about the same time.
_USED: dict[str, Callable[[RenderSettings], bool]] = {
    "average": lambda settings: settings.refinement.repetitions > 0,
    "solve_regions": lambda _: True,
    "find_outliers": lambda settings: settings.defects.contrast > 0,
    "denoise": lambda settings: settings.denoising.strength > 0,
    "fill_blocks": lambda _: True,
    "shrink_once": lambda _: False,  # only for blocks that are too near to each other; then when it is called
    "shrink_margins": lambda _: True,
    "average_similar": lambda settings: settings.denoising.strength > 0,
    "solve_jointly": lambda settings: settings.chromaticity.mismatch > 0,
    "oriented_median": lambda settings: settings.chromaticity.taps > 1,
    "mend_panchromatic": lambda settings: settings.defects.listed or settings.defects.contrast > 0,
    "raise_clipped": lambda settings: settings.highlights.restored,
    "share_out": lambda settings: settings.sites.corrected,
    "mix": lambda _: True,
    "colour": lambda _: True,
    "pool": lambda settings: bool(settings.pooling.passes),
    "interpolate": lambda settings: settings.highlights.restored,
    "displacement_sums": lambda _: False,  # only for bursts
    "merge": lambda _: False,
    "smooth": lambda _: False,
    "displace": lambda _: False,
    "spread_samples": lambda _: False,
    "pin_samples": lambda _: False,  # only for patterns whose colour sites are scattered; then when it is called
    "undo_aberration": lambda _: False,  # only for lenses that have it; then when it is called
    "surroundings": lambda settings: settings.highlights.restored or settings.defects.listed or settings.defects.contrast > 0,
}


def used_kernels(*settings: RenderSettings) -> list[str]:
    """Names of the kernels that renders with these settings may call, without any settings of all kernels."""
    return [name for name, used in _USED.items() if not settings or any(map(used, settings))]


def kernels_to_compile(*settings: RenderSettings) -> list[str]:
    """Names of the kernels that renders with these settings may call and that are neither loaded nor on the disk yet.

    settings: without any, all kernels.
    Returns those that take longest first. Raises RuntimeError when there is no folder to keep them in.

    >>> from offline import BEST, PAPER, kernels_to_compile
    >>> set(kernels_to_compile(PAPER)) <= set(kernels_to_compile(PAPER, BEST)) <= set(kernels_to_compile())
    True
    """
    kernel_cache()
    return [name for name in used_kernels(*settings) if not (kernels[name].ready or kernels[name].kept())]


def compile_kernel(name: str) -> None:
    """Compile a kernel and keep it on the disk; reads it if it is there already. Raises KeyError for an unknown name.

    >>> from offline import compile_kernel, kernels_to_compile
    >>> compile_kernel("mix")
    >>> "mix" in kernels_to_compile()
    False
    """
    kernels[name].compile()
