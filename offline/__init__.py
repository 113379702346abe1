"""The full-quality render: `render(mosaic).rgb` is the scene, float32 (H, W, C), scene units;
`render_bands` yields it in bands.
"""

from ..shared.processors import available_threads, threads, use_threads
from .ahead import compile_kernel, kernels_to_compile
from .bands import Band, Halo, RowStage
from .frame import Frame
from .memory import rendering_memory
from .numerics.compile import compilation, kernel_cache
from .pipeline import (
    Rendering,
    Stages,
    clean_frame,
    colour_bands,
    estimate_colour,
    measure,
    render,
    render_bands,
    row_stages,
)
from .settings import BEST, PAPER, PRESETS, UNLEARNED, RenderSettings
from .stages.colour_network import network_name

__all__ = [
    "BEST",
    "PAPER",
    "PRESETS",
    "UNLEARNED",
    "Band",
    "Frame",
    "Halo",
    "RenderSettings",
    "Rendering",
    "RowStage",
    "Stages",
    "available_threads",
    "clean_frame",
    "colour_bands",
    "compilation",
    "compile_kernel",
    "estimate_colour",
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
]
