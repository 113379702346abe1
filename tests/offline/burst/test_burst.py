"""The picture of a burst as a whole: what it gains, and what it must leave as it is."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from math import cos, sin

import numpy as np
import pytest

from panchroma.offline import BEST, PAPER, RenderSettings, render
from panchroma.offline.burst import Motion, burst_memory, merge_burst
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import BoolArray, FloatArray
from panchroma.shared.errors import ConvergenceError, InputError, RangeError
from panchroma.tools.simulation.sensor import simulate_sensor
from tests.scenes import darker_corners

from .scenes import SHAPE, picture, scene, taken

SHIFTS = [(0.0, 0.0), (1.3, -2.2), (-2.6, 0.4), (0.7, 2.9), (2.4, 1.6), (-1.1, -1.7)]
# root mean square; the latter of the networks for colour, with their 8 bits
ROUNDING, ROUNDING_IN_STEPS = 1e-5, 5e-3
MOTIONS = [Motion(shift) for shift in SHIFTS]
BAYER = CfaPattern.bayer(6)
STEPS = [Motion((2.0 * down, 2.0 * across)) for down in range(3) for across in range(3)]
# the networks for colour have units and steps of their own
STAGES = replace(BEST, chromaticity=PAPER.chromaticity, learned=PAPER.learned)


def shots(
    sigma: float,
    motions: list[Motion] = MOTIONS,
    pattern: CfaPattern = BAYER,
    shape: tuple[int, int] = SHAPE,
) -> list[Mosaic]:
    channels = len(pattern.channels)
    return taken((scene(motion, channels, shape) for motion in motions), sigma, pattern)


def psnr(found: FloatArray, truth: FloatArray) -> float:
    inside = np.s_[15:-15, 15:-15]
    return float(-10 * np.log10(np.square(found[inside] - truth[inside]).mean()))


@pytest.mark.parametrize(
    ("settings", "pattern", "sigma", "motions", "known", "gain"),
    [
        pytest.param(BEST, BAYER, 0.0, MOTIONS, False, 4, id="hand"),
        pytest.param(BEST, BAYER, 0.01, MOTIONS, False, 1, id="hand, noise"),
        pytest.param(BEST, BAYER, 0.0, STEPS, True, 6, id="known steps of the sensor"),
        pytest.param(PAPER, BAYER, 0.0, MOTIONS, False, 0, id="published settings"),
        (BEST, CfaPattern.with_block(("ABC", "CDE"), 8), 0.0, MOTIONS[:4], False, 1),
        (BEST, CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2)), 0.01, MOTIONS[:4], False, 1),
        (BEST, CfaPattern.of_letters("RG/BW", (1, 2)), 0.0, MOTIONS[:4], False, 1),
        (BEST, CfaPattern.of_letters("WAWB/CWDW/WEWC/BWAW", (1, 2)), 0.0, MOTIONS[:4], False, 1),
    ],
)
def test_more_frames_show_more(
    settings: RenderSettings,
    pattern: CfaPattern,
    sigma: float,
    motions: list[Motion],
    known: bool,
    gain: float,
) -> None:
    frames = shots(sigma, motions, pattern)
    truth = scene(motions[0], len(pattern.channels))
    merged = merge_burst(frames, settings, reference=0, motions=motions if known else None)
    assert all(frame.used for frame in merged.frames), [frame.reason for frame in merged.frames]
    single = psnr(render(frames[0], settings).rgb, truth)
    assert psnr(picture(merged, settings), truth) > single + gain
    assert np.median(merged.noise_ratio) < 1.8 / len(motions)


NOISE = NoiseModel((1.5e-3,) * 4, (8e-3,) * 4)
LARGE = (210, 300)
EQUAL, BRACKET = [0.0] * 8, [0.0, -1.0] * 4
HAND = [Motion(), *(Motion((5 * sin(9 * k), 5 * cos(7 * k)), 4e-3 * sin(k)) for k in range(1, 8))]
FAR = [Motion(), *(Motion((18 * sin(k), 25 * cos(k))) for k in range(1, 8))]


def through_a_lens(
    motions: list[Motion], peak: float, stops: list[float]
) -> tuple[list[Mosaic], FloatArray]:
    """Frames with the noise of `NOISE` and with clipping, through a lens whose corners are
    darker and of another colour, and what the first of them shows.
    """
    camera = SensorCalibration.of_bits(
        12, headroom=False, noise=NOISE, shading=darker_corners(LARGE)
    )
    scenes = [peak * scene(motion, shape=LARGE, strength=0) for motion in motions]
    return [
        simulate_sensor(each, BAYER, camera, 2.0**stop, np.random.default_rng(seed))
        for seed, (each, stop) in enumerate(zip(scenes, stops, strict=True))
    ], scenes[0]


def fifths(mosaic: Mosaic, visible: BoolArray) -> list[BoolArray]:
    """The fifths of a frame from its middle to its corners, and from top to bottom."""
    assert mosaic.calibration.shading is not None
    planes = mosaic.calibration.shading.of_plane(LARGE), np.indices(LARGE)[0]
    return [
        visible & (plane >= low) & (plane <= high)
        for plane in planes
        for low, high in pairwise(np.quantile(plane, np.linspace(0, 1, 6)))
    ]


@pytest.mark.parametrize(
    ("motions", "peak", "stops", "is_estimated", "is_known"),
    [
        pytest.param(HAND, 0.4, EQUAL, False, False, id="hand"),
        pytest.param(HAND, 0.4, EQUAL, True, False, id="estimated noise"),
        pytest.param(HAND, 2.0, BRACKET, False, False, id="clipped bracket"),
        pytest.param([Motion()] * 8, 0.1, EQUAL, False, True, id="dark, from a stand"),
        pytest.param([Motion()] * 8, 2.0, BRACKET, False, True, id="bracket, from a stand"),
        pytest.param(FAR, 0.4, EQUAL, False, True, id="far"),
    ],
)
def test_every_part_of_a_shaded_picture_gains(
    motions: list[Motion], peak: float, stops: list[float], is_estimated: bool, is_known: bool
) -> None:
    frames, truth = through_a_lens(motions, peak, stops)
    if is_estimated:
        unknown = replace(frames[0].calibration, noise=None)
        frames = [frame.calibrated(unknown) for frame in frames]
    merged = merge_burst(frames, reference=0, motions=motions if is_known else None)
    assert all(frame.used for frame in merged.frames), [frame.reason for frame in merged.frames]
    pictures = render(frames[0]).rgb, picture(merge_burst(frames[:1])), picture(merged)
    visible = np.pad(np.ones((LARGE[0] - 24, LARGE[1] - 24), bool), 12)
    visible &= frames[0].evenly_shaded().signal < 2.9
    for fifth in fifths(frames[0], visible):
        one, same, many = (
            float(np.sqrt(np.square((rgb - truth)[fifth]).mean())) for rgb in pictures
        )
        assert same == pytest.approx(one, rel=0.01)
        assert many < one / 1.3


def test_one_frame_alone_is_a_single_render() -> None:
    (frame,) = shots(0.01, MOTIONS[:1])
    for settings, rounding in ((STAGES, ROUNDING), (BEST, ROUNDING_IN_STEPS)):
        merged = merge_burst([frame], settings)
        assert (merged.noise_ratio == 1).all()
        found = picture(merged, settings)
        assert np.sqrt(np.square(found - render(frame, settings).rgb).mean()) < rounding


@pytest.mark.parametrize(
    "shape", [(1, 40), (40, 1), (1, 9), (9, 1), (2, 3), (13, 2), (3, 30), (12, 200)]
)
@pytest.mark.parametrize("letters", ["RGB", "G"])
def test_frames_of_few_rows_or_columns_are_merged(shape: tuple[int, int], letters: str) -> None:
    pattern = CfaPattern.with_block((letters,) if shape[1] > 2 else tuple(letters), 4)
    frames = shots(0.01, [Motion()] * 3, pattern, shape)
    alone = picture(merge_burst(frames[:1]))
    assert np.sqrt(np.square(alone - render(frames[0]).rgb).mean()) < ROUNDING_IN_STEPS
    for shift in ((0.0, 0.0), (0.6, -0.4)):
        motions = [Motion(), Motion(shift), Motion()]
        found = picture(merge_burst(frames, reference=0, motions=motions))
        assert found.shape == alone.shape
        assert np.abs(found).max() < 10


def test_threads_leave_no_trace(each_thread_count: Iterator[int]) -> None:
    frames = shots(0.01, MOTIONS[:3], shape=(160, 220))  # more than `LITTLE` pixels
    results = [picture(merge_burst(frames)) for _ in each_thread_count]
    assert all(np.array_equal(found, results[0]) for found in results)


def test_what_makes_no_burst_is_refused() -> None:
    frames = shots(0.0, MOTIONS[:2])
    with pytest.raises(InputError, match="0 frames"):
        merge_burst([])
    with pytest.raises(InputError, match="2 frames and 1 motions"):
        merge_burst(frames, motions=MOTIONS[:1])
    with pytest.raises(InputError, match="reference is None, expected the index of a frame"):
        merge_burst(frames, motions=MOTIONS[:2])
    for index in (-1, 2, 0.5):
        with pytest.raises(InputError, match=f"reference is {index}, expected .* a frame, 0 to 1"):
            merge_burst(frames, reference=index)  # type: ignore[arg-type]


def test_memory_grows_with_the_frames() -> None:
    (frame,) = shots(0.0, MOTIONS[:1])
    assert burst_memory(2, frame) < burst_memory(9, frame)
    assert burst_memory(9, frame, BEST) > 9 * 4 * frame.samples.size
    scattered = replace(frame, pattern=CfaPattern.of_letters("kodak"))
    assert burst_memory(8, scattered) > 590 * frame.samples.size  # measured at 1.5 megapixels


@pytest.mark.parametrize("scale", [2.0**-4, 2.0**7])
def test_a_burst_of_other_light_is_that_burst(scale: float) -> None:
    frames = shots(0.0, MOTIONS[:3])
    scaled = [replace(frame, samples=frame.signal * np.float32(scale)) for frame in frames]
    expected, found = (picture(merge_burst(each)) for each in (frames, scaled))
    assert np.sqrt(np.square(found / scale - expected).mean()) < 0.02


def test_a_value_that_is_not_finite_is_never_yielded(monkeypatch: pytest.MonkeyPatch) -> None:
    merged = merge_burst(shots(0.05, MOTIONS[:3]), reference=0)
    merged.samples.values[:] = np.nan
    with pytest.raises(ConvergenceError, match="samples: conjugate gradients stopped"):
        picture(merged)
    merged.measured.luminance[40, 50] = np.nan
    name = "panchroma.offline.numerics.conjugate_gradients.check_convergence"
    monkeypatch.setattr(name, lambda *_: None)
    with pytest.raises(RangeError, match="pixels of the picture are not finite"):
        picture(merged)
