"""The forward model, from a scene to a mosaic (section 4); reconstruction inverts it."""

from dataclasses import replace

import numpy as np

from ...shared import CfaPattern, FloatArray, InputError, Mosaic, NoiseModel, SensorCalibration

# A small modern sensor in scene units at gamma = (1, 1, 1): 15,000 electrons at full scale (3 scene
# units), read noise 3 electrons.
TYPICAL_SHOT = 3 / 15_000
TYPICAL_READ = 3 * TYPICAL_SHOT
# NumPy draws no Poisson numbers much beyond it; no pixel holds a billionth as many
MOST_ELECTRONS = 1e18


def sample(rgb: FloatArray, pattern: CfaPattern, calibration: SensorCalibration) -> FloatArray:
    """The samples of a noiseless sensor, float32 (H, W), scene units: one channel at a colour site,
    Eq. 7 elsewhere, less what shading takes.

    Raises InputError when the three have different channels.

    Parameters
    ----------
    rgb : FloatArray
        The scene, (H, W, C), scene units, channels in the order of the pattern.
    pattern : CfaPattern
        The filter pattern, with C channels.
    calibration : SensorCalibration
        Its gamma and its shading are used.
    """
    if rgb.ndim != 3 or rgb.shape[2] != len(pattern.channels):
        channels = f"{len(pattern.channels)} channels ({pattern.channels})"
        raise InputError(f"a scene of shape {rgb.shape} for a pattern with {channels}")
    calibration.check_pattern(pattern)
    with np.errstate(over="ignore"):  # a mosaic refuses infinite samples
        # Eq. 7
        light = rgb @ np.array(calibration.gamma, np.float32)
        samples: FloatArray = light.astype(np.float32, copy=False)
    for channel, rows, columns in pattern.lattices:
        samples[rows, columns] = rgb[rows, columns, channel]
    return _shaded(samples, pattern, calibration, undone=False)


def simulate_additive(
    rgb: FloatArray,
    pattern: CfaPattern,
    calibration: SensorCalibration,
    sigma: float,
    rng: np.random.Generator,
) -> Mosaic:
    """Photograph a scene by the paper's protocol: additive Gaussian noise on every sample, nothing
    clipped.

    Returns a mosaic of float32 scene units; its calibration states this noise. Raises InputError
    when scene, pattern and calibration have different channels.

    Parameters
    ----------
    rgb : FloatArray
        The scene, (H, W, C), scene units.
    pattern : CfaPattern
        The sensor's filter pattern.
    calibration : SensorCalibration
        The sensor's calibration; its own noise model is not used.
    sigma : float
        Standard deviation of the noise, scene units, 0 or more.
    rng : np.random.Generator
        Source of the noise.
    """
    samples = sample(rgb, pattern, calibration)
    if sigma:
        with np.errstate(over="ignore"):
            samples += rng.normal(0, sigma, samples.shape).astype(np.float32)
    samples = _shaded(samples, pattern, calibration, undone=True)
    known = replace(calibration, noise=NoiseModel.gaussian(sigma, len(pattern.planes)))
    return Mosaic(samples, pattern, known)


def simulate_sensor(
    rgb: FloatArray,
    pattern: CfaPattern,
    calibration: SensorCalibration,
    exposure: float,
    rng: np.random.Generator,
) -> Mosaic:
    """Photograph a scene as a real sensor does: shot noise (Poisson), read noise, clipping at full
    scale, quantisation.

    Returns a mosaic of uint16 codes. Raises InputError when scene, pattern and calibration have
    different channels.

    Parameters
    ----------
    rgb : FloatArray
        The scene, (H, W, C), scene units.
    pattern : CfaPattern
        The sensor's filter pattern.
    calibration : SensorCalibration
        The sensor's calibration: gamma, noise (`typical_noise` if it has none), black and white
        level, and bits.
    exposure : float
        Factor by which the light is multiplied, positive.
    rng : np.random.Generator
        Source of the noise.
    """
    noise = calibration.noise or typical_noise(calibration)
    known = replace(calibration, noise=noise)
    light = sample(rgb, pattern, calibration) * np.float64(exposure)
    planes = pattern.filter_map(light.shape)
    shot, read = (np.array(figures)[planes] for figures in (noise.shot, noise.read))
    electrons = (light / np.where(shot > 0, shot, 1)).clip(0, MOST_ELECTRONS)
    counted = np.where(shot > 0, rng.poisson(electrons) * shot, light)
    noisy = np.minimum(counted + rng.normal(0, 1, light.shape) * read, calibration.full_scale)
    codes = Mosaic(noisy, pattern, replace(known, shading=None)).codes
    return Mosaic(codes, pattern, known)


def _shaded(
    samples: FloatArray, pattern: CfaPattern, calibration: SensorCalibration, *, undone: bool
) -> FloatArray:
    """Samples with the calibration's shading, or with it undone, in place."""
    if calibration.shading is None:
        return samples
    shape, change = (samples.shape[0], samples.shape[1]), np.multiply if undone else np.divide
    gain = calibration.shading.of_plane(shape)
    for channel, *lattice in pattern.lattices:
        gain[*lattice] = calibration.shading.of_plane(shape, channel, *lattice)
    return change(samples, gain, out=samples)


def typical_noise(calibration: SensorCalibration, unit: float = 1.0) -> NoiseModel:
    """Noise model of a small modern sensor, for the planes of the calibration. unit: its scene
    units that are one of a sensor with red, green and blue filters, see `Filters.unit`.
    """
    planes = len(calibration.channels) + 1
    return NoiseModel((TYPICAL_SHOT * unit,) * planes, (TYPICAL_READ * unit,) * planes)
