from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import product
from unittest.mock import Mock

import numpy as np
import pytest

from panchroma.device import Preview
from panchroma.device.preview import preview as runtime
from panchroma.device.preview.geometry import Geometry
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import CodeArray
from panchroma.shared.errors import InputError
from panchroma.tools.io.colour import encode_srgb
from panchroma.tools.simulation.sensor import sample
from tests.scenes import darker_corners


def codes(shape: tuple[int, int], seed: int = 0) -> CodeArray:
    return np.random.default_rng(seed).integers(200, 4000, shape, np.uint16)


def shot(
    shape: tuple[int, int] = (61, 83), pattern: CfaPattern | None = None, seed: int = 0
) -> Mosaic:
    pattern = pattern or CfaPattern.bayer(6, origin=(4, 1))
    planes = len(pattern.channels) + 1
    noise, black = NoiseModel((1e-4,) * planes, (1e-3,) * planes), (256.0,) * planes
    camera = SensorCalibration(pattern.channels, noise=noise, black_level=black, white_level=3840)
    return Mosaic(codes(shape, seed), pattern, camera)


@pytest.mark.parametrize(("scale", "linear"), list(product((1, 2, 3), (False, True))))
def test_strips_and_threads_do_not_show(
    scale: int, linear: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    mosaic = shot((97, 83))
    shading = darker_corners(mosaic.shape)
    mosaic = mosaic.calibrated(replace(mosaic.calibration, shading=shading))
    monkeypatch.setattr(runtime, "_STRIP_PIXELS", 1 << 30)
    whole = Preview.for_mosaic(mosaic, scale, linear, threads=1).run(mosaic)
    for pixels, threads in ((1, 1), (1, 3), (1500, 2), (4000, 5)):
        monkeypatch.setattr(runtime, "_STRIP_PIXELS", pixels)
        picture = Preview.for_mosaic(mosaic, scale, linear, threads=threads).run(mosaic)
        assert np.array_equal(picture, whole)


def test_threads_are_those_of_the_program_or_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    pools, mosaic = Mock(wraps=ThreadPoolExecutor), shot()
    monkeypatch.setattr(runtime, "ThreadPoolExecutor", pools)
    preview = Preview.for_mosaic(mosaic)
    for number in (3, 2):  # may change after it is built
        monkeypatch.setattr(runtime, "chosen_threads", lambda number=number: number)
        preview.run(mosaic)
    Preview.for_mosaic(mosaic, threads=1).run(mosaic)
    assert [call.args[0] for call in pools.call_args_list] == [3, 2, 1]


@pytest.mark.parametrize("shape", [(2, 2), (3, 17), (40, 2), (13, 14), (64, 7)])
@pytest.mark.parametrize(
    "pattern",
    [CfaPattern.bayer(4), CfaPattern.bayer(6, "BGGR"), CfaPattern.bayer(7), CfaPattern.bayer(16)],
)
def test_any_size(shape: tuple[int, int], pattern: CfaPattern) -> None:
    mosaic = shot(shape, pattern)
    for scale, linear in product((1, 4) if pattern.period % 4 == 0 else (1,), (False, True)):
        picture = Preview(pattern, scale, linear=linear, threads=1).run(mosaic)
        assert picture.shape == (max(shape[0] // scale, 1), max(shape[1] // scale, 1), 3)
        assert np.isfinite(picture).all()


def test_one_preview_serves_all_cameras_and_sizes() -> None:
    mosaic, other = shot(), shot((40, 52), CfaPattern.bayer(6, origin=(2, 3)), 1)
    camera = SensorCalibration(neutral=(0.3, 0.6, 0.9), white_level=3000, black_level=(9,) * 4)
    warm = Mosaic(mosaic.codes, mosaic.pattern, camera)
    preview = Preview.for_mosaic(mosaic)
    pictures = [preview.run(each) for each in (mosaic, other, warm, mosaic)]
    fresh = [Preview.for_mosaic(each).run(each) for each in (mosaic, other, warm, mosaic)]
    assert all(np.array_equal(*pair) for pair in zip(pictures, fresh, strict=True))
    assert not np.array_equal(pictures[0], pictures[2])


def test_many_callers_at_once() -> None:
    mosaics = [shot(seed=seed) for seed in range(6)]
    preview = Preview.for_mosaic(mosaics[0], threads=2)
    expected = [preview.run(mosaic) for mosaic in mosaics]
    with ThreadPoolExecutor(6) as pool:
        pictures = list(pool.map(preview.run, mosaics * 3))
    assert np.array_equal(pictures, expected * 3)


def test_an_error_in_a_strip_comes_up(monkeypatch: pytest.MonkeyPatch) -> None:
    mosaic = shot()
    preview = Preview.for_mosaic(mosaic, threads=2)

    monkeypatch.setattr(preview, "_session", Mock(run=Mock(side_effect=MemoryError("strip"))))
    with pytest.raises(MemoryError, match="strip"):
        preview.run(mosaic)


def test_another_pattern_is_refused_with_both_named() -> None:
    preview = Preview.for_mosaic(shot(pattern=CfaPattern.bayer(4)))
    words = r"pattern BWWG/WWWW/WWWW/GWWR, the mosaic has GWWB/WWWW/WWWW/RWWG"
    with pytest.raises(InputError, match=words):
        preview.run(shot(pattern=CfaPattern.bayer(4, "GRBG")))
    with pytest.raises(InputError, match="channels RGB, the mosaic has BGR"):
        preview.run(shot(pattern=CfaPattern(CfaPattern.bayer(4).tile, channels="BGR")))
    with pytest.raises(InputError, match="`threads` is 0"):
        Preview(CfaPattern.bayer(), threads=0)


def test_scales() -> None:
    assert Geometry.scales(CfaPattern.bayer(6)) == (1, 2, 3, 6)
    assert Geometry.scales(CfaPattern.bayer(7)) == (1, 7)
    # A block that fills a macropixel leaves it no light.
    crowded = CfaPattern.with_block(("RGRG", "GBGB", "RGRG", "GBGB"), 8)
    with pytest.raises(InputError, match="2 x 2 sensor pixels: a pattern of period 8 has 1, 4, 8"):
        Preview(crowded, 2)


def test_other_channels_without_a_colour_matrix_are_shown_as_grey_light() -> None:
    pattern = CfaPattern.of_letters("ABCDW/EFGHW/WWWWW/WWWWW/WWWWW")
    calibration = SensorCalibration.of_bits(12, channels=pattern.channels)
    light = np.linspace(0.2, 1.0, 8) * np.linspace(0.1, 1, 60)[:, None, None] * np.ones((60, 45, 8))
    mosaic = Mosaic(sample(light.astype(np.float32), pattern, calibration), pattern, calibration)
    shown = Preview.for_mosaic(mosaic).run(mosaic)
    assert np.ptp(shown.astype(int), axis=2).max() <= 1
    wanted = 255 * encode_srgb((light.sum(axis=2) / 8).astype(np.float32))
    assert np.abs(shown[..., 1] - wanted)[6:-6].max() < 2


@pytest.mark.parametrize("pattern", [CfaPattern.bayer(6), CfaPattern.of_letters("kodak")], ids=str)
def test_clipped_strokes_beside_the_dark_stay_white(pattern: CfaPattern) -> None:
    down, right = np.mgrid[:480, :640] / 4
    fence = np.where((right + 0.4 * down) % 9.5 < 7.3, 3.0, 0.45)
    grey = fence.reshape(120, 4, 160, 4).mean(axis=(1, 3)).astype(np.float32)
    calibration = SensorCalibration.of_bits(12, headroom=False)
    light = grey[..., None].repeat(3, axis=2)
    shot = Mosaic(sample(light, pattern, calibration), pattern, calibration)
    picture = Preview.for_mosaic(shot).run(shot).astype(int)
    assert (np.ptp(picture, axis=2) > 120).mean() < 0.003
