"""The page as a whole: equal to the reference, repeatable, and open about what it does."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from panchroma.offline import (
    BEST,
    PAPER,
    PRESETS,
    RenderSettings,
    clean_frame,
    colour_bands,
    estimate_colour,
    pipeline,
    render,
    render_bands,
)
from panchroma.offline.bands import Band, run_stages
from panchroma.offline.burst import merge_burst
from panchroma.offline.settings import UNLEARNED
from panchroma.offline.stages.affinity import AffinitySettings
from panchroma.offline.stages.denoising import denoise_luminance
from panchroma.offline.stages.luminance import recover_luminance
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration, Shading
from panchroma.shared.arrays import FloatArray
from panchroma.shared.errors import InputError, RangeError
from panchroma.shared.progress import Progress
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor
from tests.data import photograph
from tests.offline.scenes import CASES, every_case, gamma_of, photographed, shot
from tests.reference import render as reference
from tests.reference.compare import assert_close
from tests.reference.sensor import observe
from tests.scenes import darker_corners, leaves

# All stages in float32, the affinities solved as far as that goes: the luminance's rounding (5e-5)
# leads.
FLOAT32 = 5e-5
TIGHT = replace(PAPER, affinity=AffinitySettings(tolerance=1e-6))
WITHOUT_SITES = replace(
    BEST, posterior=PAPER.posterior, correction=PAPER.correction, learned=PAPER.learned
)
# The affinities solved to a residual of 1e-3, as a render asks for: a single pixel may be off by a
# hundredth, the picture is not.
RENDERED, RENDERED_RMS = 2e-2, 1e-3
# What hole filling leaves after its last iteration, and the networks, with their 8 bits.
FLAT = 4e-3
# The light changed, root mean square relative to the mean: the same numbers but for rounding, which
# moves what a solver leaves by its last step. The networks for colour round to 8 bits, where next to
# nothing can be a whole step.
SAME_LIGHT, SAME_LIGHT_IN_STEPS = 1e-5, 6e-3


@every_case
@pytest.mark.parametrize("sigma", [None, 0.02])
def test_equals_the_reference(
    pattern: CfaPattern, shape: tuple[int, int], sigma: float | None
) -> None:
    mosaic = shot(pattern, shape, sigma)
    expected = reference.render(mosaic, PAPER)
    found = render(mosaic, TIGHT)
    arrays = found.rgb, found.luminance, found.chromaticity
    assert {array.dtype for array in arrays} == {np.dtype(np.float32)}
    assert np.array_equal(found.rgb, found.chromaticity * found.luminance[..., None])  # Eq. 17
    measured = pattern.panchromatic_mask(shape)
    assert np.array_equal(found.luminance[measured], mosaic.signal[measured])
    assert_close(found.luminance, expected.luminance, FLOAT32)
    assert_close(found.chromaticity, expected.chromaticity, FLOAT32)
    assert_close(found.rgb, expected.rgb, FLOAT32)
    rendered = render(mosaic, PAPER).rgb
    assert_close(rendered, expected.rgb, RENDERED)
    assert np.sqrt(np.mean((rendered - expected.rgb) ** 2)) < RENDERED_RMS


@pytest.mark.parametrize("settings", PRESETS.values(), ids=PRESETS)
class TestEveryPreset:
    @every_case
    def test_a_flat_scene_comes_back(
        self, pattern: CfaPattern, shape: tuple[int, int], settings: RenderSettings
    ) -> None:
        colour = np.linspace(0.3, 0.9, len(pattern.channels))
        scene = np.broadcast_to(colour, (*shape, len(colour)))
        found = render(observe(scene, pattern, gamma_of(pattern), 1e-4), settings)
        assert_close(found.rgb, scene, FLAT)

    def test_threads_leave_no_trace(
        self, each_thread_count: Iterator[int], settings: RenderSettings
    ) -> None:
        """Also where samples are listed, hot or clipped."""
        defects = tuple((row, row * 7 % 90) for row in range(151))
        noise = NoiseModel.gaussian(0.02, 4)
        camera = SensorCalibration.of_bits(12, headroom=False, noise=noise, defects=defects)
        pattern, random = CfaPattern.bayer(6, origin=(1, 2)), np.random.default_rng(0)
        mosaic = simulate_sensor(2.5 * leaves(151, 90), pattern, camera, 1.0, random)
        pictures = [render(mosaic, settings).rgb for _ in each_thread_count]
        assert all(np.array_equal(picture, pictures[0]) for picture in pictures)


@pytest.mark.parametrize("light", [1e-35, 1e-9, 2.0**-18, 6e3, 65535.0, 1e38])
def test_samples_in_another_unit_are_refused_with_the_factor(light: float) -> None:
    sound = shot(*CASES["odd"], sigma=None)
    mosaic = replace(sound, samples=np.full_like(sound.samples, light))
    ways = (
        render,
        clean_frame,
        lambda wrong: list(render_bands(wrong)),
        lambda wrong: merge_burst([wrong, wrong]),
    )
    words = r"in scene units; multiply the samples, and their noise, by "
    for way in ways:
        with pytest.raises(InputError, match=words) as caught:
            way(mosaic)
    factor = float(str(caught.value).rpartition(" ")[2])
    rendering = render(replace(mosaic, samples=mosaic.samples * np.float32(factor)), PAPER)
    assert 0.1 < rendering.luminance.max() < 3


@pytest.mark.parametrize("settings", [PAPER, BEST])
@pytest.mark.parametrize("bits", [8, 12, 16])
def test_the_darkest_shot_of_a_sensor_is_rendered_from_codes_and_from_scene_units(
    bits: int, settings: RenderSettings
) -> None:
    """Black, below black, and a single code above it: what a lens cap leaves."""
    calibration, shape = SensorCalibration.of_bits(bits), (24, 30)
    black = int(calibration.black_level[0])
    for codes in ((black, black), (black - 2, black), (black, black + 1), (black - 1, black + 5)):
        samples = np.random.default_rng(0).choice(np.array(codes, np.uint16), shape)
        dark = Mosaic(samples, CfaPattern.bayer(6), calibration)
        for mosaic in (dark, dark.in_scene_units()):
            limit = 0.2 if bits == 8 else 0.01
            assert np.abs(render(mosaic, settings).rgb).max() < limit


@pytest.mark.parametrize("light", [0.5, 0.7])
@pytest.mark.parametrize("sigma", [0.0, 0.01])
@pytest.mark.parametrize(
    "pattern", [CfaPattern.bayer(6), CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW")]
)
def test_half_the_light_gives_half_the_picture(
    pattern: CfaPattern, sigma: float, light: float
) -> None:
    """Every threshold of `best` is a share of the frame's own light or of its noise: what is left
    is rounding.
    """
    with Image.open(photograph("kodak/kodim08.png")) as file:
        scene = ((np.asarray(file.crop((80, 60, 320, 240))) / 255) ** 2.2).astype(np.float32)
    mosaic = photographed(scene, pattern, sigma)
    noise = NoiseModel.gaussian(sigma * light, 4)
    darker = replace(
        mosaic,
        samples=mosaic.signal * np.float32(light),
        calibration=replace(mosaic.calibration, noise=noise),
    )
    for settings, rounding in (
        (replace(BEST, chromaticity=PAPER.chromaticity, learned=PAPER.learned), SAME_LIGHT),
        (BEST, SAME_LIGHT_IN_STEPS),
    ):
        expected, found = render(mosaic, settings), render(darker, settings)
        assert found.luminance.mean() < 0.71 * expected.luminance.mean()
        for whole, less in ((expected.rgb, found.rgb), (expected.luminance, found.luminance)):
            apart = less / np.float32(light) - whole
            assert np.sqrt(np.square(apart).mean()) < rounding * whole.mean()


@pytest.mark.parametrize("pattern", [CfaPattern.bayer(4), CfaPattern.bayer(6), CfaPattern.bayer(8)])
def test_a_black_area_has_a_picture(pattern: CfaPattern) -> None:
    """The network's superpixels there see nothing at all."""
    scene = np.random.default_rng(0).uniform(0.1, 1, (96, 104, 3)).astype(np.float32)
    scene[:80] = 0
    found = render(photographed(scene, pattern), BEST)
    assert np.isfinite(found.chromaticity).all()
    assert np.abs(found.rgb[:64]).max() < 1e-6


