"""What speed is measured on."""

import numpy as np
import pytest

from shared.errors import InputError
from tools.evaluation.speed import material as product
from tools.evaluation.speed.material import Material, frame_shape


@pytest.mark.parametrize("megapixels", [0.002, 0.1, 1, 3.2, 12, 100])
def test_frames_have_the_size_asked_for(megapixels: float) -> None:
    rows, columns = frame_shape(megapixels)
    assert rows % 12 == columns % 12 == 0
    assert rows * columns == pytest.approx(megapixels * 1e6, rel=0.25 if megapixels < 0.1 else 0.02)


@pytest.mark.parametrize("megapixels", [0, -1, float("nan"), 1e-9, 200])
def test_other_sizes_are_refused(megapixels: float) -> None:
    with pytest.raises(InputError, match="--megapixels is"):
        frame_shape(megapixels)


def test_large_frames_repeat_a_piece_and_the_pattern_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(product, "_PIECE", (24, 36))
    frame = Material((60, 48))
    for plane in (frame.shot.codes, frame.mosaic.signal, frame.bayer, frame.bayer_codes):
        assert plane.shape == (60, 48)
        assert np.array_equal(plane[24:48, :36], plane[:24, :36])
        assert np.array_equal(plane[:, 36:], plane[:, :12])
    # One frame in two forms: half a code of 12 bits is 4e-4 scene units.
    assert np.abs(frame.shot.signal - frame.mosaic.signal).max() < 5e-4
    colour = frame.mosaic.pattern.filter_map(frame.shape) < 3
    assert frame.mosaic.signal[colour].mean() < 0.5 * frame.mosaic.signal[~colour].mean()
    assert frame.mosaic.calibration.noise is not None
