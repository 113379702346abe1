"""The full-quality render: `render(mosaic).rgb` is the scene, float32 (H, W, C), scene units; `render_bands` yields it in bands."""

from shared.processors import available_threads, threads, use_threads

from .ahead import compile_kernel, kernels_to_compile
from .kernels.compile import compilation, kernel_cache
from .measured import Measured, Stages
from .memory import rendering_memory
from .parts import Look, Part, RowStage
from .render import Rendering, cleaned, colour_bands, coloured, measure, render, render_bands, row_stages, warm_up
from .rows.learned import network_name
from .settings import BEST, PAPER, PRESETS, RenderSettings
from .solvers import Solved, SolverLog

__all__ = [
    "BEST",
    "PAPER",
    "PRESETS",
    "Look",
    "Measured",
    "Part",
    "RenderSettings",
    "Rendering",
    "RowStage",
    "Solved",
    "SolverLog",
    "Stages",
    "available_threads",
    "cleaned",
    "colour_bands",
    "coloured",
    "compilation",
    "compile_kernel",
    "kernel_cache",
    "kernels_to_compile",
    "measure",
    "network_name",
    "render",
    "render_bands",
    "rendering_memory",
    "row_stages",
    "threads",
    "use_threads",
    "warm_up",
]
