"""Rendering shots at full quality."""

from __future__ import annotations  # help() then shows them as they are written here

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from shared.errors import InputError
from shared.spelling import meant
from tools.host.console import to_stderr
from tools.pictures.kind import PictureKind
from tools.rendering.white_balance import WhiteBalance

from .pictures import Picture
from .shots import Shot, as_shot
from .wording import for_notebooks

_AS_ARRAY = PictureKind("npy", 32, "camera")


@for_notebooks
def render(shot: Shot | str | Path, *, preset: str = "best", learned: bool = True, wb: str | Sequence[float] = "camera") -> Picture:
    """Reconstruct every channel at every pixel, on all processors. The same shot gives the same picture, to the bit.

    The first render on a machine compiles the renderer, which takes a minute or two and is said on standard error; in a terminal,
    `panchroma doctor --compile` does it ahead, on all processors.

    shot: a `Shot`, or the name of its file.
    preset: "best", or "paper": the method as published.
    learned: of "best": correct colour by the network that comes with the program.
    wb: white balance of what is shown and saved: "camera" (as shot), "auto" (estimated), or multipliers (2.1, 1, 1.6); it does not
        change `Picture.rgb`.
    Raises PanchromaError for a shot that is all black, or all saturated, and for one that needs more memory than is free.

    >>> import panchroma
    >>> shot = panchroma.simulate("builtin:120x90", sigma=0.01)
    >>> panchroma.render(shot)
    <Picture 120 x 90, linear R, G, B>
    """
    from offline import BEST, PAPER, SolverLog, render_bands
    from tools.host.memory import allowed_memory, format_bytes
    from tools.host.progress import StageProgress
    from tools.pictures.samples import joined
    from tools.rendering.checks import check_light, needed_memory
    from tools.rendering.compilation import announced_compilation

    settings = {"best": BEST if learned else replace(BEST, learned=PAPER.learned), "paper": PAPER}.get(preset)
    if settings is None:
        raise InputError(f"preset is {preset!r}, expected 'best' or 'paper'{meant(preset, ('best', 'paper'))}")
    if not isinstance(wb, Iterable):
        raise InputError(f'wb is {wb!r}, expected "camera", "auto" or one multiplier for each channel')
    white = WhiteBalance.parse(wb if isinstance(wb, str) else ",".join(map(str, wb)))
    shot = as_shot(shot)
    mosaic = white.of(shot.mosaic)
    check_light(mosaic, settings)
    if (need := needed_memory(mosaic, _AS_ARRAY, settings)) > (free := allowed_memory(None)):
        rows, columns = mosaic.shape
        raise InputError(
            f"a picture of {columns} x {rows} pixels needs {format_bytes(need)} of memory, and {format_bytes(free)} are free; "
            "close other notebooks, or use the command `panchroma render`, which needs less: it writes while it renders"
        )
    log = SolverLog(progress := StageProgress(note=to_stderr))
    with announced_compilation(progress):
        rgb = joined(render_bands(mosaic, settings, log), mosaic.shape[0])
    level, restored = shot.truth.white if shot.truth else 1.0, settings.highlights.restored
    return Picture(rgb, mosaic.calibration, mosaic.metadata, level, restored, log.places)
