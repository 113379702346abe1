"""The white balance of a stream: estimated, marked, steady."""

from dataclasses import replace

import numpy as np

from panchroma.device.capture.loop import SteadyWhite
from panchroma.shared import Mosaic, SensorCalibration
from panchroma.shared.colorimetry import SRGB_TO_XYZ
from tests.shared.test_white_balance import LIGHT, shot


def neutral(mosaic: Mosaic) -> np.ndarray:
    return np.log(mosaic.calibration.neutral or ())


def test_frames_are_balanced_from_the_first_bright_one_on_and_marked() -> None:
    balance = SteadyWhite()
    assert balance(shot(level=0)).calibration.neutral is None
    first, dark = balance(shot()), balance(shot(level=0))
    assert np.abs(neutral(first) - np.log(LIGHT)).max() < 0.05
    assert first.calibration.neutral_estimated
    assert dark.calibration == first.calibration


def test_the_balance_does_not_jump_and_follows_a_lasting_change() -> None:
    balance, warm = SteadyWhite(), (1.0, 0.7, 0.3)
    before = neutral(balance(shot()))
    for _ in range(3):
        after = neutral(balance(shot(warm)))
        assert 0 < np.abs(after - before).max() < 0.12
        before = after
    for _ in range(100):
        last = balance(shot(warm))
    assert np.abs(neutral(last) - np.log(warm)).max() < 0.05


def test_colours_that_are_known_stay() -> None:
    balance = SteadyWhite()
    for known in ({"neutral": (0.5, 1.0, 0.5)}, {"camera_to_xyz": SRGB_TO_XYZ}):
        mosaic = replace(shot(), calibration=SensorCalibration.of_bits(12, **known))
        assert balance(mosaic) is mosaic
