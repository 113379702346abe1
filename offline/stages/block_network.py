"""Chromaticity of each block by a network on the grid of blocks that was trained on photographs;
not in the paper.

Eqs. 8-9 know a block by its sums alone. What runs under it (an edge, a stroke, a clipped sample)
and which of the blocks around have its colour is seen in the planes below, for each whole block and
in units of the frame's mean light, channels times gamma:

    x       mean luminance at the sites, not below 0
    y_i     reading of channel i at luminance x: x sum l m / sum l^2 over its sites
    s_i     standard deviation of its noise
    l_i     mean luminance at the sites of channel i, and f_i as the pixels around the block tell it
    low, high   range of the panchromatic samples in and next to the block
    s_w     standard deviation of the noise of a panchromatic sample of luminance x

With <.>_w the mean under a Gaussian of w blocks, b = <x>_1 and a = b + 2 s_w + 0.001, there are six
proposals of a chromaticity (sum 1):

    z_w = (<x y>_w + p / 3) / (<x^2>_w + p),  p = q <s^2>     w, q = 1.2, 1;  2.5, 0.3;  6, 0.05
    o   = (x y + p z_1.2) / (x^2 + p),  p = 100 <s^2>         of the block itself
    c, c'   of blocks that are alike: medians, after the first and the last pass of `pooling`

and three with a slope: lines through the samples m of each channel by luminance l, at x

    t_i = z + cov_w(l, m - z l) / (var_w(l) + r),  z = (<l m>_w + p / 3) / (<l^2>_w + p)
    q_i = <m>_w + t_i (x - <l>_w),  w = 0.8, 1.6, 3.2

The network sees (3 y_i - x) / a, (sum y_i - x) / a, (l_i - x) / a, (l_i - f_i) / a, x / a, low / a,
high / a, log2(s_i / a + 0.001) / 4, log2(b + 0.001) / 8, the share of clipped samples, log2(K / 6),
of each line the deviation of luminance and of samples from it, both / a, and its slope, and 3 z - 1
for each proposal z. It answers with the weights (by softmax) of the proposals and of the o of the
eight blocks around, and with what has to be added to chromaticity and slope in the plane of
constant luminance. A line ends at the least and at the greatest luminance at the sites of 3 x 3
blocks, and counts half beyond: what tells apart two colours of nearly one luminance says little of
a thin dark stroke between.
No input depends on exposure, and none on where in a block its sites are: one network serves every
pattern of R, G and B and every period. `tools/training/blocks.py` trains it, with the planes that
`block_planes` returns. Convolutions round to 8 bits. Chunks have fixed places, so that neither
threads nor memory change a bit, and overlap so far that no border shows.
"""

from collections.abc import Iterator, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from ...shared import CfaPattern, FloatArray, IndexArray
from ...shared.networks import NETWORKS, load_network
from ...shared.progress import Progress
from ..frame import Frame, mean_of_sites
from ..numerics.chunks import in_chunks, in_strips
from ..numerics.gaussian import gaussian, smoothed
from .chromaticity import ChromaticitySettings, estimate_chromaticities
from .colour_network import BASIS
from .pooling import PoolingSettings, pooled_in_passes

PATH = NETWORKS / "blocks.onnx"
"""The network."""
WIDTHS = ((1.2, 1.0), (2.5, 0.3), (6.0, 0.05))
"""Standard deviation in blocks of the proposals z, and weight q of the noise."""
LINES = (0.8, 1.6, 3.2)
"""Standard deviation of the lines, in blocks."""
PROPOSALS = len(WIDTHS) + len(LINES) + 3
"""Chromaticities that it sees of a block: o, z_1.2, z_2.5, z_6, c, c', and of the three lines."""
NEAR = tuple((down, across) for down in range(3) for across in range(3))
"""The block and those beside it, whose o it weighs too: row and column, from 0."""
CHOICES = len(NEAR) + PROPOSALS - 1
"""Chromaticities that it weighs."""
UNIT = np.float32(0.1)
"""Unit of what it adds, relative to grey."""
PLANES = 19 + 5 * len(LINES) + 3 * PROPOSALS
"""Number of its inputs for a block."""
RANGE = 6.0
"""Limit of its inputs."""
STEP = 8
"""Blocks of one place on the network's coarsest grid, down and across: it takes multiples."""
_SIDE = 256  # blocks down and across that are computed at once
_TOGETHER = 100_000  # blocks whose planes a thread computes at once: it takes 1 kB for each
# blocks around them, a multiple of STEP: it sees 63, but learned on 32 x 32, and those beyond 24
# change a chromaticity by 3e-4 (root of the mean square)
_HALO = 24
_ERROR = 0.2  # of filled luminance, as a multiple of its curvature, of the c and c' it learned from
_LEAST = np.float32(1e-3)
_EVEN = np.float32(0.02)  # of a: deviations of luminance that tell nothing of a slope
_TINY = np.float32(1e-7)  # keeps quotients finite


