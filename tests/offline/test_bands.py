"""Rendered in bands: the same bytes, every row once."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, render, render_bands
from panchroma.offline import patches as product
from panchroma.offline.patches import band_rows
from panchroma.offline.settings import RenderSettings
from panchroma.offline.stages.refinement import RefinementSettings
from panchroma.shared import CfaPattern, Mosaic
from panchroma.shared.arrays import FloatArray
from tests.offline.scenes import shot

SHAPES = [(300, 41), (437, 90), (701, 33), (60, 400)]


def at_once(mosaic: Mosaic, settings: RenderSettings) -> FloatArray:
    """The picture, rendered as one band: `render` has as many as `render_bands`."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(product, "_BAND", 1 << 30)
        assert len(band_rows(mosaic.pattern.grid(mosaic.shape))) == 1
        return render(mosaic, settings).rgb


# forty-five repetitions look further than a band is high
REPEATED = [
    replace(PAPER, refinement=RefinementSettings(repetitions=repetitions))
    for repetitions in (0, 1, 5, 45)
]


@pytest.mark.parametrize(
    ("period", "shape", "presets"),
    [
        *zip((3, 4, 6, 8, 6, 4), [*SHAPES, SHAPES[0], SHAPES[2]], [(PAPER, BEST)] * 6, strict=True),
        (6, (400, 14), REPEATED),
    ],
)
def test_bands_are_the_whole(
    period: int, shape: tuple[int, int], presets: Sequence[RenderSettings]
) -> None:
    mosaic = shot(CfaPattern.bayer(period, origin=(period - 1, 1)), shape)
    for settings in presets:
        found = list(render_bands(mosaic, settings))
        assert len(found) > 1 or settings is BEST or shape[0] < 300
        assert np.array_equal(np.concatenate(found), at_once(mosaic, settings))
