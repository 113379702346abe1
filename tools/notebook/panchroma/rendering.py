"""Rendering shots at full quality."""

from __future__ import annotations  # help() then shows them as they are written here

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tools.rendering.in_memory import render_array, settings_named
from tools.rendering.white_balance import WhiteBalance

from .arguments import checked
from .pictures import Picture
from .shots import Shot, as_shot

if TYPE_CHECKING:
    from tools.rendering.in_memory import RenderSettings, Stages


@checked
def render(
    shot: Shot | str | Path,
    *,
    preset: str | RenderSettings = "best",
    wb: str | Sequence[float] = "camera",
    stages: Stages | None = None,
    uncertainty: bool = False,
) -> Picture:
    """Reconstruct every channel at every pixel, on all processors. The same shot gives the same picture, to the bit.

    The first render on a machine compiles the renderer, which takes a minute or two and is said on standard error; in a terminal,
    `panchroma doctor --compile` does it ahead, on all processors.

    shot: a `Shot`, or the name of its file.
    preset: "best"; "unlearned": best without the network that corrects colour; "paper": the method as published; or settings of
        your own, such as dataclasses.replace(offline.BEST, ...).
    wb: white balance of what is shown and saved: "camera" (as shot), "auto" (estimated), or multipliers (2.1, 1, 1.6); it does not
        change `Picture.rgb`.
    stages: makes the list of stages that go over the picture in rows, as `offline.render` takes it; None = those of the settings.
    uncertainty: state how far each pixel may be off (`Picture.uncertainty`); not for the preset "paper".
        It takes up to a fifth longer.
    Raises PanchromaError for a shot that is all black, or all saturated, and for one that needs more memory than is free.

    >>> import panchroma
    >>> shot = panchroma.simulate("builtin:120x90", sigma=0.01)
    >>> panchroma.render(shot)
    <Picture 120 x 90, linear R, G, B>
    >>> panchroma.render(shot, uncertainty=True).uncertainty.sigma.shape
    (90, 120, 4)
    """
    settings, white = settings_named(preset), WhiteBalance.parse(wb)
    shot = as_shot(shot)
    mosaic = white.of(shot.mosaic)
    found, lost = render_array(mosaic, settings, stages, uncertainty=uncertainty)
    rgb, stated = np.split(found, [len(mosaic.pattern.channels)], axis=2)
    level, restored = shot.truth.white if shot.truth else 1.0, settings.highlights.restored
    return Picture(rgb, mosaic.calibration, mosaic.metadata, level, restored, lost, stated if uncertainty else None)
