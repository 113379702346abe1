"""The fast judge against a matrix of a whole small torus, and what symmetry must not change."""

import numpy as np
import pytest

from shared import CfaPattern
from shared.arrays import DoubleArray
from shared.errors import InputError
from tools.camera.simulated_camera import SimulatedCamera
from tools.evaluation.design.judge import FastJudge, Figures, Light
from tools.evaluation.design.spectra import SHARES, Spectra, basis, shipped
from tools.scenes.scene import BROADBAND, Scene

LIGHTS = (Light.of_sigma(0.02), Light.of_photons(2000, 5))


def torus_covariance(power: DoubleArray) -> DoubleArray:
    """Covariance of all planes of all pixels, pixel by pixel, of a torus with this power (side, side, N, N)."""
    side, channels = power.shape[0], power.shape[2]
    spread = np.fft.ifft2(power, axes=(0, 1)).real
    places = np.array(list(np.ndindex(side, side)))
    down, across = np.moveaxis((places[:, None] - places) % side, 2, 0)
    return spread[down, across].swapaxes(1, 2).reshape(side**2 * channels, -1)


def by_matrix(tile: tuple[str, ...], passed: dict[str, str], channels: str, light: Light, spectra: Spectra, side: int) -> Figures:
    """The figures of a tile, from the posterior covariance of a whole torus."""
    count = len(channels)
    letters = [tile[row % len(tile)][column % len(tile)] for row, column in np.ndindex(side, side)]
    filters = np.array([[float(each in passed[letter]) for each in channels] for letter in letters])
    sample = np.zeros((side**2, side**2 * count))
    for place, row in enumerate(filters @ basis(count).T):
        sample[place, place * count : (place + 1) * count] = row
    frequencies = np.stack(np.meshgrid(*[np.arange(side) / side] * 2, indexing="ij"), axis=2)
    errors = []
    for power, bright in zip(spectra.at(frequencies, count), spectra.light, strict=True):
        prior = torus_covariance(power)
        noise = light.shot * count / 3 * filters.sum(axis=1) * bright + (light.read * count / 3) ** 2
        left = prior - prior @ sample.T @ np.linalg.solve(sample @ prior @ sample.T + np.diag(noise), sample @ prior)
        plane = np.diag(left).reshape(-1, count).mean(axis=0) / count
        errors.append((plane[0], plane[1:].sum()))
    luminance, colour = np.array(errors).T
    found = np.array([luminance @ SHARES, colour @ SHARES, colour[-1], (luminance + colour) @ SHARES])
    return Figures(*(-10 * np.log10(found)).tolist())


@pytest.mark.parametrize(
    ("letters", "tile", "channels", "side"),
    [
        ("RGB", ("RGWW", "GBWW", "WWWW", "WWWW"), "RGB", 12),
        ("RB", ("RWW", "WWB", "WWW"), "RGB", 9),
        ("CMY", ("CMW", "YWW", "WWW"), "RGB", 12),
        ("VRGN", ("VRW", "GNW", "WWW"), "VRGN", 9),
    ],
)
def test_the_fast_judge_is_exact_on_a_torus(letters: str, tile: tuple[str, ...], channels: str, side: int) -> None:
    judge = FastJudge(letters, LIGHTS, shipped(), side)
    passed = {letter: BROADBAND.get(letter, letter) for letter in letters} | {"W": channels}
    assert judge.unmeasured == (letters == "RB")
    for figures, light in zip(judge(tile), LIGHTS, strict=True):
        np.testing.assert_allclose(figures, by_matrix(tile, passed, channels, light, shipped(), side), atol=1e-6)


def test_alike_tiles_are_judged_alike() -> None:
    judge = FastJudge.of("RGB", LIGHTS)
    tile = ("RGWW", "WBWW", "WWRW", "WWWW")
    moved = ("WWWR", "WWWW", "WRGW", "WWBW")  # by two rows and a column
    exchanged = ("BGWW", "WRWW", "WWBW", "WWWW")
    turned = tuple("".join(row) for row in np.rot90(np.array([list(row) for row in tile])))
    for other in (moved, exchanged, turned, turned[::-1]):
        np.testing.assert_allclose(judge(other), judge(tile), atol=1e-9)
    assert not np.allclose(judge(("GRWW", "WBWW", "WWRW", "WWWW")), judge(tile), atol=1e-3)  # green is not red


def test_more_light_and_more_samples_tell_more() -> None:
    judge = FastJudge.of("RGB", [Light.of_photons(count) for count in (100, 1000, 10000)])
    figures = np.array(judge(("RGWW", "GBWW", "WWWW", "WWWW")))
    assert (np.diff(figures, axis=0) > 0).all()
    assert judge.light(("RGWW", "GBWW", "WWWW", "WWWW")) == 2.5
    sparse = np.array(judge(("RGWWWW", "GBWWWW", *["WWWWWW"] * 4)))
    assert (sparse[:, 0] > figures[:, 0]).all()
    assert (sparse[:, 1:3] < figures[:, 1:3]).all()


def test_photographs_have_the_noise_that_the_fast_judge_expects() -> None:
    """Of a grey scene, in panchromatic samples; whatever the read noise is."""
    scene, seen = Scene(np.full((300, 300, 3), 0.4, np.float32), "grey"), []
    pattern = CfaPattern.bayer(6)
    for light in (Light.of_sigma(0.02), Light.of_photons(2000), Light.of_photons(2000, 20)):
        shot = SimulatedCamera.of(pattern, protocol=light.protocol, bits=16).shoot(scene, np.random.default_rng(0)).mosaic
        samples = shot.signal[pattern.panchromatic_mask(shot.shape)] / light.protocol.light
        assert samples.var() == pytest.approx(light.shot * 1.2 + light.read**2, rel=0.03)
        seen.append(str(light.protocol.identity))
    assert len(set(seen)) == 3


def test_white_noise_has_power_one() -> None:
    random = np.random.default_rng(0)
    noise = Spectra.measured([random.standard_normal((640, 640, 3))])
    known = noise.power[:, 4:, 4:, 0, 0] * np.array(SHARES)[:, None, None]
    assert known.sum(axis=0).mean() == pytest.approx(1, rel=0.02)
    np.testing.assert_allclose(Spectra.decode(noise.encode()).power, noise.power, rtol=5e-3, atol=1e-9)
    with pytest.raises(InputError, match="too few squares"):
        Spectra.measured([np.ones((64, 64, 3))])


def test_luminance_guides_colour() -> None:
    """Detail of colour that luminance shows counts as known, at least nine tenths of it."""
    random = np.random.default_rng(0)
    light = random.random((320, 320, 1)) * np.linspace(0.3, 1, 320)[:, None]
    one_ink, any_ink = light * (1, 0.6, 0.2), random.random((320, 320, 3)) * np.linspace(0.3, 1, 320)[:, None]
    guided, free = (Spectra.measured([each]).power[:, 8:, 8:] for each in (one_ink, any_ink))
    assert (guided[..., 1, 1] < 0.02 * guided[..., 0, 0]).all()
    assert (free[..., 1, 1] > 0.5 * free[..., 0, 0]).all()
