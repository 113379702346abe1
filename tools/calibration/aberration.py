"""Lateral chromatic aberration from edges: how far each channel is displaced along the radius of the frame.

Around an edge every channel is about a linear function of luminance. So a channel that is displaced matches luminance best some way
off. Luminance itself is a sum of displaced channels, each with the share that it has there: what is measured are differences, and
one channel is where the others relate to. All windows and shots are fitted together, by Gauss-Newton steps with robust weights.

A lens displaces along the radius, symmetrically. What is fitted beside it, a shift and a turn, shows whether it was one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from shared import Aberration
from shared.arrays import DoubleArray, IndexArray
from shared.errors import InputError

from .edges import Edges, Looked
from .shading import common_focal_length

_RADII = (0.5, 0.75, 1.0)  # shares of half the diagonal, where a displacement may be seen
_LEAST, _ERRORS = 0.05, 4.0  # pixels, standard errors: less is none
_WORST = 0.15  # pixels: standard error in the corners
_FAR, _FAR_SHARE = 0.6, 0.05  # radius beyond which edges have to be, and the share of what is known that has to come from there
_ASKEW = 0.3  # pixels: shift, or turn in the corners, beyond its error
_APART = 0.3  # pixels: of a shot in the corners, beyond its error
_MOST, _MOST_SHARE = 5.0, 0.05  # displacement in the corners: pixels, and share of half the diagonal
_TRIED = 0.5  # pixels between displacements that are tried first
_TRIED_WINDOWS = 400  # of a shot
_LIKELY = np.array([3.0, 3.0, 0.3, 0.3, 0.3])  # pixels: standard deviations of the terms of a displacement before it is measured
_TERMS = len(_LIKELY)  # linear and cubic along the radius, shift down and right, turn
_ROUNDS, _STILL, _STEP = 40, 2e-3, 1.0  # Gauss-Newton steps; pixels: smaller ones are none, larger ones are cut
_FILLED = 0.36  # standard deviation of filled luminance over its curvature
_COLOURED = 0.3  # pixels of its slope: colours differ beside edges
_COARSE = 0.003  # share of a sample that is not known better
_FREE = 0.5  # relative: how far a channel's slope over luminance may differ from its mean ratio
_TUKEY = 4.685  # standard deviations: 95 % efficiency
_SHY = 10  # samples: a window's own residual counts like one of so many more that fit
_EDGES = 0.7  # quantile of the samples above which edges decide how large residuals are
_MEDIAN = 0.455  # of the square of a standard normal variable
_RINGS, _RING_ERROR = 8, 0.5  # rings; pixels: those that are known worse are not shown
_DIGITS = 6


@dataclass(frozen=True, eq=False)
class AberrationResult:
    """What edges show of lateral chromatic aberration.

    aberration: None = there is none to speak of.
    channels: letters of the channels.
    shots: number of shots.
    corner: (C,), displacement in the corners, pixels.
    error: (C,), its standard error, pixels.
    curve: (C, 2), displacement in pixels: linear and cubic term of the radius, 1 in the corners.
    rings: (R, C, 3), radius, displacement and its standard error of each channel in rings of the frame; NaN where edges are few.
    """

    aberration: Aberration | None
    channels: str
    shots: int
    corner: DoubleArray
    error: DoubleArray
    curve: DoubleArray
    rings: DoubleArray

    @property
    def words(self) -> str:
        """The aberration, for people."""
        known = f"±{self.error.max():.2g} pixels (standard error)"
        if self.aberration is None:
            return f"no lateral chromatic aberration: known to {known} in the corners"
        shown = ", ".join(f"{letter} {value:+.2f}" for letter, value in zip(self.channels, self.corner, strict=True) if value)
        return f"lateral chromatic aberration: {shown} pixels in the corners, known to {known}"


class _Seen(NamedTuple):
    """One Gauss-Newton step in a shot; Q unknowns, L rows or columns of windows.

    gradient: (L, Q); weight: (L, Q, Q); both of rows, then of columns.
    ring_gradient, ring_weight: likewise of a displacement along the radius in each ring, (R, C - 1), (R, C - 1, C - 1).
    shares: (N, C), of the channels in luminance, by their slopes over it.
    """

    gradient: tuple[DoubleArray, DoubleArray]
    weight: tuple[DoubleArray, DoubleArray]
    ring_gradient: DoubleArray
    ring_weight: DoubleArray
    shares: DoubleArray


def measure_aberration(shots: Sequence[Edges]) -> AberrationResult:
    """Measure the lateral chromatic aberration that edges show. Raises InputError with the reason if they do not tell it."""
    focal = common_focal_length((shot.focal_length for shot in shots), "shots with edges")
    shape, channels, gamma = shots[0].shape, shots[0].channels, shots[0].gamma
    for shot in shots:
        if shot.shape != shape:
            (high, wide), (rows, columns) = shot.shape, shape
            raise InputError(f"{shot.name} has {wide} x {high} pixels, {shots[0].name} {columns} x {rows}: take all alike")
    reference = channels.find("G") if "G" in channels else int(gamma.argmax())
    others = [each for each in range(len(channels)) if each != reference]
    terms, seen = _fitted(shots, others, reference)
    likely = np.diag(np.tile(_LIKELY**-2, len(others)))
    weight = sum(each.weight[0].sum(axis=0) for each in seen) + likely
    spread = _jackknife(seen, weight)
    half = float(np.hypot(shape[0] - 1, shape[1] - 1)) / 2
    _check(shots, seen, terms[others], spread, likely, half)
    curve, error = terms[:, :2], np.zeros(len(channels))
    clear = False
    for place, each in enumerate(others):
        block = spread[place * _TERMS :, place * _TERMS :][:2, :2]
        for radius in _RADII:
            powers = np.array([radius, radius**3])
            error[each] = float(powers @ block @ powers) ** 0.5  # the last one is that of the corners
            clear |= abs(powers @ curve[each]) >= max(_LEAST, _ERRORS * error[each])
    radial = [[float(f"{value / half:.{_DIGITS}g}") for value in pair] for pair in curve.tolist()]
    aberration = Aberration(radial, shape, focal) if clear else None  # type: ignore[arg-type]
    return AberrationResult(aberration, channels, len(shots), curve.sum(axis=1), error, curve, _rings(seen, curve, others))


def _fitted(shots: Sequence[Edges], others: Sequence[int], reference: int) -> tuple[DoubleArray, list[_Seen]]:
    """Return the terms of the displacement of each channel, (C, terms), pixels, and what the last step saw in each shot."""
    terms = np.zeros((len(shots[0].channels), _TERMS))
    start = _started(shots)
    terms[:, :2] = (start - start[reference])[:, None] / 2
    shares = [_mixed(shot.of_channels(shot.sample) / shot.of_channels(np.ones_like(shot.sample)), shot) for shot in shots]
    for _ in range(_ROUNDS):
        seen = [_looked(shot, terms, each, others) for shot, each in zip(shots, shares, strict=True)]
        shares = [each.shares for each in seen]
        likely = np.tile(_LIKELY**-2, len(others))
        weight = sum(each.weight[0].sum(axis=0) for each in seen) + np.diag(likely)
        gradient = sum(each.gradient[0].sum(axis=0) for each in seen) - likely * terms[others].ravel()
        step = np.linalg.solve(weight, gradient)
        if np.abs(step).max() < _STILL:
            break
        terms[others] += (step * min(1.0, _STEP / np.abs(step).max())).reshape(-1, _TERMS)
    return terms, seen


def _mixed(slope: DoubleArray, shot: Edges) -> DoubleArray:
    """Return the shares of the channels in luminance, (N, C); slope: (N, C), how much each changes with it, up to a factor."""
    parts = np.maximum(slope * shot.gamma, 1e-9)
    shares: DoubleArray = parts / parts.sum(axis=1, keepdims=True)
    return shares


def _started(shots: Sequence[Edges]) -> DoubleArray:
    """Return about how far each channel is displaced from luminance in the corners, (C,), pixels; half of it cubic."""
    tried = np.arange(-_MOST, _MOST + _TRIED / 2, _TRIED)
    cost = np.zeros((len(tried), len(shots[0].channels)))
    for shot in shots:
        some = shot.chosen(np.unique(np.linspace(0, len(shot.sample) - 1, _TRIED_WINDOWS).astype(int)))
        shape = (1 + some.down**2 + some.right**2) / 2
        for number, each in enumerate(tried):
            light = some.looked(each * shape * some.down, each * shape * some.right)
            known, filled = _variances(some, light)
            variance = known + _FILLED**2 * filled
            residual, _ = _Local.around(some, light.value, 1 / variance).residual()
            cost[number] += some.of_channels(np.log1p(residual**2 / variance)).sum(axis=0)
    best: DoubleArray = tried[cost.argmin(axis=0)]
    return best


def _variances(shot: Edges, light: Looked) -> tuple[DoubleArray, DoubleArray]:
    """Return the variance of samples about what luminance predicts, (N, S): what is known, and what filling adds, to a factor."""
    square = _ratio(shot, light.value)[:, shot.channel] ** 2
    floor = (_COARSE * np.abs(shot.sample).mean(axis=1, keepdims=True)) ** 2
    filled = light.unsure + _COLOURED**2 * (light.down**2 + light.right**2)
    return shot.variance + floor + square * shot.noise + np.finfo(np.float32).tiny, square * filled


def _ratio(shot: Edges, luminance: DoubleArray) -> DoubleArray:
    """Return each channel over luminance in each window, (N, C), positive."""
    of_light = shot.of_channels(luminance)
    ratio: DoubleArray = np.clip(shot.of_channels(shot.sample) / np.where(of_light > 0, of_light, np.inf), 1e-3, 1e3)
    return ratio


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


def _looked(shot: Edges, terms: DoubleArray, shares: DoubleArray, others: Sequence[int]) -> _Seen:
    """Look at a shot with channels displaced by `terms`.

    shares: (N, C), of the channels in luminance.
    """
    square = shot.down**2 + shot.right**2
    none, one = np.zeros_like(square), np.ones_like(square)
    down = np.stack([shot.down, square * shot.down, one, none, -shot.right])
    right = np.stack([shot.right, square * shot.right, none, one, shot.down])
    relative = np.eye(len(shares[0]))[shot.channel] - shares[:, None, :]  # (N, S, C)
    away = [np.einsum("nst,tns->ns", relative @ terms, each) for each in (down, right)]
    light = shot.looked(*away)
    # Luminance is blurred, by channels that are displaced apart. To the next order, this undoes it.
    blurred = np.zeros_like(square)
    for number, share in enumerate(shares.T):
        apart = terms[number] - shares @ terms  # (N, terms)
        moved = [one + np.einsum("nt,tns->ns", apart, each) for one, each in zip(away, (down, right), strict=True)]
        blurred += share[:, None] * shot.luminance(*moved)
    light = light._replace(value=2 * light.value - blurred)
    local, slope = _robust(shot, light)
    residual, _ = local.residual()
    along = slope[:, shot.channel]

    def seen(down: DoubleArray, right: DoubleArray, slopes: tuple[DoubleArray, DoubleArray]) -> list[DoubleArray]:
        changes = along * (slopes[0] * down + slopes[1] * right)
        return [local.left(relative[..., each] * changes)[0] for each in others]

    def sums(directions):
        near, wide = (
            [seen(*each, slopes) for each in directions]
            for slopes in ((light.down, light.right), (light.wide_down, light.wide_right))
        )
        return _sums(
            *([term[place] for place in range(len(others)) for term in each] for each in (near, wide)), local.weight, residual
        )

    gradient, weight = sums(list(zip(down, right, strict=True)))
    radius = np.maximum(np.sqrt(square), 1e-9)
    in_rings = sums([(shot.down / radius, shot.right / radius)])
    ring = np.minimum((radius.mean(axis=1) * _RINGS).astype(int), _RINGS - 1)
    return _Seen(
        (_grouped(gradient, shot.line[0]), _grouped(gradient, shot.line[1])),
        (_grouped(weight, shot.line[0]), _grouped(weight, shot.line[1])),
        _grouped(in_rings[0], ring, _RINGS),
        _grouped(in_rings[1], ring, _RINGS),
        _mixed(slope, shot),
    )


def _robust(shot: Edges, light: Looked) -> tuple[_Local, DoubleArray]:
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
        own = (np.minimum(residual**2 / variance, 25).sum(axis=1, keepdims=True) + _SHY) / (freedom + _SHY)
        variance *= own
        kept = np.maximum(1 - residual**2 / variance / _TUKEY**2, 1e-5) ** 2
        local = _Local.around(shot, light.value, kept / variance)
    return local, slope


def _sums(
    design: Sequence[DoubleArray], instruments: Sequence[DoubleArray], weight: DoubleArray, residual: DoubleArray
) -> tuple[DoubleArray, DoubleArray]:
    """Return, of each window, the gradient (N, Q) and the weight (N, Q, Q) of Q unknowns.

    design: Q times (N, S), how samples change with the unknowns; instruments: likewise, not correlated with what is filled in.
    """
    weighted = np.stack(instruments, axis=2) * weight[..., None]
    return np.einsum("nsq,ns->nq", weighted, residual), weighted.transpose(0, 2, 1) @ np.stack(design, axis=2)


def _grouped(values: DoubleArray, group: IndexArray, number: int = 0) -> DoubleArray:
    """Return the sums of values, (N, ...), over each group; number: of groups, at least."""
    sums = np.zeros((max(number, int(group.max()) + 1), *values.shape[1:]))
    np.add.at(sums, group, values)
    return sums


def _jackknife(seen: Sequence[_Seen], weight: DoubleArray) -> DoubleArray:
    """Return the covariance of the unknowns, (Q, Q), from how they change without one row or column of windows.

    An edge has the same error all along: that of its place in the pattern.
    """
    spread = np.zeros_like(weight)
    for axis in (0, 1):
        number = max(len(each.gradient[axis]) for each in seen)
        gradient, known = np.zeros((number, len(weight))), np.zeros((number, *weight.shape))
        for each in seen:
            gradient[: len(each.gradient[axis])] += each.gradient[axis]
            known[: len(each.weight[axis])] += each.weight[axis]
        whole = gradient.sum(axis=0)
        changes = np.linalg.solve(weight - known, (whole - gradient)[..., None])[..., 0] - np.linalg.solve(weight, whole)
        spread += (number - 1) / number * changes.T @ changes
    return spread


def _rings(seen: Sequence[_Seen], curve: DoubleArray, others: Sequence[int]) -> DoubleArray:
    """Return what rings of the frame show, see `AberrationResult`."""
    rings = np.full((_RINGS, len(curve), 3), np.nan)
    for ring in range(_RINGS):
        weight = sum(each.ring_weight[ring] for each in seen)
        radius = (ring + 0.5) / _RINGS
        if np.linalg.matrix_rank(weight) < len(others):
            continue
        inverse = np.linalg.inv(weight)
        step = inverse @ sum(each.ring_gradient[ring] for each in seen)
        for place, each in enumerate(others):
            error = inverse[place, place] ** 0.5
            if error < _RING_ERROR:
                rings[ring, each] = radius, curve[each] @ [radius, radius**3] + step[place], error
    return rings


def _check(
    shots: Sequence[Edges], seen: Sequence[_Seen], terms: DoubleArray, spread: DoubleArray, likely: DoubleArray, half: float
) -> None:
    """Raise InputError if the edges do not tell the displacement, or tell one that no lens makes.

    terms: (others, terms); spread: their covariance; likely: their weight before.
    half: half the diagonal, pixels.
    """
    corner = np.kron(np.eye(len(terms)), [1.0, 1.0, 0.0, 0.0, 0.0])  # (others, Q)
    error = np.sqrt(np.diag(corner @ spread @ corner.T))
    rings = sum(np.trace(each.ring_weight, axis1=1, axis2=2) for each in seen)
    far = float(rings[int(_FAR * _RINGS) :].sum() / rings.sum())
    if far < _FAR_SHARE:
        raise InputError(
            f"shots with edges: hardly any edges are farther from the middle than {100 * _FAR:.0f} % of half the diagonal; "
            "take shots with edges in the corners"
        )
    if not error.max() <= _WORST:
        raise InputError(
            f"shots with edges: they tell the displacement in the corners only to ±{error.max():.2g} pixels (standard error), "
            f"{_WORST:g} are allowed; take more shots, with more sharp edges all over the frame, well exposed"
        )
    astray = terms[:, 2:]
    unsure = np.sqrt(np.diag(spread)).reshape(terms.shape)[:, 2:]
    if (np.abs(astray) > _ASKEW + _ERRORS * unsure).any():
        shift, turn = np.hypot(astray[:, 0], astray[:, 1]).max(), np.abs(astray[:, 2]).max()
        raise InputError(
            f"shots with edges: a colour is displaced by {shift:.2g} pixels all over the frame, and turned by {turn:.2g} pixels in "
            f"the corners, {_ASKEW:g} are allowed; a lens displaces along the radius. Is it askew, or were the shots altered?"
        )
    largest = np.abs(terms[:, :2].sum(axis=1)).max()
    if largest > (most := min(_MOST, _MOST_SHARE * half)):
        raise InputError(
            f"shots with edges: the displacement in the corners is {largest:.1f} pixels, {most:.2g} are allowed; is it a lens?"
        )
    for shot, each in zip(shots, seen, strict=True):
        weight = each.weight[0].sum(axis=0) + likely
        away = corner @ np.linalg.solve(weight, each.gradient[0].sum(axis=0) - likely @ terms.ravel())
        own = _jackknife([each], weight)
        allowed = _APART + _ERRORS * np.sqrt(np.diag(corner @ own @ corner.T))
        if len(shots) > 1 and (np.abs(away) > allowed).any():
            raise InputError(
                f"{shot.name} shows a displacement in the corners that is {np.abs(away).max():.2g} pixels off that of the other "
                "shots; take all with one lens, at one focal length and focus"
            )
