"""The full-quality render: `render(mosaic, PAPER).rgb` is the scene, (H, W, C) float32; `render_bands` makes it row by row."""

from .kernels.compile import available_threads, compilation, threads, use_threads
from .render import Rendering, band_rows, render, render_bands
from .settings import BEST, PAPER, RenderSettings

__all__ = [
    "BEST",
    "PAPER",
    "RenderSettings",
    "Rendering",
    "available_threads",
    "band_rows",
    "compilation",
    "render",
    "render_bands",
    "threads",
    "use_threads",
]
