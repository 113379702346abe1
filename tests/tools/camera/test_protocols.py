"""The protocols of noise: what both cameras record, and what the protocols say of themselves."""

import numpy as np
import pytest

from shared import CfaPattern
from shared.arrays import FloatArray
from shared.errors import InputError
from shared.sensor import TYPICAL_READ, TYPICAL_SHOT
from tools.camera.bayer import sample_bayer
from tools.camera.protocols import PROTOCOLS, PaperProtocol, Protocol, SensorProtocol, chosen_protocol
from tools.evaluation.cameras import CameraPair

RGB = np.full((60, 66, 3), (0.2, 0.4, 0.3), np.float32)
PATTERN = CfaPattern.bayer(6)


def pair(level: Protocol, scene: FloatArray = RGB, seed: int = 0) -> CameraPair:
    return CameraPair(level, seed, scene, PATTERN, None)


def test_the_papers_protocol_adds_noise_and_nothing_else() -> None:
    np.testing.assert_array_equal(pair(PaperProtocol(0.0)).bayer.samples, sample_bayer(RGB))
    shot = pair(PaperProtocol(0.03), np.zeros_like(RGB)).bayer
    assert shot.samples.min() < -0.05
    assert shot.samples.std() == pytest.approx(0.03, rel=0.05)
    assert (shot.shot, shot.read) == (0.0, 0.03)
    sparse = pair(PaperProtocol(0.03)).sparse
    assert sparse.samples.dtype == np.float32
    assert sparse.calibration.noise.sigma(0.5) == pytest.approx(0.03)


@pytest.mark.parametrize("exposure", [1.0, 0.25, 1 / 16])
def test_equal_exposure_gives_the_panchromatic_pixel_its_light(exposure: float) -> None:
    cameras = pair(SensorProtocol(exposure))
    bayer, sparse = cameras.bayer, cameras.sparse
    white = sparse.signal[sparse.pattern.panchromatic_mask(sparse.shape)] / exposure
    green = bayer.samples[::2, 1::2]
    assert green.mean() == pytest.approx(0.4, rel=0.02)
    assert white.mean() == pytest.approx(0.9, rel=0.02)
    # Noise of the same electrons: variance per scene unit of light is the same, so the sum of three has more signal to noise.
    assert (bayer.shot * exposure, bayer.read * exposure) == pytest.approx((TYPICAL_SHOT, TYPICAL_READ))
    assert green.var() == pytest.approx(bayer.shot * 0.4 + bayer.read**2, rel=0.15)
    assert white.std() / white.mean() < 0.75 * green.std() / green.mean()
    codes = bayer.samples * exposure * (4095 - 256)
    np.testing.assert_allclose(codes, np.rint(codes), atol=2e-3)  # 12 bits, through float32


def test_sensors_clip_at_white() -> None:
    bright = pair(SensorProtocol(1.0), RGB * 10)
    assert bright.bayer.samples.max() == 1.0
    assert bright.sparse.signal.max() == pytest.approx(3.0)


def test_levels_are_ordered_by_noise_checked_and_named() -> None:
    assert [each.level for each in PaperProtocol.levels([0.03, 0.0, 0.01, 0.01])] == [0.0, 0.01, 0.03]
    assert [each.level for each in SensorProtocol.levels([0.25, 1.0])] == [1.0, 0.25]
    assert [PaperProtocol(level).text for level in (0.0, 0.01)] == ["no noise", "sigma 0.01"]
    assert [SensorProtocol(level).text for level in (2.0, 1.0, 0.25)] == ["exposure 2", "exposure 1", "exposure 1/4"]
    assert "5,000 electrons per scene unit at exposure 1, read noise of 3 electrons, 12 bits" in SensorProtocol.conditions
    for level in (-0.1, np.nan):
        with pytest.raises(InputError, match=r"`sigma` is .* expected"):
            PaperProtocol.levels([level])
    for level in (0.0, np.inf):
        with pytest.raises(InputError, match=r"`light` is .* expected"):
            SensorProtocol.levels([level])


@pytest.mark.parametrize("protocol", PROTOCOLS.values())
def test_every_protocol_speaks_for_itself(protocol: type[Protocol]) -> None:
    """Options, figures and reports ask a protocol for nothing that it does not say; its levels go from little noise to much."""
    levels = protocol.levels()
    assert [each.level for each in levels] == list(protocol.usual)
    assert protocol.places(levels) == sorted(protocol.places(levels))
    said = [getattr(protocol, name) for name in ("option", "metavar", "help", "summary", "unit", "equal_noise", "conditions")]
    assert all(isinstance(each, str) and each for each in said)
    noise = [(pair(level).bayer.samples - sample_bayer(RGB)).std() for level in levels]
    assert noise == sorted(noise)
    assert chosen_protocol(protocol.name, {protocol.option: 0.5}) == (protocol, 0.5)
    assert chosen_protocol(None, {protocol.option: 0.5}) == (protocol, 0.5)


def test_the_level_of_another_protocol_is_refused() -> None:
    assert chosen_protocol(None, {"sigma": None, "light": None}) == (PaperProtocol, None)
    wrong: list[tuple[str | None, dict[str, float]]] = [("paper", {"light": 1.0}), ("sensor", {"sigma": 0.0})]
    for name, levels in [*wrong, (None, {"sigma": 0.0, "light": 1.0})]:
        with pytest.raises(InputError, match="is not a level of `protocol`"):
            chosen_protocol(name, levels)
    with pytest.raises(InputError, match="expected one of paper, sensor"):
        chosen_protocol("both", {})
