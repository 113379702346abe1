"""How far channels are displaced at the edges of shots: Gauss-Newton steps with robust weights.

Around an edge every channel is about a linear function of luminance. A displaced channel therefore matches shifted luminance best.
Luminance itself is a sum of displaced channels, each with the share that it has there: what is measured are differences.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from shared.arrays import DoubleArray, IndexArray

from .edges import DisplacedLuminance, Edges

FARTHEST = 5.0  # pixels: largest displacement in the corners that is looked for
RINGS = 8  # of the frame
_TRIED = 0.5  # pixels between displacements that are tried first
_TRIED_WINDOWS = 150  # of a shot
LIKELY = np.array([1.5, 1.5, 0.3, 0.3, 0.3])  # pixels: standard deviations of the terms of a displacement before it is measured
TERMS = len(LIKELY)  # linear and cubic along the radius, shift down and right, turn
_ROUNDS, _STILL, _STEP = 30, 5e-3, 1.0  # Gauss-Newton steps; pixels: smaller ones are none, larger ones are cut
_FILLED = 0.36  # standard deviation of filled luminance over its curvature
_COLOURED = 0.3  # pixels of its slope: colours differ beside edges
_COARSE = 0.003  # share of a sample that is not known better
_FREE = 0.5  # relative: how far a channel's slope over luminance may differ from its mean ratio
_TUKEY = 4.685  # standard deviations: 95 % efficiency
_PRIOR_SAMPLES = 10  # weight of the prior in each window's residual scale, in samples
_EDGES = 0.7  # quantile of the samples above which edges decide how large residuals are
_ALIKE = 0.12  # pixels: by which all edges in a row or column of windows may be off in common
_MEDIAN = 0.455  # of the square of a standard normal variable


class StepSums(NamedTuple):
    """Sums of a Gauss-Newton step over each of G groups of windows; Q unknowns.

    gradient: (G, Q).
    weight: (G, Q, Q).
    """

    gradient: DoubleArray
    weight: DoubleArray

    def grouped(self, group: IndexArray, number: int = 0) -> "StepSums":
        """Return the sums over larger groups; group: (G,), that each belongs to, number: of larger groups, at least."""
        number = max(number, int(group.max()) + 1)
        sums = StepSums(*(np.zeros((number, *each.shape[1:])) for each in self))
        for total, each in zip(sums, self, strict=True):
            np.add.at(total, group, each)
        return sums

    @property
    def whole(self) -> "StepSums":
        """The sum over all groups, gradient (Q,) and weight (Q, Q)."""
        return StepSums(*(each.sum(axis=0) for each in self))


class ShotStep(NamedTuple):
    """One Gauss-Newton step in a shot.

    lines: of each row of windows, and of each column.
    rings: of a displacement of the C - 1 other channels along the radius, in each ring.
    shares: (N, C), of the channels in luminance, by their slopes over it.
    """

    lines: tuple[StepSums, StepSums]
    rings: StepSums
    shares: DoubleArray


def fitted(shots: Sequence[Edges], others: Sequence[int], reference: int) -> tuple[DoubleArray, list[ShotStep]]:
    """Return the terms of the displacement of each channel, (C, terms), pixels, and the last step in each shot."""
    terms = np.zeros((len(shots[0].channels), TERMS))
    start = _start(shots)
    terms[:, :2] = (start - start[reference])[:, None] / 2
    shares = [_shares(shot.of_channels(shot.sample) / shot.of_channels(np.ones_like(shot.sample)), shot) for shot in shots]
    for _ in range(_ROUNDS):
        seen = [_step(shot, terms, each, others) for shot, each in zip(shots, shares, strict=True)]
        shares = [each.shares for each in seen]
        likely = np.tile(LIKELY**-2, len(others))
        weight = sum(each.lines[0].whole.weight for each in seen) + np.diag(likely)
        gradient = sum(each.lines[0].whole.gradient for each in seen) - likely * terms[others].ravel()
        step = np.linalg.solve(weight, gradient)
        if np.abs(step).max() < _STILL:
            break
        terms[others] += (step * min(1.0, _STEP / np.abs(step).max())).reshape(-1, TERMS)
    return terms, seen


def _shares(slope: DoubleArray, shot: Edges) -> DoubleArray:
    """Return the shares of the channels in luminance, (N, C); slope: (N, C), how much each changes with it, up to a factor."""
    parts = np.maximum(slope * shot.gamma, 1e-9)
    return parts / parts.sum(axis=1, keepdims=True)


def _start(shots: Sequence[Edges]) -> DoubleArray:
    """Return about how far each channel is displaced from luminance in the corners, (C,), pixels; half of it cubic."""
    tried = np.arange(-FARTHEST, FARTHEST + _TRIED / 2, _TRIED)
    cost = np.zeros((len(tried), len(shots[0].channels)))
    for shot in shots:
        some = shot.chosen(np.unique(np.linspace(0, len(shot.sample) - 1, _TRIED_WINDOWS).astype(int)))
        shape = (1 + some.down**2 + some.right**2) / 2
        for number, each in enumerate(tried):
            light = some.displaced(each * shape * some.down, each * shape * some.right)
            known, filled = _variances(some, light)
            variance = known + _FILLED**2 * filled
            residual, _ = _Local.around(some, light.value, 1 / variance).residual()
            cost[number] += some.of_channels(np.log1p(residual**2 / variance)).sum(axis=0)
    return tried[cost.argmin(axis=0)]


def _variances(shot: Edges, light: DisplacedLuminance) -> tuple[DoubleArray, DoubleArray]:
    """Return the variance of samples about what luminance predicts, (N, S): what is known, and what filling adds, to a factor."""
    square = _ratio(shot, light.value)[:, shot.channel] ** 2
    floor = (_COARSE * np.abs(shot.sample).mean(axis=1, keepdims=True)) ** 2
    filled = light.fill_variance + _COLOURED**2 * (np.square(light.down) + np.square(light.right))
    return shot.variance + floor + square * shot.noise + np.finfo(np.float32).tiny, square * filled


def _ratio(shot: Edges, luminance: DoubleArray) -> DoubleArray:
    """Return each channel over luminance in each window, (N, C), positive."""
    of_light = shot.of_channels(luminance)
    return np.clip(shot.of_channels(shot.sample) / np.where(of_light > 0, of_light, np.inf), 1e-3, 1e3)


@dataclass(frozen=True, eq=False)
class _Local:
    """The linear function of luminance that each channel is in each window.

    weight: (N, S), of the samples; total: (N, C), its sums.
    value: (N, S), luminance, without its weighted means.
    strength: (N, C), how well a slope is known.
    """

    shot: Edges
    luminance: DoubleArray
    weight: DoubleArray
    total: DoubleArray
    value: DoubleArray
    strength: DoubleArray

    @staticmethod
    def around(shot: Edges, luminance: DoubleArray, weight: DoubleArray) -> "_Local":
        total = shot.of_channels(weight)
        value = luminance - (shot.of_channels(weight * luminance) / total)[:, shot.channel]
        strength = shot.of_channels(weight * value**2) + (_FREE * _ratio(shot, luminance)) ** -2
        return _Local(shot, luminance, weight, total, value, strength)

    def left(self, values: DoubleArray) -> tuple[DoubleArray, DoubleArray]:
        """Return what is left of values without linear functions of luminance, (N, S), and their slopes, (N, C)."""
        channel = self.shot.channel
        values = values - (self.shot.of_channels(self.weight * values) / self.total)[:, channel]
        slope = self.shot.of_channels(self.weight * values * self.value) / self.strength
        return values - slope[:, channel] * self.value, slope

    def residual(self) -> tuple[DoubleArray, DoubleArray]:
        """Return the residuals of the samples, (N, S), and the slope of each channel over luminance, (N, C)."""
        ratio = _ratio(self.shot, self.luminance)
        residual, slope = self.left(self.shot.sample - ratio[:, self.shot.channel] * self.luminance)
        return residual, ratio + slope


def _step(shot: Edges, terms: DoubleArray, shares: DoubleArray, others: Sequence[int]) -> ShotStep:
    """Return a Gauss-Newton step of a shot with channels displaced by `terms`.

    shares: (N, C), of the channels in luminance.
    """
    square = shot.down**2 + shot.right**2
    none, one = np.zeros_like(square), np.ones_like(square)
    down = np.stack([shot.down, square * shot.down, one, none, -shot.right])
    right = np.stack([shot.right, square * shot.right, none, one, shot.down])
    relative = np.eye(len(shares[0]))[shot.channel] - shares[:, None, :]  # (N, S, C)
    away = [np.einsum("nst,tns->ns", relative @ terms, each) for each in (down, right)]
    light = shot.displaced(*away)
    # Luminance is blurred, by channels that are displaced apart. To the next order, this undoes it.
    blurred = np.zeros_like(square)
    for number, share in enumerate(shares.T):
        difference = terms[number] - shares @ terms  # (N, terms)
        moved = [one + np.einsum("nt,tns->ns", difference, each) for one, each in zip(away, (down, right), strict=True)]
        blurred += share[:, None] * shot.luminance(*moved)
    light = light._replace(value=2 * light.value - blurred)
    local, slope = _robust(shot, light)
    residual, _ = local.residual()
    along = slope[:, shot.channel]
    near, wide = along * np.stack([light.down, light.right]), along * shot.wide_slopes(*away)

    def sums(down: DoubleArray, right: DoubleArray) -> StepSums:
        """Return the sums of each window, for displacements of the channels in these directions."""
        changes, instruments = (
            [local.left(relative[..., each] * move)[0] for each in others for move in slopes[0] * down + slopes[1] * right]
            for slopes in (near, wide)
        )
        return _sums(changes, instruments, local.weight, residual)

    windows = sums(down, right)
    radius = np.maximum(np.sqrt(square), 1e-9)
    in_rings = sums((shot.down / radius)[None], (shot.right / radius)[None])
    ring = np.minimum((radius.mean(axis=1) * RINGS).astype(int), RINGS - 1)
    return ShotStep(
        (windows.grouped(shot.line[0]), windows.grouped(shot.line[1])), in_rings.grouped(ring, RINGS), _shares(slope, shot)
    )


def _robust(shot: Edges, light: DisplacedLuminance) -> tuple[_Local, DoubleArray]:
    """Return the windows' linear functions with weights that outliers do not have, and the slopes, (N, C)."""
    known, filled = _variances(shot, light)
    edges = filled / known >= np.quantile(filled / known, _EDGES)
    variance, kept = known + _FILLED**2 * filled, np.ones_like(known)
    local = _Local.around(shot, light.value, 1 / variance)
    freedom = len(shot.channel) - 2 * len(shot.channels)
    for _ in range(2):
        residual, slope = local.residual()
        share = _FILLED**2
        for _ in range(3):
            share *= float(np.median((residual**2 / (known + share * filled))[edges])) / _MEDIAN * len(shot.channel) / freedom
            share = float(np.clip(share, 1e-4, 1))
        variance = known + share * filled
        own = (np.minimum(residual**2 / variance, 25).sum(axis=1, keepdims=True) + _PRIOR_SAMPLES) / (freedom + _PRIOR_SAMPLES)
        variance *= own
        kept = np.maximum(1 - residual**2 / variance / _TUKEY**2, 1e-5) ** 2
        local = _Local.around(shot, light.value, kept / variance)
    return local, slope


