"""Our own methods: the presets of the off-camera renderer, and the camera's preview."""

from dataclasses import asdict
from functools import partial

import numpy as np

from offline import PRESETS, RenderSettings, render
from offline.version import ALGORITHM
from shared import Mosaic
from shared.arrays import FloatArray
from tools.pictures.previews import linear_preview, preview_version

from .method import Method


def render_preset(settings: RenderSettings, mosaic: Mosaic) -> FloatArray:
    """Render a shot with the off-camera renderer. Returns float32 (H, W, C), scene units of the shot."""
    return render(mosaic, settings).rgb


def render_stated(settings: RenderSettings, mosaic: Mosaic) -> FloatArray:
    """As `render_preset`, with `offline.Rendering.uncertainty` behind the channels: float32 (H, W, C + 1 + C)."""
    found = render(mosaic, settings, uncertainty=True)
    return np.concatenate([found.rgb, found.uncertainty], axis=2) if found.uncertainty is not None else found.rgb


def _preset(name: str, title: str, seconds: float) -> Method:
    settings = PRESETS[name]
    version, packages = [ALGORITHM, asdict(settings)], ("onnxruntime",) if settings.learned.used else ()
    function = partial(render_stated if settings.pooling.used else render_preset, settings)
    return Method(name, f"Sparse colour, {title}", function, version, ours=True, sparse=True, packages=packages, seconds=seconds)


METHODS = (
    _preset("paper", "paper", 0.3),
    _preset("best", "best", 2),
    _preset("unlearned", "best, unlearned", 2),
    Method(
        "preview",
        "Sparse colour, preview",
        linear_preview,
        preview_version(),
        ours=True,
        sparse=True,
        packages=("onnxruntime",),
        seconds=0.1,
    ),
)
