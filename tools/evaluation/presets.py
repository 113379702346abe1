"""The presets of the off-camera renderer, by name, and `best` without what it has learned."""

from dataclasses import replace

from offline import BEST, PAPER, RenderSettings, render
from shared import Mosaic
from shared.arrays import FloatArray

PRESETS = {"paper": PAPER, "best": BEST}
UNLEARNED = replace(BEST, learned=PAPER.learned)


def render_preset(settings: RenderSettings, mosaic: Mosaic) -> FloatArray:
    """Render a shot with the off-camera renderer. Returns float32 (H, W, 3), scene units of the shot."""
    return render(mosaic, settings).rgb
