"""Render a shot to an array, for programs that keep the picture: the notebook, and the demonstration."""

from typing import TYPE_CHECKING

from shared import Mosaic
from shared.arrays import ByteArray, FloatArray
from shared.errors import InputError
from shared.spelling import meant
from tools.host.console import to_stderr
from tools.host.memory import allowed_memory, format_bytes
from tools.host.progress import StageProgress
from tools.pictures.kind import PictureKind
from tools.pictures.samples import joined

from .checks import check_light, needed_memory
from .compilation import announced_compilation

if TYPE_CHECKING:
    from offline import RenderSettings

__all__ = ["RenderSettings", "render_array", "settings_named"]

_AS_ARRAY = PictureKind("npy", 32, "camera")


def settings_named(preset: object) -> "RenderSettings":
    """The settings of a preset by name, or settings of one's own. Raises InputError for anything else."""
    from offline import PRESETS, RenderSettings

    if isinstance(preset, RenderSettings):
        return preset
    if preset not in PRESETS:
        guess = meant(preset, PRESETS) if isinstance(preset, str) else ""
        raise InputError(f"`preset` is {preset!r}, expected one of {', '.join(PRESETS)}, or offline.RenderSettings{guess}")
    return PRESETS[str(preset)]


def render_array(mosaic: Mosaic, settings: "RenderSettings") -> tuple[FloatArray, ByteArray | None]:
    """The picture, float32 (H, W, C), scene units, and where the shot does not tell what the light was (`SolverLog.places`).

    Standard error has a note while the renderer is being compiled.
    Raises InputError for a shot that is all black, or all saturated, and for one that needs more memory than is free.
    """
    from offline import SolverLog, render_bands

    check_light(mosaic, settings)
    if (need := needed_memory(mosaic, _AS_ARRAY, settings)) > (free := allowed_memory(None)):
        rows, columns = mosaic.shape
        raise InputError(
            f"a picture of {columns} x {rows} pixels needs {format_bytes(need)} of memory, and {format_bytes(free)} are free; "
            "close other programs, or use the command `panchroma render`, which needs less: it writes while it renders"
        )
    log = SolverLog(progress := StageProgress(note=to_stderr))
    with announced_compilation(progress):
        picture = joined(render_bands(mosaic, settings, log), mosaic.shape[0])
    return picture, log.places
