"""The forward model, from a scene to a mosaic (Eqs. 6-7), one pixel at a time."""

import numpy as np

from panchroma.shared import CfaPattern, DoubleArray, Mosaic, NoiseModel, SensorCalibration
from tests.reference.geometry import letter


def luminance_of(scene: DoubleArray, gamma: tuple[float, ...]) -> DoubleArray:
    """What panchromatic pixels read of a scene (H, W, C): sum_i gamma_i channel_i (Eq. 7), (H,
    W).
    """
    return sum(weight * scene[..., channel] for channel, weight in enumerate(gamma))  # type: ignore[return-value]  # Eq. 7


def observe(
    scene: DoubleArray,
    pattern: CfaPattern,
    gamma: tuple[float, ...] = (),
    sigma: float | None = None,
    noise: DoubleArray | None = None,
) -> Mosaic:
    """The mosaic of a scene (H, W, C).

    sigma: noise that the calibration states, scene units; None = unknown.
    noise: noise that is added to the samples, (H, W); None = none.
    """
    calibration = SensorCalibration(
        pattern.channels,
        gamma or (1.0,) * len(pattern.channels),
        None if sigma is None else NoiseModel.gaussian(sigma, len(pattern.channels) + 1),
    )
    samples = luminance_of(scene, calibration.gamma)
    for place in np.ndindex(samples.shape):
        if (name := letter(pattern, *place)) != "W":
            samples[place] = scene[place][pattern.channels.index(name)]  # Eq. 6
    if noise is not None:
        samples = samples + noise
    return Mosaic(samples.astype(np.float32), pattern, calibration)
