"""Render shots to arrays, for programs that keep the picture: the notebook, the demonstration,
calibration.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

from ...shared import Mosaic
from ...shared.arrays import ByteArray, FloatArray
from ...shared.errors import InputError
from ...shared.processors import processors
from ..io.kind import PictureKind
from ..io.samples import joined
from .checks import check_light, needed_memory
from .compilation import announced_compilation, compile_ahead
from .console import LOG, one_line
from .memory import allowed_memory, format_bytes
from .progress import REMARKS, StageProgress

if TYPE_CHECKING:
    from ...offline import Rendering, RenderSettings, Stages

_AS_ARRAY = PictureKind("npy", 32, "camera")


@lru_cache(REMARKS)
def note_once(text: str) -> None:
    """Log a remark, each once in a run: programs open and simulate many shots."""
    LOG.warning("%s", one_line(text))


def settings_named(preset: object) -> "RenderSettings":
    """The settings of a preset by name, or settings of one's own.

    Raises InputError for anything else.
    """
    from ...offline import PRESETS, RenderSettings

    if isinstance(preset, RenderSettings):
        return preset
    if preset not in PRESETS:
        expected = f"one of {', '.join(PRESETS)}, or offline.RenderSettings"
        raise InputError(f"`preset` is {preset!r}, expected {expected}")
    return PRESETS[str(preset)]


def render_array(
    mosaic: Mosaic, settings: "RenderSettings", stages: "Stages | None" = None
) -> tuple[FloatArray, ByteArray | None]:
    """The picture, float32 (H, W, C), scene units, and where the shot does not tell what the light
    was (`offline.Rendering.lost`).

    The log has a note while the renderer is being compiled.

    stages: makes the list of stages in rows, as `offline.render` takes it; None =
    `offline.row_stages`. Raises InputError for a shot that is all black, or all saturated, and for
    one that needs more memory than is free.
    """
    from ...offline import colour_bands, measure, row_stages

    check_light(mosaic, settings)
    if (need := needed_memory(mosaic, _AS_ARRAY, settings)) > (free := allowed_memory(None)):
        rows, columns = mosaic.shape
        raise InputError(
            f"{columns} x {rows} pixels need {format_bytes(need)} of memory, {format_bytes(free)} "
            "are free; close other programs, or use the command panchroma render: it needs less"
        )
    with StageProgress(note=note_once) as progress, announced_compilation(progress):
        measured = measure(mosaic, settings, progress)
        bands = colour_bands(measured, settings, progress, row_stages if stages is None else stages)
        return joined(bands, mosaic.shape[0]), measured.lost


def renderings(
    mosaic: Mosaic, presets: Sequence[str], progress: StageProgress
) -> list["Rendering"]:
    """Render a shot with each of these presets; kernels are compiled first, on all processors."""
    from ...offline import render

    settings = [settings_named(preset) for preset in presets]
    with announced_compilation(progress):
        compile_ahead(processors(), progress)
        return [render(mosaic, setting, progress) for setting in settings]


def merged_picture(mosaics: Sequence[Mosaic], progress: StageProgress) -> FloatArray:
    """The picture of a burst, float32 (H, W, C), scene units; its first frame is the reference."""
    from ...offline import BEST
    from ...offline.burst import merge_burst, render_burst_bands

    with announced_compilation(progress):
        merged = merge_burst(mosaics, BEST, progress, reference=0)
        return joined(render_burst_bands(merged, BEST, progress), mosaics[0].shape[0])
