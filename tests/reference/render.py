"""The whole of section 3, in float64: from the mosaic to Eq. 17."""

import math
from itertools import chain
from typing import NamedTuple

import numpy as np

from panchroma.offline.settings import RenderSettings
from panchroma.shared import DoubleArray, Mosaic
from tests.reference import affinity, chromaticity, propagation, refinement
from tests.reference import luminance as wavelets
from tests.reference.geometry import block_sites, letter, whole_blocks


class Picture(NamedTuple):
    """A rendered mosaic, with the fields of `offline.Rendering` in float64."""

    rgb: DoubleArray
    luminance: DoubleArray
    chromaticity: DoubleArray


def sigma_of_light(mosaic: Mosaic, luminance: DoubleArray) -> float:
    """sigma_z of Eq. 16: panchromatic noise at the mean luminance; unknown noise counts as none."""
    noise = mosaic.calibration.noise
    return 0.0 if noise is None else noise.sigma(float(luminance.mean()))


def sigma_of_colour(mosaic: Mosaic) -> float:
    """sigma_z of Eqs. 8-9, one for all channels: the root of their mean variance at the mean sample
    of the whole blocks.
    """
    noise, pattern = mosaic.calibration.noise, mosaic.pattern
    if noise is None:
        return 0.0
    blocks = chain.from_iterable(whole_blocks(pattern, mosaic.shape))
    sites = [site[:2] for index in blocks for site in block_sites(pattern, index)]
    level = float(np.mean([mosaic.signal[site] for site in sites]))
    variances = [noise.sigma(level, channel) ** 2 for channel in range(len(pattern.channels))]
    return math.sqrt(np.mean(variances))


def render(mosaic: Mosaic, settings: RenderSettings) -> Picture:
    """The literal render, by the equations alone: stages that are not in the paper have to be
    off.
    """
    pattern, gamma = mosaic.pattern, mosaic.calibration.gamma
    signal = mosaic.signal.astype(np.float64)
    places = [letter(pattern, *place) == "W" for place in np.ndindex(mosaic.shape)]
    measured = np.array(places).reshape(mosaic.shape)

    stage = settings.luminance
    start = wavelets.start(signal, measured, around=stage.relative or len(pattern.sites) > 4)
    threshold = wavelets.first_threshold(signal, stage.threshold, relative=stage.relative)
    light = wavelets.recover(start, measured, stage.iterations, stage.decay, threshold)

    coarse = chromaticity.estimate(signal, light, pattern, gamma, sigma_of_colour(mosaic))
    coarse = chromaticity.oriented_medians(coarse, gamma, settings.chromaticity.repetitions)
    blocks = chromaticity.extend(coarse, pattern, mosaic.shape)
    alpha = affinity.fields(light, pattern, settings.affinity.scales)
    initial = propagation.propagate(blocks, alpha, light, pattern)

    last = settings.refinement
    h = max(last.strength * sigma_of_light(mosaic, light), last.floor)
    refined = refinement.refine(
        initial, light, pattern.period, h=h, blur_periods=last.blur, repetitions=last.repetitions
    )
    return Picture(refined * light[..., None], light, refined)  # Eq. 17
