"""From measurements to a camera: what is measured replaces what was known, and what was not
measured stays.
"""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from panchroma.shared import Camera, CfaPattern, InputError, Mosaic
from panchroma.tools.calibration.conclude import conclude
from panchroma.tools.calibration.dark_frames import DarkResult
from panchroma.tools.calibration.measure import Measurements, ShotMeasurement, measure_chart
from panchroma.tools.calibration.measured_shading import ShadingResult
from panchroma.tools.calibration.photon_transfer import FlatResult
from panchroma.tools.calibration.places import PlaceSamples
from panchroma.tools.simulation.sensor import simulate_sensor
from tests.scenes import darker_corners
from tests.tools.calibration.known_camera import (
    BLIND,
    NOISE,
    REFERENCE,
    TRUTH,
    chart,
    frame,
    true_place,
)

PATTERN, SHAPE = CfaPattern.bayer(6), (60, 90)
CMY = CfaPattern.of_letters("WYWC/YWCW/WCWM/CWMW", (0, 1), "CMY")
BROAD = (1 - np.eye(3)) / 2  # what cyan, magenta and yellow see of red, green and blue
DARKER = darker_corners(SHAPE)
DARK = DarkResult(2, np.full(4, 256.0), np.full(4, 0.01), np.full(4, 1.0), np.full(4, 0.01), ())
LINE = np.array([[0.1], [0.5], [0.9]]) * np.ones(4)
NUMBER, CLIPPED, WHERE = np.full(LINE.shape, 1e5), np.zeros(3, bool), np.zeros((3, 2))
FLAT = FlatResult(3, PlaceSamples(LINE, 1e-4 * LINE + 1 / 3839**2, NUMBER, CLIPPED, WHERE), ())


def on_chart(taken: Mosaic) -> ShotMeasurement:
    return measure_chart("chart.dng", taken, REFERENCE, true_place().corners)


@cache
def shot() -> ShotMeasurement:
    return on_chart(frame(chart().rgb))


def base_of(**says: Any) -> Mosaic:
    """A frame whose calibration says this."""
    return Mosaic(np.full(SHAPE, 500, np.uint16), PATTERN, replace(BLIND, **says))


def concluded(old: Camera | None = None, says: dict[str, Any] | None = None, **seen: Any) -> Camera:
    """The camera of these measurements, on frames whose calibration says this."""
    outcome = conclude(Measurements(REFERENCE, base_of(**(says or {})), old, **seen))
    assert outcome.camera is not None, outcome.refusal
    return outcome.camera


def test_a_new_gamma_rescales_noise_that_was_measured_before() -> None:
    """Noise is in scene units; in codes it is the same."""
    known = replace(BLIND, noise=NOISE)
    stated = concluded(shots=[shot()], says={"noise": NOISE}).calibration
    updated = concluded(Camera(known, PATTERN), shots=[shot()]).calibration
    for new in (stated, updated):
        ratio = new.full_scale / known.full_scale
        assert abs(ratio - 1) > 0.05
        np.testing.assert_allclose(new.noise.shot, ratio * np.array(NOISE.shot))
        np.testing.assert_allclose(new.noise.read, ratio * np.array(NOISE.read))


def test_defects_of_one_kind_of_frames_are_added_and_those_of_both_replace_all() -> None:
    old = Camera(replace(BLIND, defects=((5, 7),)), PATTERN, {"defects": {}})
    hot, dead = replace(DARK, defects=((1, 2),)), replace(FLAT, dead=((3, 4),))
    assert concluded(old, dark=hot).calibration.defects == ((1, 2), (5, 7))
    assert concluded(old, flats=dead).calibration.defects == ((3, 4), (5, 7))
    assert concluded(old, flats=dead, dark=hot).calibration.defects == ((1, 2), (3, 4))


def test_parts_that_were_measured_with_a_black_level_far_off_are_named() -> None:
    known = {"gamma": {}, "colour": {}, "black_level": {"standard_error": [0.01] * 4}}
    for black, count in ((256.0, 0), (262.0, 1)):
        old = Camera(replace(BLIND, black_level=(black,) * 4), PATTERN, known)
        warnings = " ".join(conclude(Measurements(REFERENCE, base_of(), old, DARK)).warnings)
        assert warnings.count("6.0 codes off the one with which gamma, colour") == count


def test_that_a_lens_has_no_shading_is_a_measurement() -> None:
    known = Camera(replace(BLIND, shading=DARKER), PATTERN, {"shading": {"corner": [1, 0, 1]}})
    assert concluded(known, dark=DARK).calibration.shading == DARKER
    measured = concluded(known, shading=ShadingResult(None, 2, 0.001))
    assert measured.calibration.shading is None
    assert "corner" not in measured.measured["shading"]


@pytest.mark.parametrize(
    ("spread", "verdict"), [(0.08, "use it with care"), (0.4, "do not use it")]
)
def test_colours_of_another_chart_are_not_used(spread: float, verdict: str) -> None:
    other = REFERENCE * np.random.default_rng(1).uniform(1 - spread, 1 + spread, (24, 3))
    outcome = conclude(Measurements(other, base_of(), dark=DARK, flats=FLAT, shots=[shot()]))
    assert outcome.verdict == verdict
    said = " ".join((*outcome.contradictions, *outcome.warnings))
    assert "colours differ from the reference by a mean dE2000" in said


@pytest.mark.parametrize(("brighter", "axis"), [(1.0, 0), (1.6, 0), (1.6, 1)])
def test_uneven_light_on_the_chart_is_told(brighter: float, axis: int) -> None:
    """Even where correcting the colours for it works."""
    slope = np.linspace(1, 1 / brighter, chart().shape[axis])
    taken = frame(chart().rgb * np.expand_dims(slope, (1 - axis, 2)))
    shots = [on_chart(taken)]
    even = ShadingResult(None, 2, 0.001)
    seen = Measurements(REFERENCE, base_of(), None, DARK, FLAT, shots, shading=even)
    outcome = conclude(seen)
    assert outcome.verdict == ("use it with care" if brighter > 1 else "use it")
    told = any("the light on the chart is uneven" in line for line in outcome.warnings)
    assert told == (brighter > 1)


@pytest.mark.parametrize(
    ("right", "wrong", "names"),
    [
        (CfaPattern.bayer(6, "GRBG"), CfaPattern.bayer(6, "GBRG"), "red and blue"),
        (CMY, CfaPattern.of_letters("WMWC/MWCW/WCWY/CWYW", (0, 1), "CMY"), "magenta and yellow"),
    ],
)
def test_swapped_channels_show_on_a_chart(right: CfaPattern, wrong: CfaPattern, names: str) -> None:
    true, says = (replace(each, channels=right.channels) for each in (TRUTH, BLIND))
    light = chart().rgb if right.channels == "RGB" else (chart().rgb @ BROAD).astype(np.float32)
    taken = simulate_sensor(light, right, true, 1.0, np.random.default_rng(0))
    taken = replace(taken, calibration=says)
    np.testing.assert_allclose(on_chart(taken).fit.gamma, TRUTH.gamma, rtol=0.02)
    said = f"the chart shows that {names} are exchanged.*{'/'.join(right.letters_from())}"
    with pytest.raises(InputError, match=said):
        on_chart(replace(taken, pattern=wrong))
