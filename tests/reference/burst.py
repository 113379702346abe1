"""The merging of a burst, written down as literally as possible: float64, no tiles, one sample after the other."""

import numpy as np
from scipy import sparse
from scipy.ndimage import correlate
from scipy.sparse.linalg import spsolve

from offline.burst import Motion
from shared.arrays import BoolArray, DoubleArray, IndexArray
from tests.reference.geometry import keys

ROUNDS, FILLED, SPARSE = 4, 0.05, 0.05
NARROW, WIDE = (np.exp(-(np.arange(-4 * sigma, 4 * sigma + 1) ** 2) / (2 * sigma**2)) for sigma in (0.5, 2))
NARROW, WIDE = NARROW / NARROW.sum(), WIDE / WIDE.sum()


def corners(y: float, x: float, shape: tuple[int, ...]) -> list[tuple[int, int, float]]:
    """The four places around (y, x) and their shares."""
    top, left = min(int(y), shape[0] - 2), min(int(x), shape[1] - 2)
    down, across = y - top, x - left
    return [(top + i, left + j, (down if i else 1 - down) * (across if j else 1 - across)) for i in range(2) for j in range(2)]


def blurred(plane: DoubleArray, taps: DoubleArray) -> DoubleArray:
    """Along both axes; mirrored at the edges."""
    return correlate(correlate(plane, taps[:, None], mode="mirror"), taps[None], mode="mirror")


def merge(
    planes: DoubleArray, trust: DoubleArray, noise: DoubleArray, panchromatic: BoolArray, motions: list[Motion]
) -> tuple[DoubleArray, DoubleArray]:
    """The luminance of the reference, which is the first frame, on a grid of half pixels; and the variance of the start.

    planes: (F, H, W). trust: the same, 0 to 1, at the pixels of the reference. noise: (F, 2), shot and squared read noise.
    """
    _, height, width = planes.shape

    def inside(y: float, x: float) -> bool:
        return bool(-0.5 <= y < height - 0.5 and -0.5 <= x < width - 0.5)

    def variance(frame: int, light: float) -> float:
        return float(noise[frame, 0] * max(light, 0) + noise[frame, 1])

    def precision(frame: int, light: float) -> float:
        return variance(0, light) / variance(frame, light) if noise[0].any() else 1.0

    start, spread = np.empty((height, width)), np.empty((height, width))
    for y, x in np.ndindex(height, width):
        shares, values, precisions = [], [], []
        for frame, motion in enumerate(motions):
            there = [float(each[0, 0]) for each in place(motion, y, x, (height, width))]
            if trust[frame, y, x] > 0 and inside(*there):
                at = np.clip(there[0], 0, height - 1.001), np.clip(there[1], 0, width - 1.001)
                measured = sum(share * panchromatic[i, j] for i, j, share in corners(*at, (height, width)))
                precisions.append(precision(frame, planes[0, y, x]))
                shares.append((FILLED + measured) * trust[frame, y, x])
                values.append(keys(planes[frame], *there))
        weights = np.array(shares) * precisions
        start[y, x] = weights @ values / weights.sum()
        spread[y, x] = min(weights @ shares / weights.sum() ** 2, 1)
    fine = np.array([[keys(start, y / 2, x / 2) for x in range(2 * width - 1)] for y in range(2 * height - 1)])
    samples = []
    for frame, motion in enumerate(motions):
        for row, column in np.argwhere(panchromatic):
            y, x = (float(each) for each in motion.back(np.array(row, np.float32), np.array(column, np.float32), (height, width)))
            near = int(y + 0.5), int(x + 0.5)
            if 0 <= y <= height - 1 and 0 <= x <= width - 1 and trust[frame, *near] > 0:
                value = planes[frame, row, column]
                samples.append((2 * y, 2 * x, value, trust[frame, *near] * precision(frame, value), variance(frame, value)))

    def shared_out(values: list[float]) -> DoubleArray:
        plane = np.zeros(fine.shape)
        for (y, x, *_), value in zip(samples, values, strict=True):
            for i, j, share in corners(y, x, fine.shape):
                plane[i, j] += share * value
        return plane

    count = shared_out([weight for *_, weight, _ in samples])
    for _ in range(ROUNDS):
        missed = [value - keys(fine, y, x) for y, x, value, *_ in samples]
        weighted = [weight * error for error, (*_, weight, _) in zip(missed, samples, strict=True)]
        gain = np.ones(fine.shape)
        if noise[0].any():
            power = shared_out([part * error / own for part, error, (*_, own) in zip(weighted, missed, samples, strict=True)])
            gain = np.maximum(0, 1 - blurred(count, WIDE) / np.maximum(blurred(power, WIDE), 1e-20))
        fine += gain * blurred(shared_out(weighted), NARROW) / (blurred(count, NARROW) + SPARSE)
    return fine, spread


def place(motion: Motion, y: int, x: int, shape: tuple[int, int]) -> tuple[DoubleArray, DoubleArray]:
    """Where a pixel of the reference lies in the frame."""
    down, across = motion.places(slice(y, y + 1), shape)
    return down[:, x : x + 1].astype(np.float64), across[:, x : x + 1].astype(np.float64)


def spread(
    luminance: DoubleArray,
    chromaticity: DoubleArray,
    samples: tuple[DoubleArray, IndexArray],
    gamma: DoubleArray,
    basis: DoubleArray,
    prior: tuple[float, float, float],
) -> DoubleArray:
    """Chromaticity corrected by colour samples: the exact minimum. samples: figures and channels, as `spread_samples` has them."""
    (height, width), parts = luminance.shape, basis.shape[1]
    size = height * width
    smoothness, fading, edge = prior
    matrix, right = sparse.lil_matrix((parts * size, parts * size)), np.zeros(parts * size)
    for (y, x, value, light, precision), channel in zip(*samples, strict=True):
        around = corners(y, x, luminance.shape)
        seen = sum(share * chromaticity[i, j, channel] for i, j, share in around)
        error = value - gamma[channel] * seen * light
        for i, j, share in around:
            for part in range(parts):
                right[part * size + i * width + j] += share * precision * basis[channel, part] * error
                for other in range(parts):
                    factor = share * precision * basis[channel, part] * basis[channel, other]
                    matrix[part * size + i * width + j, other * size + i * width + j] += factor
    for i, j in np.ndindex(height, width):
        for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
            if i + down < height and 0 <= j + across < width:
                step = luminance[i + down, j + across] - luminance[i, j]
                link = smoothness * (0.5 if down and across else 1) / (1 + (step / edge) ** 2)
                for part in range(parts):
                    a, b = part * size + i * width + j, part * size + (i + down) * width + j + across
                    matrix[a, a] += link
                    matrix[b, b] += link
                    matrix[a, b] -= link
                    matrix[b, a] -= link
    solved = spsolve((matrix + fading * sparse.identity(parts * size)).tocsc(), right).reshape(parts, height, width)
    return chromaticity + np.einsum("cp,pyx->yxc", basis, solved) / (gamma * luminance[..., None])