def test_a_value_that_is_not_finite_is_never_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    mosaic = shot(*CASES["odd"])

    def spoilt(*arguments: Any, **options: Any) -> Iterator[Band]:
        for band in run_stages(*arguments, **options):
            band.chromaticity[5, 7, 1] = np.nan
            band.chromaticity[6, 2, 0] = np.inf
            yield band

    monkeypatch.setattr(pipeline, "run_stages", spoilt)
    words = r"2 pixels of the picture are not finite .* row 5, column 7"
    for made in (lambda: render(mosaic), lambda: list(render_bands(mosaic))):
        with pytest.raises(RangeError, match=words):
            made()


@pytest.mark.parametrize("settings", [*PRESETS.values(), WITHOUT_SITES])
def test_a_frame_of_any_size_has_a_finite_picture_or_is_refused(settings: RenderSettings) -> None:
    calibration = SensorCalibration.of_bits(12)
    for pattern in (
        CfaPattern.bayer(6),
        CfaPattern.bayer(3, origin=(2, 1)),
        CfaPattern.of_letters("RGWW/BWWW/WWWW/WWWW"),
        CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW"),
    ):
        for shape in ((2, 3), (3, 2), (3, 3), (2, 60), (60, 2), (5, 7), (13, 4), (4, 18), (4, 4)):
            try:
                mosaic = Mosaic(
                    np.random.default_rng(0).integers(300, 3000, shape).astype(np.uint16),
                    pattern,
                    calibration,
                )
            except InputError:  # no whole block
                assert min(shape) < 4
                continue
            picture = render(mosaic, settings).rgb
            assert picture.shape == (*shape, 3)
            assert np.isfinite(picture).all()
    block = Mosaic(np.full((2, 2), 900, np.uint16), CfaPattern.bayer(6), calibration)
    for way in (lambda: render(block, settings), lambda: merge_burst([block, block], settings)):
        with pytest.raises(InputError, match="2 x 2 pixels without a panchromatic one"):
            way()


