import numpy as np
import pytest

from shared import CfaPattern
from shared.errors import InputError
from tools.evaluation.protocol import CROP, Protocol, cut
from tools.evaluation.rivals.bayer import sample_bayer
from tools.evaluation.tiles import filters_of

RGB = np.full((60, 66, 3), (0.2, 0.4, 0.3), np.float32)
PATTERN = CfaPattern.bayer(6)
FILTERS = filters_of(PATTERN, "RGB")


def test_the_papers_protocol_adds_noise_and_nothing_else() -> None:
    protocol = Protocol("paper", 7)
    np.testing.assert_array_equal(protocol.bayer_shot(RGB, 0.0).samples, sample_bayer(RGB))
    shot = protocol.bayer_shot(np.zeros_like(RGB), 0.03)
    assert shot.samples.min() < -0.05
    assert shot.samples.std() == pytest.approx(0.03, rel=0.05)
    assert (shot.shot, shot.read) == (0.0, 0.03)
    sparse = protocol.sparse_shot(RGB, 0.03, PATTERN, FILTERS)
    assert sparse.samples.dtype == np.float32
    assert sparse.calibration.noise is not None
    assert sparse.calibration.noise.sigma(0.5) == pytest.approx(0.03)
    assert protocol.gain(0.03) == 1


def test_seeds_fix_the_noise() -> None:
    for kind, level in (("paper", 0.01), ("sensor", 0.25)):
        first, again, other = (Protocol(kind, seed) for seed in (1, 1, 2))  # type: ignore[arg-type]
        np.testing.assert_array_equal(first.bayer_shot(RGB, level).samples, again.bayer_shot(RGB, level).samples)
        once, twice = (each.sparse_shot(RGB, level, PATTERN, FILTERS).samples for each in (first, again))
        np.testing.assert_array_equal(once, twice)
        assert (first.bayer_shot(RGB, level).samples != other.bayer_shot(RGB, level).samples).any()


@pytest.mark.parametrize("exposure", [1.0, 0.25, 1 / 16])
def test_equal_exposure_gives_the_panchromatic_pixel_its_light(exposure: float) -> None:
    protocol = Protocol("sensor", 0)
    bayer, sparse = protocol.bayer_shot(RGB, exposure), protocol.sparse_shot(RGB, exposure, PATTERN, FILTERS)
    white = sparse.signal[sparse.pattern.panchromatic_mask(sparse.shape)] / protocol.gain(exposure)
    green = bayer.samples[::2, 1::2]
    assert green.mean() == pytest.approx(0.4, rel=0.02)
    assert white.mean() == pytest.approx(0.9, rel=0.02)
    # Noise of the same electrons: variance per scene unit of light is the same, so the sum of three has more signal to noise.
    assert green.var() == pytest.approx(bayer.shot * 0.4 + bayer.read**2, rel=0.15)
    assert white.std() / white.mean() < 0.75 * green.std() / green.mean()


def test_sensors_clip_at_white() -> None:
    protocol = Protocol("sensor", 0)
    assert protocol.bayer_shot(RGB * 10, 1.0).samples.max() == pytest.approx(1.0)
    assert protocol.sparse_shot(RGB * 10, 1.0, PATTERN, FILTERS).signal.max() == pytest.approx(3.0)


def test_levels_are_ordered_by_noise_and_checked() -> None:
    assert Protocol("paper").levels([0.03, 0.0, 0.01, 0.01]) == (0.0, 0.01, 0.03)
    assert Protocol("sensor").levels([0.25, 1.0]) == (1.0, 0.25)
    assert [Protocol("paper").describe(level) for level in (0.0, 0.01)] == ["no noise", "sigma 0.01"]
    assert [Protocol("sensor").describe(level) for level in (2.0, 1.0, 0.25)] == ["exposure 2", "exposure 1", "exposure 1/4"]
    assert "5,000 electrons per scene unit at exposure 1, read noise of 3 electrons, 12 bits" in Protocol("sensor").conditions
    assert "Gaussian" in Protocol("paper").conditions
    for kind, level in (("paper", -0.1), ("paper", np.nan), ("sensor", 0.0), ("sensor", np.inf)):
        with pytest.raises(InputError, match="expected"):
            Protocol(kind).levels([level])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="protocol"):
        Protocol("both")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="seed"):
        Protocol("paper", -1)


def test_frames_are_cut_to_whole_periods() -> None:
    rgb = np.arange(47 * 52 * 3, dtype=np.float32).reshape(47, 52, 3)
    np.testing.assert_array_equal(cut(rgb), rgb[:42, :48])
    middle = cut(rgb, 20)
    assert middle.shape == (18, 18, 3)
    np.testing.assert_array_equal(middle, rgb[14:32, 17:35])
    assert CROP == 6
