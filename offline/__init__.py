"""The full-quality render: `render(mosaic).rgb` is the scene, float32 (H, W, C), scene units; `render_bands` yields it in bands."""

from .ahead import compile_kernel, kernels_to_compile
from .kernels.compile import available_threads, compilation, kernel_cache, threads, use_threads
from .memory import rendering_memory
from .render import Rendering, render, render_bands, warm_up
from .rows.learned import network_name
from .settings import BEST, PAPER, PRESETS, RenderSettings
from .solvers import Solved, SolverLog

__all__ = [
    "BEST",
    "PAPER",
    "PRESETS",
    "RenderSettings",
    "Rendering",
    "Solved",
    "SolverLog",
    "available_threads",
    "compilation",
    "compile_kernel",
    "kernel_cache",
    "kernels_to_compile",
    "network_name",
    "render",
    "render_bands",
    "rendering_memory",
    "threads",
    "use_threads",
    "warm_up",
]