def test_codes_are_asked_for_where_saturation_changes_the_picture() -> None:
    """Where they are not, a program may convert them to scene units before it renders."""
    codes = shot(*CASES["odd"]).codes.copy()
    mosaic = replace(shot(*CASES["odd"]), samples=codes)
    codes[10:25, 10:25] = mosaic.calibration.white_level
    burnt = replace(mosaic, samples=codes)
    assert (PAPER.asks_for_codes, BEST.asks_for_codes) == (False, True)
    assert np.array_equal(render(burnt, PAPER).rgb, render(burnt.in_scene_units(), PAPER).rgb)
    coded, scaled = (render(each, UNLEARNED).rgb for each in (burnt, burnt.in_scene_units()))
    assert not np.array_equal(coded, scaled)


def test_progress_is_reported_stage_by_stage() -> None:
    listener, mosaic = Mock(Progress), shot(*CASES["odd"])
    assert np.array_equal(render(mosaic, PAPER, listener).rgb, render(mosaic, PAPER).rgb)
    reports = listener.mock_calls
    stages = [call.args for call in reports if call[0] == "stage"]
    names = [name for name, _ in stages]
    assert names == ["reconstructing luminance", "estimating colour of blocks", "colouring pixels"]
    (luminance, blocks, pixels), steps = names, dict(stages)
    done, stage = Counter[str](), ""
    for name, arguments, _ in reports:
        stage = arguments[0] if name == "stage" else stage
        done[stage] += name == "advance"
    assert (done[luminance], done[pixels]) == (steps[luminance], steps[pixels])
    assert 0 < done[blocks] <= steps[blocks]
    substeps = [call.args[0] for call in reports if call[0] == "substep"]
    assert substeps == ["propagation", "refinement"] * steps[pixels]


LENS = darker_corners((72, 90))


@pytest.mark.parametrize("shading", [None, LENS])
def test_the_public_pieces_make_the_picture_of_a_render(shading: Shading | None) -> None:
    camera = SensorCalibration(shading=shading)
    scene, random = leaves(72, 90), np.random.default_rng(0)
    taken = simulate_additive(scene, CfaPattern.bayer(6), camera, 0.02, random)
    mosaic = replace(taken, samples=taken.codes)
    frame = clean_frame(mosaic)
    filled = recover_luminance(frame.mosaic, BEST.luminance)
    luminance = denoise_luminance(filled, frame.mosaic, BEST.denoising)
    expected, given = render(mosaic).rgb, luminance.copy()
    assert np.abs(expected - scene).mean() < 0.03  # 0.07 if the shading stayed
    read_only = luminance.copy()
    read_only.flags.writeable = False
    double: Any = luminance.astype(np.float64)
    for own in (luminance, double, np.asfortranarray(luminance), read_only):
        bands = list(colour_bands(estimate_colour(frame, own)))
        assert np.array_equal(np.concatenate(bands), expected)
    assert np.array_equal(luminance, given)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda plane: plane[:-1], r"float32 \(71, 90\), expected .* float32 \(72, 90\)"),
        (lambda plane: plane[..., None], r"float32 \(72, 90, 1\), expected"),
        (lambda plane: plane.T, r"float32 \(90, 72\), expected"),
        (lambda plane: plane.astype(complex), "complex128"),
        (lambda plane: plane.astype(str), "<U"),
        (lambda plane: None, "object"),
        (lambda plane: np.where(plane > plane.mean(), np.nan, plane), "finite"),
        (lambda plane: np.where(plane > plane.mean(), np.inf, -np.inf), "finite"),
        (lambda plane: plane.astype(np.float64) * 1e300, "finite"),
    ],
)
def test_luminance_that_a_render_cannot_use_is_refused(
    spoil: Callable[[FloatArray], Any], words: str
) -> None:
    mosaic = Mosaic(leaves(72, 90).sum(axis=2), CfaPattern.bayer(6), SensorCalibration())
    with pytest.raises(InputError, match=f"luminance .*{words}"):
        estimate_colour(clean_frame(mosaic), spoil(mosaic.signal.copy()))
