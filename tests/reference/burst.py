"""How colour samples correct a picture: the exact minimum, by a direct solution."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from shared.arrays import DoubleArray, IndexArray


def corners(y: float, x: float, shape: tuple[int, ...]) -> list[tuple[int, int, float]]:
    """The four places around (y, x) and their shares."""
    top, left = min(int(y), shape[0] - 2), min(int(x), shape[1] - 2)
    down, across = y - top, x - left
    return [(top + i, left + j, (down if i else 1 - down) * (across if j else 1 - across)) for i in range(2) for j in range(2)]


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
