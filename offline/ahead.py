"""Which kernels a render needs, so that a program can compile them before the first one, side by side in several processes.

Kernels that are not compiled ahead are compiled when they are first called. Nothing in `offline` starts processes.
"""

from importlib import import_module
from pkgutil import iter_modules

import numpy as np

from shared.calibration import SensorCalibration
from shared.mosaic import Mosaic
from shared.pattern import CfaPattern

from . import kernels as package
from .kernels.compile import kernel_cache, kernels
from .measured import Measured
from .render import KERNELS, row_stages
from .settings import RenderSettings

# Those that take longest to compile come first, so that several processes end at about the same time.
_LONGEST = "solve_regions", "average", "denoise", "fill_blocks", "shrink_once", "shrink_margins", "find_outliers"

for _module in iter_modules(package.__path__):  # a kernel is known when its module is imported; bursts have some of their own
    import_module(f"{package.__name__}.{_module.name}")


def used_kernels(*settings: RenderSettings) -> list[str]:
    """Names of the kernels that renders with these settings may call, without any settings of all kernels.

    Those that only scattered colour sites need are not among them: they are compiled when they are called.
    """
    frame = Measured.outline(Mosaic(np.zeros((24, 24), np.float32), CfaPattern.bayer(), SensorCalibration()))
    used = set() if settings else set(kernels)
    for each in settings:
        used.update(KERNELS, *(part.kernels for part in vars(each).values() if part.used))
        used.update(*(stage.kernels for stage in row_stages(frame, each)))
    return sorted(used, key=lambda name: (_LONGEST.index(name) if name in _LONGEST else len(_LONGEST), name))


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