def serves(pattern: CfaPattern) -> bool:
    """True if the network can be asked: a pattern of R, G and B, with sites of each."""
    return pattern.channels == "RGB" and pattern.derived is None


def learned_chromaticities(
    frame: Frame, medians: ChromaticitySettings, pooling: PoolingSettings, progress: Progress
) -> tuple[FloatArray, FloatArray]:
    """c_j of every block of the grid, float32 (block rows, block columns, 3), and its line, (block
    rows, block columns, 8): c_j + s, with s the slope of colour beside c_j l, s times the luminance
    of the block, and the least and the greatest luminance at the sites of 3 x 3 blocks, its
    ends. sum_i gamma_i c_i = 1 and sum_i gamma_i s_i = 0.

    Raises
    ------
    InputError
        When the network cannot be read.
    """
    network = load_network(PATH)
    alike = alike_blocks(frame, medians, pooling, progress)
    height, width = frame.sites.shape
    lines = np.empty((height, width, 11), np.float32)
    # an even number in a row, so that two threads end together; one where each would see the frame
    columns = [*_chunks(width, 2 * -(-width // (2 * _SIDE)) if width > 2 * _HALO else 1)]
    for rows in _chunks(height, -(-height // _SIDE)):
        known = slice(int(rows.seen[0]), int(rows.seen[-1]) + 1)
        planes, lit = _planes_in_strips(frame, alike, known)
        seen = rows._replace(seen=rows.seen - known.start)
        _answer(network, planes, seen, columns, lines[..., :6])
        lit = lit[rows.place.start - known.start :][: rows.place.stop - rows.place.start]
        lines[rows.place, :, 6:9] = lines[rows.place, :, 3:6] * lit[..., None]
        del planes  # before those of the next rows
    lines[..., :9] /= np.tile(frame.gamma32, 3)
    lines[..., 3:6] += lines[..., :3]
    lines[..., 9], lines[..., 10] = line_ends(frame)
    blocks, spread = (frame.grid.extend(planes) for planes in np.split(lines, [3], axis=2))
    return blocks, spread


def line_ends(frame: Frame) -> tuple[FloatArray, FloatArray]:
    """The least and the greatest luminance at the sites of 3 x 3 blocks, (rows, columns) each, for
    the whole blocks of a frame.
    """
    at_sites = [frame.luminance[place] for place in frame.sites.places]
    least, greatest = (reduce(of, at_sites) for of in (np.minimum, np.maximum))
    return minimum_filter(least, 3), maximum_filter(greatest, 3)


class Chunk(NamedTuple):
    """Blocks that are computed at once, along one axis.

    Attributes
    ----------
    place : slice
        Where they are in the frame.
    seen : IndexArray
        Numbers of the blocks that the network sees, as many as it takes; those at the border of the
        frame are repeated.
    around : slice
        Where they, and one more on each side, are in those.
    """

    place: slice
    seen: IndexArray
    around: slice


def _chunks(whole: int, count: int) -> Iterator[Chunk]:
    """`count` chunks or fewer, of one size but for the last."""
    size = -(-whole // (count * STEP)) * STEP
    for start in range(0, whole, size):
        end = min(start + size, whole)
        # beyond the border of the frame the network sees zeros: blocks are repeated before that
        first, last = max(start - _HALO, -STEP), min(end + _HALO, whole + STEP)
        seen = first + np.arange(-(-(last - first) // STEP) * STEP)
        around = slice(start - first - 1, end - first + 1)
        yield Chunk(slice(start, end), seen.clip(0, whole - 1), around)


def _planes_in_strips(
    frame: Frame, alike: tuple[FloatArray, FloatArray], rows: slice
) -> tuple[FloatArray, FloatArray]:
    """Planes and luminance of rows, as `block_planes` makes them of all; threads share them."""
    (height, width), count = frame.sites.shape, rows.stop - rows.start
    planes = np.empty((PLANES, count, width), np.float32)
    at_sites, reach = np.empty((count, width), np.float32), gaussian(WIDTHS[-1][0]).size // 2

    def work(strip: slice) -> None:
        first, end = rows.start + strip.start, rows.start + strip.stop
        seen = slice(max(first - reach, 0), min(end + reach, height))
        found, lit = block_planes(frame, alike, seen)
        inner = slice(first - seen.start, first - seen.start + strip.stop - strip.start)
        planes[:, strip], at_sites[strip] = found[:, inner], lit[inner]

    in_strips(work, count, min(-(-count // 2), -(-_TOGETHER // width)))
    return planes, at_sites


def _answer(
    network: Any, planes: FloatArray, rows: Chunk, columns: Sequence[Chunk], lines: FloatArray
) -> None:
    """Write the lines (see `mixed`) of some rows of a frame, (rows, columns, 6)."""

    def work(chunk: int) -> None:
        place, seen, around = columns[chunk]
        here = planes[:, rows.seen[:, None], seen]
        (answer,) = network.run(None, {"planes": here[None]})
        answer, here = (values[:, rows.around, around] for values in (answer[0], here))
        lines[rows.place, place] = np.moveaxis(mixed(here, answer)[:, 1:-1, 1:-1], 0, 2)

    in_chunks(lambda first, _: work(first), len(columns))


def alike_blocks(
    frame: Frame, medians: ChromaticitySettings, pooling: PoolingSettings, progress: Progress
) -> tuple[FloatArray, FloatArray]:
    """Chromaticities of the whole blocks, c and c', float32 (rows, columns, 3) each."""
    single = estimate_chromaticities(frame, medians, progress)
    passes = pooled_in_passes(single, frame, pooling, _ERROR, progress)
    return passes[0], passes[-1]


def mixed(planes: FloatArray, answer: FloatArray) -> FloatArray:
    """Chromaticities and slopes, times gamma, by the answer of the network, (6, rows, columns): the
    proposals in the planes weighed, with what has to be added.

    Parameters
    ----------
    planes : FloatArray
        (PLANES, rows, columns).
    answer : FloatArray
        (4 + CHOICES, rows, columns).
    """
    weights = np.exp(answer[4:] - answer[4:].max(axis=0))
    weights /= weights.sum(axis=0)
    rows, columns = planes.shape[1:]
    shown = planes[-3 * (len(LINES) + PROPOSALS) :].reshape(-1, 3, rows, columns)
    slopes, proposals = np.split(shown, [len(LINES)])
    own, *others = proposals
    wide = np.pad(own, ((0, 0), (1, 1), (1, 1)), mode="edge")
    beside = (wide[:, down : down + rows, across : across + columns] for down, across in NEAR)
    odd, slope = (np.einsum("kyx,ki->iyx", answer[at : at + 2], UNIT * BASIS) for at in (0, 2))
    for weight, proposal in zip(weights, (*beside, *others), strict=True):
        odd += weight * proposal
    for weight, proposed in zip(weights[-len(LINES) :], slopes, strict=True):
        slope += weight * proposed
    # proposals that were limited do not sum to one
    lines = np.concatenate([1 + odd - odd.mean(axis=0), slope - slope.mean(axis=0)]) / 3
    return np.asarray(lines, np.float32)


def block_planes(
    frame: Frame, alike: tuple[FloatArray, FloatArray], rows: slice | None = None
) -> tuple[FloatArray, FloatArray]:
    """Inputs of the network for whole blocks, (PLANES, rows, columns), and their luminance, scene
    units, (rows, columns); float32.

    Parameters
    ----------
    alike : tuple[FloatArray, FloatArray]
        What `alike_blocks` returns.
    rows : slice | None, optional
        Of blocks; None = all.
    """
    sites, gamma, level = frame.sites, frame.gamma32, np.float32(frame.level)
    rows = slice(0, sites.shape[0]) if rows is None else rows
    channels, counts = sites.channels, sites.pattern.site_counts[:, None, None].astype(np.float32)
    samples = sites.in_rows(frame.signal, rows)
    around = sites.surroundings(frame.signal, rows)
    lit = sites.in_rows(frame.luminance, rows) / level
    read = samples * gamma[channels] / level
    means = (sites.means(v) for v in (lit, read, lit * lit, lit * read, read * read))
    moments = np.concatenate([_planes(v) for v in means])
    own, weight, product = moments[:3], moments[6:9], moments[9:12]
    at_sites = np.maximum(mean_of_sites(lit), 0)
    x, share = at_sites[None], np.ones_like(weight)
    if (others := frame.others) is not None:
        unit = counts * level**2
        added = weight + _planes(others.weight[rows]) / unit
        product = product + _planes(others.product[rows] * gamma) / unit
        weight, share = added, weight / np.maximum(added, _TINY**2)
    s, w = np.zeros_like(own), np.zeros_like(x)
    if (noise := frame.noise) is not None:
        variance = frame.variance(np.maximum(samples, 0), rows, channels) * gamma[channels] ** 2
        s = np.sqrt(_planes(sites.means(variance)) * share / counts) / level
        w = np.sqrt(noise.variance(at_sites * level, -1))[None] / level
    cap = 4 * np.maximum(x, 3 * w + np.float32(1e-4))
    y = (x * product / np.maximum(weight, _TINY**2)).clip(-cap, cap)
    f, low, high = (_planes(v) / level for v in (sites.means(around.filled), *around[1:]))
    clipped = (samples >= frame.limits(rows)).mean(axis=2) + (around.highest >= frame.clipping)
    b = smoothed(x, 1.0)
    a = b + 2 * w + _LEAST
    square = (s**2).mean(axis=0, keepdims=True, dtype=np.float32)
    proposals = list[FloatArray]()
    for width, factor in WIDTHS:
        prior: FloatArray = np.float32(factor) * square + _TINY
        pooled = smoothed(np.concatenate([x * y, x**2]), width)
        proposals.append(_unit((pooled[:3] + prior / 3) / (pooled[3:] + prior)))
    prior = 100 * square + _TINY
    single = _unit((x * y + prior * proposals[0]) / (x**2 + prior)).clip(-0.5, 1.5)
    similar = (_planes(chromaticity[rows] * gamma) for chromaticity in alike)
    fits = [_line(smoothed(moments, width), x, square, a) for width in LINES]
    excess = y.sum(axis=0, keepdims=True, dtype=np.float32) - x
    shown = [plane / a for plane in (3 * y - x, excess, own - x, own - f, x, low, high)]
    shown += [np.log2(s / a + _LEAST) / 4, np.log2(b + _LEAST) / 8, _planes(clipped / 2)]
    shown.append(np.full_like(x, np.log2(sites.grid.period / 6)))
    for spread, missed, _, _ in fits:
        shown += [spread, missed]
    shown += [3 * slope for *_, slope, _ in fits]
    shown += [3 * z - 1 for z in (single, *proposals, *similar, *(z for *_, z in fits))]
    planes = np.concatenate(shown, dtype=np.float32)
    return np.clip(planes, -RANGE, RANGE, out=planes), at_sites * level


def _planes(values: NDArray[Any]) -> FloatArray:
    """Values of blocks, (rows, columns) or (rows, columns, C), as planes, (C, rows, columns)."""
    return np.moveaxis(np.atleast_3d(values), 2, 0).astype(np.float32)


def _line(
    moments: FloatArray, x: FloatArray, noise: FloatArray, a: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Deviation of luminance and of samples from their line, and its slope and chromaticity at x.

    Parameters
    ----------
    moments : FloatArray
        <l>, <m>, <l^2>, <l m>, <m^2> of each channel, (15, rows, columns).
    x, noise, a : FloatArray
        See above; noise is <s^2>. (1, rows, columns).
    """
    luminance, mean, square, product, power = moments.reshape(5, 3, *moments.shape[1:])
    prior = noise + _TINY
    z = (product + prior / 3) / (square + prior)
    spread, together = np.maximum(square - luminance**2, 0), product - luminance * mean
    total = z + (together - z * spread) / (spread + 4 * noise + (_EVEN * a) ** 2)
    total = (total + (1 - total.sum(axis=0)) / 3).clip(-2, 3)
    missed = (power - mean**2) - 2 * total * together + total**2 * spread
    prior = prior + (_EVEN * a) ** 2
    reached = mean + total * (x - luminance)
    chromaticity = _unit((x * reached + prior * z) / (x**2 + prior)).clip(-0.5, 1.5)
    slope, squares = total - chromaticity, (spread, np.maximum(missed, 0))
    spread, missed = (np.sqrt(plane.mean(axis=0, keepdims=True)) / a for plane in squares)
    return spread, missed, slope - slope.mean(axis=0), chromaticity


def _unit(chromaticity: FloatArray) -> FloatArray:
    """Scaled to a sum of one."""
    total = chromaticity.sum(axis=0, keepdims=True)
    return np.asarray(chromaticity / np.maximum(total, np.float32(0.3)), np.float32)
