"""Kernels that a render needs, so that a program can compile them before the first one, side by
side in several processes.

Kernels that are not compiled ahead are compiled when they are first called. Nothing in `offline`
starts processes.
"""

from importlib import import_module

import numpy as np

from ..shared.calibration import SensorCalibration
from ..shared.mosaic import Mosaic
from ..shared.pattern import CfaPattern
from .measured import Measured
from .numerics.compile import ParallelKernel, can_keep, kernels
from .render import KERNELS, row_stages
from .settings import RenderSettings

# Those that take longest to compile come first, so that several processes end at about the same
# time.
_LONGEST = "solve_regions", "average", "denoise", "fill_blocks", "shrink_once"


def used_kernels(*settings: RenderSettings) -> list[str]:
    """Names of the kernels that renders with these settings may call, without any settings of all
    kernels.

    Those that only scattered colour sites need are not among them: they are compiled when they are
    called.
    """
    frame = Measured.outline(
        Mosaic(np.zeros((24, 24), np.float32), CfaPattern.bayer(), SensorCalibration())
    )
    used = set() if settings else set(_all_kernels())
    for preset in settings:
        used.update(KERNELS, *(part.kernels for part in vars(preset).values() if part.used))
        used.update(*(stage.kernels for stage in row_stages(frame, preset)))
    return sorted(
        used, key=lambda name: (_LONGEST.index(name) if name in _LONGEST else len(_LONGEST), name)
    )


def kernels_to_compile(*settings: RenderSettings) -> list[str]:
    """Names of the kernels that renders with these settings may call and that are neither loaded
    nor on the disk yet.

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
    RuntimeError
        When there are some, and no folder to keep them in.

    Examples
    --------
    >>> from panchroma.offline import BEST, PAPER, kernels_to_compile
    >>> set(kernels_to_compile(PAPER)) <= set(kernels_to_compile(PAPER, BEST))
    True
    """
    used = used_kernels(*settings)
    names = [name for name in used if not (kernels[name].ready or kernels[name].kept())]
    if names and not can_keep():
        raise RuntimeError("there is no folder that can be written to, for compiled kernels")
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
