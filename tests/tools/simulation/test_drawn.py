"""Drawn scenes: any size, repeatable, with the colours and charts that they say."""

from typing import Any

import numpy as np
import pytest

from panchroma.shared.errors import InputError
from panchroma.tools.io.colour import xyz_to_lab
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.drawn.builtin import ASPECT, CHARTS, GAP, HEIGHT, builtin_scene
from panchroma.tools.simulation.drawn.charts import COLOR_CHECKER_LAB
from panchroma.tools.simulation.load import load_scene

# yellow and cyan: less blue, and less red, than sRGB or the scene's darkest value
BROUGHT_IN = [15, 17]


def place(charts: Any, index: int) -> tuple[int, int, int]:
    """Where the layout puts a chart in a frame of 600 x 400 pixels: row, column and height."""
    size = round(HEIGHT * min(600 / ASPECT, 400))
    widths = [round(size * aspect) for aspect, _ in charts]
    gap = (600 - sum(widths)) / (len(charts) + 1)
    return 400 - size - round(GAP * 400), round((index + 1) * gap + sum(widths[:index])), size


@pytest.fixture(scope="module")
def scene() -> Scene:
    return builtin_scene(600, 400)


@pytest.mark.parametrize(
    ("width", "height"),
    [(1, 1), (2, 1), (1, 3), (7, 5), (64, 48), (143, 96), (144, 96), (61, 300), (300, 61)],
)
def test_any_size_works_and_repeats(width: int, height: int) -> None:
    first = builtin_scene(width, height)
    second = load_scene(first.name.replace("-", ":"))
    assert first.shape == (height, width)
    assert np.array_equal(first.rgb, second.rgb)
    assert np.float32(0.01) <= first.rgb.min() <= first.rgb.max() <= np.float32(0.95)


def test_patches_are_the_published_ones(scene: Scene) -> None:
    """Read from the picture where the layout puts them, through the scene's own matrix, into CIE
    L*a*b* again.
    """
    top, left, size = place(CHARTS, 0)
    for index, expected in enumerate(COLOR_CHECKER_LAB):
        row, column = (int((place + 0.5) * size / 4) for place in divmod(index, 6))
        patch = scene.rgb[top + row - 3 : top + row + 4, left + column - 3 : left + column + 4]
        assert np.ptp(patch, axis=(0, 1)).max() < 1e-6
        lab = xyz_to_lab(np.array(scene.camera_to_xyz) @ patch[0, 0])
        if index not in BROUGHT_IN:
            assert lab == pytest.approx(expected, abs=0.2)


@pytest.mark.parametrize("size", ["", "100", "0x5", "5x0", "-1x4", "1x1x1", "99999x99999"])
def test_bad_sizes_are_refused(size: str) -> None:
    with pytest.raises(InputError, match=r"builtin:1200x800|empty|raises it"):
        load_scene(f"builtin:{size}")
