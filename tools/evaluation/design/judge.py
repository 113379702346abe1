"""The fast judge: the error that is left when the best linear estimate has been made of what a tile measures.

Photographs are taken for stationary Gaussian signals with the power of `Spectra`, S. A tile that repeats every K pixels mixes only
those K x K frequencies that alias onto each other. So for each such group the covariance of the samples of one tile is a small
matrix, H S H' + N, and what is left of the signal is tr(S - S H' (H S H' + N)^-1 H S). No picture is made.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from shared import Mosaic, NoiseModel
from shared.arrays import DoubleArray
from shared.errors import InputError
from shared.pattern import PANCHROMATIC
from tools.camera.protocols import PaperProtocol, Protocol, SensorProtocol
from tools.camera.protocols.protocol import SensorLight
from tools.camera.sensor import TYPICAL_READ, TYPICAL_SHOT
from tools.scenes.scene import BROADBAND, scene_channels

from .spectra import SHARES, ComplexArray, Spectra, basis, shipped

USUAL_READ = TYPICAL_READ / TYPICAL_SHOT
"""Read noise of the protocol sensor, electrons."""
_SIDE = 24  # pixels, about, of the torus on which tiles are judged: twice as many change differences between tiles by up to 0.05 dB


class Figures(NamedTuple):
    """What the fast judge says of a tile under one light: expected PSNR of pictures in scene units, dB.

    luminance, colour: of whole pictures, where colour is what remains of the channels after their mean.
    worst: of colour in the tenth of the squares with most fine colour.
    whole: of all channels in whole pictures.
    """

    luminance: float
    colour: float
    worst: float
    whole: float


@dataclass(frozen=True)
class ReadNoise(SensorProtocol):
    """The protocol sensor with another read noise. electrons: its standard deviation, 0 or more."""

    electrons: float = USUAL_READ

    @property
    def identity(self) -> list[str | float]:
        """See `Protocol.identity`."""
        return [*super().identity, self.electrons]

    def expose(self, light: SensorLight, rng: np.random.Generator) -> Mosaic:
        """As the protocol sensor. Arguments: see `Protocol.expose`."""
        shot = light.calibration.noise.shot if light.calibration.noise else ()
        noise = NoiseModel(shot, tuple(each * self.electrons for each in shot))
        return super().expose(replace(light, calibration=replace(light.calibration, noise=noise)), rng)


@dataclass(frozen=True)
class Light:
    """The noise of a sample of signal s: variance shot * s + read**2, scene units of a sensor with red, green and blue filters.

    protocol: the same noise on photographs.
    text: names it.
    """

    shot: float
    read: float
    protocol: Protocol
    text: str

    @classmethod
    def of_sigma(cls, sigma: float) -> "Light":
        """Additive noise of this standard deviation. Raises InputError for a negative one."""
        return cls(0.0, sigma, PaperProtocol(sigma), PaperProtocol(sigma).text)

    @classmethod
    def of_photons(cls, photons: float, electrons: float = USUAL_READ) -> "Light":
        """Shot noise and read noise, in electrons. photons: those that a panchromatic pixel counts in white at full exposure.

        Raises InputError unless there are photons, and for negative noise.
        """
        if not (0 < photons < np.inf and 0 <= electrons < np.inf):
            raise InputError(f"`photons` is {photons:g} and `read_noise` is {electrons:g}, expected more than 0, and 0 or more")
        shot, level = 3 / photons, photons * TYPICAL_SHOT / 3
        protocol = SensorProtocol(level) if electrons == USUAL_READ else ReadNoise(level, electrons)
        return cls(shot, shot * electrons, protocol, f"{photons:,.0f} photons")


@dataclass(frozen=True, eq=False)
class FastJudge:
    """Judges tiles with any of some filters under some lights, all at equal exposure.

    letters: the colour filters: C, M and Y pass two of red, green and blue; every other letter passes one channel. A channel that
        no site measures is what the panchromatic pixels see beyond the others.
    lights: the noise.
    spectra: what is known of photographs.
    side: pixels of the torus, about.
    """

    letters: str
    lights: tuple[Light, ...]
    spectra: Spectra
    side: int = _SIDE

    @classmethod
    def of(cls, letters: str, lights: Sequence[Light]) -> "FastJudge":
        """The judge that knows the photographs that ship with it."""
        return cls(letters, tuple(lights), shipped())

    @cached_property
    def filters(self) -> DoubleArray:
        """What each of the letters, and a panchromatic pixel at last, lets through of each channel of the scene: (A + 1, N)."""
        channels = scene_channels(self.letters if set(self.letters) - set("RGB") else "RGB")
        passed = [[float(each in BROADBAND.get(letter, letter)) for each in channels] for letter in self.letters]
        return np.array([*passed, [1.0] * len(channels)])

    @property
    def unmeasured(self) -> bool:
        """Whether some channel has no filter, and only the panchromatic pixels tell it: no render takes such tiles."""
        return bool(np.linalg.matrix_rank(self.filters[:-1]) < self.filters.shape[1])

    def light(self, tile: Sequence[str]) -> float:
        """Light collected from a white scene, as a multiple of what a Bayer sensor collects."""
        planes, count = self._planes(tile), self.filters.shape[1]
        return float(self.filters[planes].sum() / planes.size * 3 / count)

    def __call__(self, tile: Sequence[str]) -> list[Figures]:
        """The figures of a tile of K rows of K letters, one for each light."""
        planes, period, channels = self._planes(tile), len(tile), self.filters.shape[1]
        known = self._groups(period)
        rows, columns = np.divmod(np.arange(period**2), period)
        offset = (rows[:, None] - rows) % period * period + (columns[:, None] - columns) % period
        places = (planes[:, None] * len(self.filters) + planes) * period**2 + offset
        seen, told = known.seen[:, places], known.told[:, :, places]
        found = []
        for light in self.lights:
            signal = self.filters[planes].sum(axis=1) * self.spectra.light[:, None]
            noise = light.shot * channels / 3 * signal + (light.read * channels / 3) ** 2
            inverse = np.linalg.inv(seen + np.repeat(noise, len(known.weights), axis=0)[:, None] * np.eye(period**2))
            explained = np.einsum("gpq,lgqp->lg", inverse, told).real.reshape(2, len(SHARES), -1) @ known.weights
            luminance, colour = (known.prior - explained) / channels  # mean squared error, of each class
            errors = [luminance @ SHARES, colour @ SHARES, colour[-1], (luminance + colour) @ SHARES]
            found.append(Figures(*(-10 * np.log10(errors)).tolist()))
        return found

    def _planes(self, tile: Sequence[str]) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        return np.array([(self.letters + PANCHROMATIC).index(letter) for row in tile for letter in row])

    @lru_cache(maxsize=16)  # noqa: B019 (a judge lives as long as its search)
    def _groups(self, period: int) -> "_Groups":
        count = max(1, round(self.side / period))
        first = [(row, column) for row in range(count) for column in range(count)]
        alone = [each for each in first if each <= (-each[0] % count, -each[1] % count)]  # mirrored frequencies are alike
        weights = np.array([1.0 + (each != (-each[0] % count, -each[1] % count)) for each in alone]) / (count * period) ** 2
        steps = np.stack(np.meshgrid(np.arange(period), np.arange(period), indexing="ij"), axis=2)
        frequencies = (np.array(alone)[:, None, None] / count + steps) / period
        channels = self.filters.shape[1]
        power = self.spectra.at(frequencies, channels)  # (class, group, K, K, N, N)
        read = power @ (self.filters @ basis(channels).T).T
        seen = (self.filters @ basis(channels).T) @ read
        luminance = read[..., 0, :, None] * read[..., 0, None, :]
        told = luminance, np.swapaxes(read, -1, -2) @ read - luminance
        total = np.einsum("cgyxaa,g->ca", power, weights)
        prior = np.stack([total[:, 0], total[:, 1:].sum(axis=1)])
        return _Groups(weights, _of_offsets(seen), np.stack([_of_offsets(each) for each in told]), prior)


class _Groups(NamedTuple):
    """What all tiles of one size have in common, for G groups of frequencies of each class.

    weights: of the groups, (G,).
    seen: covariance of what two filters read, (classes * G, filters * filters * K * K), by the offset between their sites. The
        phase of a group is left out: it changes no trace.
    told: covariance of what each tells of luminance, and of colour, (2, classes * G, filters * filters * K * K).
    prior: power of luminance, and of colour, (2, classes).
    """

    weights: DoubleArray
    seen: ComplexArray
    told: ComplexArray
    prior: DoubleArray


def _of_offsets(power: DoubleArray) -> ComplexArray:
    """From power over frequencies (classes, G, K, K, A, A) to covariance over offsets (classes * G, A * A * K * K)."""
    classes, groups = power.shape[:2]
    spread = np.fft.ifft2(power, axes=(2, 3))
    return np.ascontiguousarray(np.moveaxis(spread, (4, 5), (2, 3))).reshape(classes * groups, -1)
