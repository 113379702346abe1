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

__all__ = ["BEST", "PAPER", "PRESETS", "UNLEARNED", "RenderSettings", "Rendering", "render"]
__all__ += ["colour_bands", "network_name", "render_bands", "rendering_memory"]
__all__ += ["Band", "Frame", "Halo", "RowStage", "Stages", "clean_frame", "estimate_colour"]
__all__ += ["measure", "row_stages"]
__all__ += ["compilation", "compile_kernel", "kernel_cache", "kernels_to_compile"]
__all__ += ["available_threads", "threads", "use_threads"]
