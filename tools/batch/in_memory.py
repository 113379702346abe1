"""Render shots to arrays, and preview them, for programs that keep the picture: the notebook, the
demonstration, calibration.
"""

from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from ...shared import ByteArray, CfaPattern, FloatArray, InputError, Mosaic
from ...shared.figures import whole
from ...shared.processors import processors
from ..io.display import joined
from ..io.kind import PictureKind
from .burst_files import BurstOrder, BurstSubject, Read
from .compilation import announced_compilation, compile_ahead
from .console import LOG, one_line
from .jobs import Job
from .memory import Limit, allowed_memory, check_memory
from .order import check_light, settings_named
from .progress import REMARKS, StageProgress

if TYPE_CHECKING:  # onnxruntime is slow to load, and help needs none
    from ...device import Preview
    from ...offline import Rendering, RenderSettings, Stages

_AS_ARRAY = PictureKind("npy", 32, "camera")


@lru_cache(REMARKS)
def note_once(text: str) -> None:
    """Log a remark, each once in a run: programs open and simulate many shots."""
    LOG.warning("%s", one_line(text))


def render_array(
    mosaic: Mosaic, settings: "RenderSettings", stages: "Stages | None", memory: Limit
) -> tuple[FloatArray, ByteArray | None]:
    """The picture, float32 (H, W, C), scene units, and where the shot does not tell what the light
    was (`offline.Rendering.lost`).

    The log has a note while the renderer is being compiled.

    stages: makes the list of stages in rows, as `offline.render` takes it; None =
    `offline.row_stages`. Raises InputError for a shot that is all black, or all saturated, and for
    one that needs more than `memory` (see `allowed_memory`).
    """
    from ...offline import colour_bands, measure, row_stages

    check_light(mosaic, settings)
    check_memory(mosaic, _AS_ARRAY, settings, allowed_memory(memory))
    with StageProgress(note=note_once) as progress, announced_compilation(progress):
        measured = measure(mosaic, settings, progress)
        bands = colour_bands(measured, settings, progress, row_stages if stages is None else stages)
        return joined(bands, mosaic.shape[0]), measured.lost


def renderings(mosaic: Mosaic, progress: StageProgress, *presets: str) -> list["Rendering"]:
    """Render a shot with each of these presets; kernels are compiled first, on all processors."""
    from ...offline import render

    with announced_compilation(progress):
        compile_ahead(processors(), progress)
        return [render(mosaic, settings_named(preset), progress) for preset in presets]


def merged_picture(
    names: Sequence[str], progress: StageProgress, read: Read, memory: Limit, **settings: Any
) -> tuple[FloatArray, BurstSubject]:
    """The picture of a burst, float32 (H, W, C), scene units, and what became of its frames.

    Raises InputError if a frame cannot be read, and as `BurstOrder.open` does.

    names: of the frames. memory: see `allowed_memory`. settings: of the `BurstOrder` that are
    not usual.
    """
    order = BurstOrder(folder=Path(), kind=_AS_ARRAY, **settings)
    job, limit = Job(names[0], frames=tuple(names)), allowed_memory(memory)
    with announced_compilation(progress):
        subject = order.open(job, limit, progress.note, read)
        for error in subject.errors:
            raise InputError(error)
        subject.prepare(progress)
        mosaic = subject.mosaic  # which one frame alone gives up
        rgb = joined(subject.bands(progress), mosaic.shape[0])
    subject.mosaic = mosaic
    return rgb, subject


def check_scale(scale: int) -> None:
    """Raise InputError for a scale of previews below 1."""
    if whole("`scale`", scale) < 1:
        raise InputError(f"`scale` is {scale}, expected 1 or more")


def camera_preview(mosaic: Mosaic, scale: int = 1, threads: int | None = None) -> ByteArray:
    """The camera's preview of a shot, uint8 sRGB (h, w, 3), oriented like the samples.

    scale, threads: see `Preview`. Raises InputError without such a scale.
    """
    check_scale(scale)
    # wherever it begins, the graph is the same
    pattern = mosaic.pattern.cropped(*mosaic.pattern.origin)
    return cast(ByteArray, _preview(pattern, int(scale), threads).run(mosaic))


@cache
def _preview(pattern: CfaPattern, scale: int, threads: int | None) -> "Preview":
    """Build the graph of a pattern once."""
    from ...device import Preview

    return Preview(pattern, scale, threads=threads)


def linear_preview(mosaic: Mosaic) -> FloatArray:
    """The camera's preview of a shot at full size, without display processing: float32 (H, W, 3),
    scene units of the shot.
    """
    from ...device import Preview

    return cast(FloatArray, Preview(mosaic.pattern, linear=True, threads=1).run(mosaic))
