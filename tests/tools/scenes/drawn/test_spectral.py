import numpy as np
import pytest

from shared import CfaPattern
from shared.colorimetry import D50
from tools.camera.filters import Filters, filters_for
from tools.scenes.drawn.builtin import ASPECT, GAP, HEIGHT
from tools.scenes.drawn.spectral import BANDS, CHARTS, PATCHES, light, metamers, spectral_scene
from tools.scenes.scene import Scene

ROUNDING = 2e-6  # of sums of float32


@pytest.fixture(scope="module")
def scene() -> Scene:
    return spectral_scene(600, 400)


def filters(block: tuple[str, ...], scene: Scene) -> Filters:
    return filters_for(CfaPattern.with_block(block, period=6), scene)


@pytest.mark.parametrize(("block", "gamma"), [(("RG", "GB"), 1.0), (("CM", "YC"), 0.5), (("HIJ", "KWL", "NOP"), 1.0)])
def test_filters_share_out_all_light(block: tuple[str, ...], gamma: float, scene: Scene) -> None:
    """Eq. 7 holds exactly: what the filters read adds up to what a panchromatic pixel reads."""
    made = filters(block, scene)
    assert made.gamma == pytest.approx([gamma] * len(made.channels), abs=1e-12)
    panchromatic = made.of(scene.rgb) @ np.array(made.gamma)
    assert panchromatic == pytest.approx(scene.rgb.sum(axis=2) * sum(made.gamma) / len(BANDS), abs=ROUNDING)


def test_metamers_differ_in_bands_alone(scene: Scene) -> None:
    for block in (("RG", "GB"), ("CM", "YC")):
        matrix = np.array(filters(block, scene).matrix)
        for one, other in metamers():
            assert min(one.min(), other.min()) > 0
            assert max(one.max(), other.max()) < 1
            assert matrix @ (light() * (one - other)) == pytest.approx(np.zeros(3), abs=1e-12)
            cosine = one @ other / np.sqrt(one @ one * (other @ other))
            assert np.rad2deg(np.arccos(cosine)) > 20


def test_the_metamers_are_in_the_picture(scene: Scene) -> None:
    """Where the layout puts the chart, red, green and blue filters see even surfaces."""
    size = round(HEIGHT * min(600 / ASPECT, 400))
    gap = (600 - sum(round(size * aspect) for aspect, _ in CHARTS)) / (len(CHARTS) + 1)
    top, left = 400 - size - round(GAP * 400), round(gap + round(size * CHARTS[0][0]) + gap)
    lettering = scene.rgb[top + round(0.72 * size) : top + size - 1, left + 1 : left + size - 1]
    assert np.ptp(lettering, axis=(0, 1)).max() > 0.5
    assert np.ptp(filters(("RG", "GB"), scene).of(lettering), axis=(0, 1)).max() < ROUNDING


def test_it_knows_its_colours(scene: Scene) -> None:
    assert scene.neutral == tuple(light())
    to_xyz = np.array(scene.camera_to_xyz)
    assert to_xyz @ light() == pytest.approx(D50, abs=1e-12)
    x, y, z = to_xyz @ (PATCHES[[12, 13, 14]] * light()).T  # blue, green, red
    assert np.argmax(x / y) == 2
    assert np.argmax(z / y) == 0


def test_another_light_falls_on_the_same_surfaces(scene: Scene) -> None:
    warm = spectral_scene(scene.shape[1], scene.shape[0], "A")
    assert list(warm.neutral) == sorted(warm.neutral)  # the longer the wavelength, the brighter
    np.testing.assert_allclose(warm.rgb / warm.neutral, scene.rgb / light(), atol=1e-5)
    assert np.array(warm.camera_to_xyz) @ warm.neutral == pytest.approx(D50, abs=1e-12)