def _sums(
    changes: Sequence[DoubleArray], instruments: Sequence[DoubleArray], weight: DoubleArray, residual: DoubleArray
) -> StepSums:
    """Return the sums of each window.

    changes: Q times (N, S), of samples with the unknowns; instruments: likewise, hardly correlated with errors of luminance.
    """
    weighted = np.stack(instruments, axis=2) * weight[..., None]
    return StepSums(np.einsum("nsq,ns->nq", weighted, residual), weighted.transpose(0, 2, 1) @ np.stack(changes, axis=2))


def jackknife(seen: Sequence[ShotStep], weight: DoubleArray) -> DoubleArray:
    """Return the covariance of the unknowns, (Q, Q), from how they change without one row or column of windows.

    An edge has the same error all along: that of its place in the pattern. Few lines do not show it.
    """
    spread = np.zeros_like(weight)
    for axis in (0, 1):
        lines = [each.lines[axis] for each in seen]
        number = max(len(each.gradient) for each in lines)
        gradient, known = np.zeros((number, len(weight))), np.zeros((number, *weight.shape))
        for each in lines:
            gradient[: len(each.gradient)] += each.gradient
            known[: len(each.weight)] += each.weight
        whole = gradient.sum(axis=0)
        changes = np.linalg.solve(weight - known, (whole - gradient)[..., None])[..., 0] - np.linalg.solve(weight, whole)
        shifted = np.concatenate([np.linalg.solve(weight, each.weight[:, :, 2 + axis :: TERMS]) for each in lines])
        spread += (number - 1) / number * changes.T @ changes + _ALIKE**2 * np.einsum("lqc,lrc->qr", shifted, shifted)
    return spread
