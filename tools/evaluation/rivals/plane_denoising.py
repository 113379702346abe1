"""Denoising of each colour plane before interpolation, for the shot of any pattern, as `denoise_bayer` does for Bayer shots.

BM3D needs samples on a regular grid. Where the sites of a channel make up one (Honda's green does), it gets them together,
otherwise those of each site of the tile by themselves. Filling a finer grid by interpolation first, and pushing the sites of all
rows together, were tried on four tiles and lost up to 2 dB. Panchromatic samples stay: the picture of the planes does not use them.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import gcd

from shared import CfaPattern, Mosaic
from shared.arrays import FloatArray

from ..method import Method
from .denoising import LEAST, denoise_plane
from .planes import planes


def denoised_planes(mosaic: Mosaic) -> FloatArray:
    """`planes` of a shot whose colour samples BM3D has denoised; float32 (H, W, C), scene units.

    BM3D gets the true noise, from the shot's calibration. Planes smaller than 8 x 8, and shots without noise or with unknown noise,
    are not denoised.
    Raises InputError as `planes` does.
    """
    noise, samples = mosaic.calibration.noise, mosaic.signal.copy()
    for channel, rows, columns in _grids(mosaic.pattern):
        plane = samples[rows, columns]
        if noise is not None and min(plane.shape) >= LEAST and (noise.shot[channel] or noise.read[channel]):
            samples[rows, columns] = denoise_plane(plane, noise.shot[channel], noise.read[channel])
    return planes(replace(mosaic, samples=samples))


def _grids(pattern: CfaPattern) -> Iterator[tuple[int, slice, slice]]:
    """(channel, rows, columns) of the regular grids that colour samples lie on: one for a channel if that is possible."""
    for channel in range(len(pattern.channels)):
        sites = [(rows, columns) for each, rows, columns in pattern.lattices if each == channel]
        starts = [(rows.start, columns.start) for rows, columns in sites]
        down, across = (gcd(pattern.period, *(start[axis] - starts[0][axis] for start in starts)) for axis in (0, 1))
        if len(sites) * down * across == pattern.period**2:
            sites = [(slice(starts[0][0] % down, None, down), slice(starts[0][1] % across, None, across))]
        yield from ((channel, rows, columns) for rows, columns in sites)


METHODS = (
    Method(
        "bm3d+planes",
        "BM3D + interpolated planes",
        denoised_planes,
        sparse=True,
        packages=("bm3d",),
        extra="rivals",
        seconds=15,
    ),
)
