"""Agreement of a frame with the reference at each pixel, beyond noise: 0 where something moved, was
hidden or changed.

They are compared where both measure luminance. The image has detail finer than a pixel, which each
frame samples at other places (aliasing), so edges and texture differ even where nothing has
changed: differences are tolerated in proportion to the contrast of both. Four signs show a change:
another mean; differences as large as the texture; many small differences of one sign over a wide
neighbourhood (a pale thing in noise); and differences that a shift explains (a branch that sways by
a fraction of a pixel).

Something may move in front of something else of the same luminance. The shares of the channels in
its blocks then lie outside those of all blocks of the reference nearby. A thin coloured line may do
the same to a single block, so a deviation counts where four blocks together show it, or most of a
neighbourhood.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import grey_opening, map_coordinates, maximum_filter, minimum_filter

from ...shared.arrays import BoolArray, ByteArray, DoubleArray, FloatArray, IndexArray, strips
from ...shared.mosaic import Mosaic
from ..frame import Sites
from ..numerics.gaussian import gaussian, smoothed
from .align import CLIPPED, DEVIATIONS, TINY, View
from .motion import Motion, displaced, in_frame, in_reference

NEIGHBOURHOOD = 1.5
"""Pixels: standard deviation of the Gaussian within which contrast is measured. Chosen."""
FILL_ERROR = 0.3
"""Error of filled luminance as a share of that contrast. Chosen on moving things."""

# Chosen on drawn scenes with noise, parallax or a moving thing, and on photographs. What each
# finds: tests/offline/burst/test_agree.py.
_SHIFTED, _WIDE = 2.0, 5.0  # pixels: standard deviations of larger neighbourhoods
_MEAN, _TEXTURE, _FAR = 0.3, 0.6, 0.1  # difference that is tolerated, a share of the contrast
_EXPOSURE = 0.01  # of the luminance: what a changed exposure or a cloud may do
_SHIFT = 0.2  # pixels: what motion may be wrong by (parallax)
_POWER = 0.3  # of the variance of noise: how much the power of differences may vary
_GAPS = 1.2  # by which pixels that do not measure luminance raise the noise of a mean
# raw agreement that counts as none, and as all: half-true ghosts of many frames would add up
_LOW, _HIGH = 0.3, 0.8
_FRINGE = 3  # pixels: size of the neighbourhood that has to agree as a whole
_BRIGHT = 0.92  # of the limit: brighter samples count less, in a bracket
# halo of the rows that are compared at a time
_HALO = sum(len(gaussian(sigma)) // 2 for sigma in (NEIGHBOURHOOD, _WIDE)) + _FRINGE // 2


BlockColours = tuple[DoubleArray, DoubleArray, DoubleArray, DoubleArray, BoolArray]
"""See `block_colours`."""


class Reference(NamedTuple):
    """The frame that others are compared with.

    Attributes
    ----------
    shot : Mosaic
        Its mosaic.
    frame, lit_evenly : View
        The frame, and without shading.
    colours : BlockColours
        Colours of its blocks.
    """

    shot: Mosaic
    frame: View
    lit_evenly: View
    colours: BlockColours


def lit_evenly(view: View, shot: Mosaic) -> View:
    """A frame without its shading, to find its motion: the image moves, shading does not.

    Its noise is that of the mean over the frame, and the limit that of the least gain.
    """
    if (shading := shot.calibration.shading) is None:
        return view
    gain = shading.of_plane(shot.shape)
    noise = view.noise.in_units_of(1 / float(np.square(gain).mean()) ** 0.5)
    return View(view.luminance * gain, noise, view.limit * float(gain.min()))


def shaded_alike(frame: View, shot: Mosaic, reference: Mosaic, motion: Motion) -> View:
    """A frame in which each point has the shading that it has in the reference.

    Its noise is that of the mean over the frame: shading differs little over a motion.
    """
    own, other = (mosaic.calibration.shading for mosaic in (shot, reference))
    if own is None and other is None:
        return frame
    ratio = own.of_plane(shot.shape) if own else np.ones(shot.shape, np.float32)
    gain = other.of_plane(shot.shape) if other else np.ones(shot.shape, np.float32)
    for rows in strips(len(ratio)):
        places = in_reference(motion, *_pixels(rows, shot), shot.shape)
        ratio[rows] /= map_coordinates(gain, places, order=1, mode="nearest")
    luminance, noise = frame.luminance * ratio, frame.noise.in_units_of(1 / float(ratio.mean()))
    limit = frame.limit * min(float(ratio.min()), 1.0)
    colours = frame.colours * Sites.in_frame(shot).of(ratio)
    return View(luminance, noise, limit, colours, frame.colour_gains)


@np.errstate(under="ignore")  # whatever the caller's program asks for
def agreement(reference: Reference, frame: View, moved: FloatArray, motion: Motion) -> ByteArray:
    """Agreement of luminance and of the colours of blocks at each pixel, 0 to 255, uint8 (H, W).

    Where the reference is clipped, a frame agrees that is not clipped and at least as bright, and
    no other.

    Parameters
    ----------
    frame : View
        In units of the reference.
    moved : FloatArray
        Its luminance as the reference would see it; NaN where it sees nothing.
    """
    mask = reference.shot.pattern.panchromatic_mask(moved.shape).astype(np.float32)
    # rather than interpolated, in both
    measured = np.square(np.nan_to_num(displaced(mask, motion)).clip(0, 1)) * mask
    deviation, result = colour_change(reference, frame, motion), np.empty(moved.shape, np.uint8)
    own = reference.frame
    for rows in strips(len(moved)):
        first = max(rows.start - _HALO, 0)
        near = slice(first, rows.stop + _HALO)
        views = replace(own, luminance=own.luminance[near]), replace(frame, luminance=moved[near])
        agrees = agreement_of_luminance(*views, measured[near])[rows.start - first :]
        colour = _agreement_of(_on_pixels(deviation, motion, reference.shot, rows))
        result[rows] = np.rint(agrees[: len(colour)] * colour)
    return result


def _pixels(rows: slice, shot: Mosaic) -> tuple[IndexArray, IndexArray]:
    """Rows and columns of some rows of a frame."""
    return np.arange(rows.start, rows.stop)[:, None], np.arange(shot.shape[1])


def agreement_of_luminance(reference: View, frame: View, measured: FloatArray) -> ByteArray:
    """Agreement by luminance alone.

    Parameters
    ----------
    measured : FloatArray
        (H, W), 0 to 1, how far both measure luminance there.
    """
    visible = np.isfinite(frame.luminance)
    frame = replace(frame, luminance=np.where(visible, frame.luminance, reference.luminance))
    shown, own_shown = unclipped(frame) * visible, unclipped(reference)
    weight = measured * (shown > 0) * (own_shown > 0) + np.float32(1e-4)
    agrees = _agreement_of(_deviation(reference, frame, weight.astype(np.float32)))
    agrees = np.where(own_shown == 0, frame.luminance > _BRIGHT * reference.limit, agrees)
    return np.rint(255 * minimum_filter(shown * agrees, _FRINGE)).astype(np.uint8)


def unclipped(view: View) -> FloatArray:
    """1 for luminance well below the limit, 0 where it is clipped, (H, W)."""
    below = CLIPPED - view.luminance / np.float32(view.limit)
    return np.clip(below / np.float32(CLIPPED - _BRIGHT), 0, 1)


def _agreement_of(deviation: FloatArray) -> FloatArray:
    """Agreement, 0 to 1, from squared deviations in units of the tolerance."""
    return np.clip((1 / (1 + np.square(deviation)) - _LOW) / (_HIGH - _LOW), 0, 1)


def _deviation(reference: View, frame: View, weight: FloatArray) -> FloatArray:
    """The squared difference in units of the tolerance, (H, W): the largest of four."""
    r, f = reference.luminance, frame.luminance
    own, other, difference = reference.variance(r), frame.variance(f), f - r
    noise = own + other
    planes = r, f, r * r, f * f, difference, difference * difference
    r_mean, f_mean, power, power_shown, mean, variance = _means(weight, NEIGHBOURHOOD, *planes)
    texture, shown = power - r_mean * r_mean - own, power_shown - f_mean * f_mean - other
    contrast = np.maximum(np.minimum(texture, shown), 0)
    even = np.square(_EXPOSURE * r_mean)
    tolerated, left = _MEAN**2 * contrast + even, _noise_left(NEIGHBOURHOOD)
    largest = mean * mean / (tolerated + DEVIATIONS**2 * left * noise + TINY)
    variance = np.maximum(variance - (1 + DEVIATIONS * (2 * left) ** 0.5) * noise, 0)
    tolerated_variance = _TEXTURE**2 * contrast + 4 * even + _POWER * noise + TINY
    np.maximum(largest, variance / tolerated_variance, out=largest)
    cap = DEVIATIONS * np.sqrt(noise + tolerated)
    mean, contrast = _means(weight, _WIDE, np.clip(difference, -cap, cap), contrast)
    scatter = DEVIATIONS**2 * _noise_left(_WIDE) * noise
    np.maximum(largest, mean * mean / (_FAR**2 * contrast + even + scatter + TINY), out=largest)
    # nothing slopes across a single row or column
    down, across = (
        np.gradient((r + f) / 2, axis=axis) if size > 1 else np.zeros_like(r)
        for axis, size in enumerate(r.shape)
    )
    products = down * down, down * across, across * across, down * difference, across * difference
    dd, da, aa, d, a = _means(weight, _SHIFTED, *products)
    least = noise / 4 + TINY  # what noise makes of a gradient
    dd, aa = np.maximum(dd - noise / 4, 0) + least, np.maximum(aa - noise / 4, 0) + least
    determinant = np.maximum(dd * aa - da * da, 1e-3 * dd * aa)
    explained = (aa * d * d - 2 * da * d * a + dd * a * a) / determinant
    scatter = DEVIATIONS**2 * _noise_left(_SHIFTED) * noise
    return np.maximum(largest, explained / (_SHIFT**2 * (dd + aa) + even + scatter + TINY))


def _means(weight: FloatArray, sigma: float, *planes: FloatArray) -> list[FloatArray]:
    """Weighted means around each pixel."""
    total = np.float32(1) / smoothed(weight, sigma)
    return [smoothed(weight * plane, sigma) * total for plane in planes]


def _noise_left(sigma: float) -> float:
    """The share of the variance of noise that is left in such a mean."""
    return _GAPS * float(np.square(gaussian(sigma)).sum()) ** 2


# Chosen on a thing that only its colour shows. Fraction of luminance by which a channel may differ:
# of one block, over a neighbourhood
_BLOCK, _NEARBY = 0.03, 0.02
_WIDTH = 1.5  # blocks: standard deviation of that neighbourhood
# standard deviations by which noise makes nine figures exceed their middle: 1.49 is expected of the
# largest
_RANGE = 1.5
# variance of the middle of that range, relative to one figure's; neighbours share it
_SHARED = 0.15
_ALL = 1 - 1e-6  # of four blocks, interpolated
_AROUND = 5  # pixels: size of what luminance at a site is filled from
# by which a gain of colour differs where only noise and things that move do; blocks that tell it;
# its standard error, from the median deviation of blocks that share their noise with those nearby
_CAST, _FEWEST, _ALIKE = 0.01, 100, 10.0
_RIM = 3  # blocks: a deviation counts for its neighbours too, as the thing ends somewhere between


def _there(mosaic: Mosaic, motion: Motion, planes: FloatArray | DoubleArray) -> DoubleArray:
    """Planes of the whole blocks of the reference, as the blocks of the frame would see them."""
    sites = Sites.in_frame(mosaic)
    first, period = np.array(sites.middle)[:, None, None], sites.grid.period
    rows, columns = first + period * np.indices(sites.shape)
    at = (in_reference(motion, rows, columns, mosaic.shape) - first) / period
    return np.stack([map_coordinates(plane, at, order=1, mode="nearest") for plane in planes])


def relight(frame: View, reference: Reference, motion: Motion) -> View:
    """Return a frame with its colour samples as in the light of the reference: lamps flicker, and
    clouds pass.

    Each channel has one gain, the median over the blocks: things that move hardly change it.
    """
    channels, luminance, *_, known = reference.colours
    planes = np.stack([*channels, luminance, minimum_filter(known, 3)])
    *own, near = _there(reference.shot, motion, planes)
    channels, luminance, *_, known = block_colours(frame, reference.shot)
    used = known & (near > _ALL)
    both = smoothed(np.stack([own, [*channels, luminance]]) * used, _WIDTH)
    used &= (both > TINY).all(axis=(0, 1))
    if np.count_nonzero(used) < _FEWEST:
        return frame
    before, seen = both[..., used]
    ratios = seen[:-1] / seen[-1] * before[-1] / before[:-1]
    gains = np.median(ratios, axis=1, keepdims=True)
    error = _ALIKE * np.median(np.abs(ratios - gains), axis=1) / ratios.shape[1] ** 0.5
    if (np.abs(gains[:, 0] - 1) <= _CAST + DEVIATIONS * error).all():
        return frame
    of_sites = gains[Sites.in_frame(reference.shot).channels, 0]
    colours, colour_gains = frame.colours / of_sites, frame.colour_gains / of_sites
    return replace(frame, colours=colours, colour_gains=colour_gains)


def colour_change(reference: Reference, frame: View, motion: Motion) -> FloatArray:
    """Squared deviation of each whole block of the frame, (block rows, block columns), in units of
    the tolerance.
    """
    mosaic = reference.shot
    channels, luminance, rough, noise, own_known = reference.colours
    shares, deviations = channels / luminance, np.sqrt(noise) / luminance
    low, high = minimum_filter(shares, (1, 3, 3)), maximum_filter(shares, (1, 3, 3))
    near = minimum_filter(own_known, 3).astype(np.float64)
    own = (low + high) / 2, (high - low) / 2 - _RANGE * deviations, noise, rough[None], near[None]
    middle, half, noise, rough, near = (_there(mosaic, motion, planes) for planes in own)
    half = np.maximum(half, 0)
    channels, luminance, contrast, own_noise, known = block_colours(frame, mosaic)
    beyond = channels - np.clip(channels, (middle - half) * luminance, (middle + half) * luminance)
    beyond *= known & (near[0] > _ALL)  # what is clipped or dark has no colour
    filled = np.square(FILL_ERROR * middle) * (contrast + rough)
    spread = DEVIATIONS**2 * (own_noise + noise)
    alone = np.square(beyond) / (np.square(_BLOCK * luminance) + filled + spread + TINY)
    cap = np.sqrt(2 * np.square(_NEARBY * luminance) + spread + TINY)
    mean = smoothed(np.clip(beyond, -cap, cap), _WIDTH)
    left = float(np.square(gaussian(_WIDTH)).sum()) ** 2
    spread = DEVIATIONS**2 * (left * own_noise + _SHARED * noise)
    tolerated = np.square(_NEARBY * luminance) + smoothed(filled, _WIDTH) + spread + TINY
    around = np.square(mean) / tolerated
    largest = np.maximum(grey_opening(alone.sum(axis=0), (2, 2)), around.sum(axis=0))
    return maximum_filter(largest, _RIM).astype(np.float32)


def _on_pixels(deviation: FloatArray, motion: Motion, mosaic: Mosaic, rows: slice) -> FloatArray:
    """The largest deviation of the four blocks around each pixel in some rows of the reference,
    (rows, W).
    """
    sites = Sites.in_frame(mosaic)
    worst = maximum_filter(np.pad(deviation, 1, mode="edge"), 2)[1:, 1:]
    places = in_frame(motion, *_pixels(rows, mosaic), mosaic.shape)
    middle, half = np.array(sites.middle, np.float32)[:, None, None], np.float32(0.5)
    at = (places - middle) / sites.grid.period + half
    return map_coordinates(worst, at, order=0, mode="nearest")


def block_colours(frame: View, mosaic: Mosaic) -> BlockColours:
    """Readings of the whole blocks of a frame, which is in units of the reference; float64.

    Parameters
    ----------
    mosaic : Mosaic
        The reference.

    Returns
    -------
    BlockColours
        Channels times gamma, (C, rows, columns); luminance, and its variance around them without
        noise, (rows, columns) each; variance of the noise of the channels, that of luminance
        included, (C, rows, columns); and whether they are lit beyond noise, and neither they nor
        luminance around them are clipped, (rows, columns).
    """
    gamma, sites = np.array(mosaic.calibration.gamma), Sites.in_frame(mosaic)
    seen = sites.of(frame.luminance).mean(axis=2, dtype=np.float64)
    near = smoothed(frame.luminance, NEIGHBOURHOOD)
    rough = smoothed(np.square(frame.luminance - near), NEIGHBOURHOOD) - frame.variance(near)
    contrast = np.maximum(sites.of(rough).mean(axis=2, dtype=np.float64), 0)
    # in the dark ratios are noise
    luminance = np.maximum(seen, max(DEVIATIONS * frame.noise.sigma(0), TINY))
    values = sites.means(frame.colours.astype(np.float64))
    channels = gamma * values
    gains = sites.means(np.broadcast_to(frame.colour_gains, frame.colours.shape))
    variance = frame.noise.variance(values, np.arange(len(gamma)), gains)
    own = variance * gamma**2 / np.maximum(sites.pattern.site_counts, 1)
    filled = np.square(channels / luminance[..., None]) / len(sites.channels)
    noise = own + filled * frame.variance(luminance)[..., None]
    clipped = maximum_filter(frame.luminance, _AROUND) >= CLIPPED * frame.limit
    whole = frame.colours < CLIPPED * frame.limit * np.asarray(frame.colour_gains)
    known: BoolArray = whole.all(axis=2) & ~sites.of(clipped).any(axis=2) & (seen == luminance)
    return np.moveaxis(channels, 2, 0), luminance, contrast, np.moveaxis(noise, 2, 0), known
