"""The plots of the report."""

import math
from collections.abc import Sequence

import numpy as np

from tools.pictures.plot import Plot, Span, round_step, ticks

from ..aberration import AberrationResult
from ..chart.place import NAMES, PATCHES
from ..gamma import GammaFit
from ..noise import NoiseResult

OTHER = "#b658c4"  # colour of what has no colour of its own
_SIZE, _MARGINS = (560, 340), (64, 14, 12, 46)
_MOST_POINTS, _MOST_PER_PLANE = 600, 150  # points of a scatter plot: more only make the file larger
_LEAST_REACH = 0.1  # pixels, of an axis of displacements
_PLANES = {"R": "#e5484d", "G": "#30a46c", "B": "#3e63dd", "W": "#8d8d86"}


def luminance_plot(fits: Sequence[tuple[str, GammaFit, bool]], colours: Sequence[str]) -> str:
    """Return a plot of measured and predicted luminance.

    fits: name of the shot, fit, and whether its places are the patches of a chart.
    colours: CSS colours of the patches.
    """
    highest = 1.08 * max(float(fit.level.max()) for _, fit, _ in fits)
    plot = _axes((0, highest), (0, highest), "measured, part of full scale", "predicted, gamma · channels")
    plot.line([(0, 0), (highest, highest)], "ideal")
    for shot, fit, chart in fits:
        shown = np.clip(fit.predicted, -0.02 * highest, 1.02 * highest)
        for index in range(0, fit.level.size, max(1, fit.level.size // _MOST_POINTS)):
            name = NAMES[index] if chart else "block"
            text = f"{shot}, {name}: measured {fit.level[index]:.4f}, predicted {fit.predicted[index]:.4f}"
            style = _patch(colours[index]) if chart else "fill:var(--soft);fill-opacity:.35"
            plot.dot(fit.level[index], shown[index], 5 if chart else 2, text, style)
    return plot.drawn("Measured and predicted luminance")


def residuals_plot(fit: GammaFit, colours: Sequence[str]) -> str:
    """Return a plot of the residual of each patch, in per cent; colours: CSS colours of the patches."""
    percent = 100 * (fit.predicted - fit.level) / np.maximum(fit.level, 1e-9)
    high = max(1.1 * float(np.abs(percent).max()), 0.1)
    plot = _axes((0.2, PATCHES + 0.8), (-high, high), "patch, in reading order", "predicted - measured, %")
    for index, value in enumerate(percent):
        dashes, note = ("", "") if fit.used[index] else (";stroke-dasharray:2", " (left out)")
        plot.bar(index + 1, float(value), 0.7, f"{NAMES[index]}: {value:+.2f} %{note}", _patch(colours[index]) + dashes)
    return plot.drawn("Residual of each patch")


def noise_plot(noise: NoiseResult, planes: str) -> str:
    """Return a plot of variance and mean with a line per plane, "" if there are no points; planes: their letters."""
    mean, variance = noise.points.mean, noise.points.variance
    good = (mean > 0) & (variance > 0) & (noise.points.count > 1)
    if not good.any():
        return ""
    span = (float(mean[good].min()) / 1.5, float(mean[good].max()) * 1.5)
    tall = (float(variance[good].min()) / 2, float(variance[good].max()) * 2)
    plot = _axes(span, tall, "mean, part of full scale", "variance", log=True)
    steps = np.geomspace(*span, 40)
    for plane, (letter, line) in enumerate(zip(planes, noise.lines, strict=True)):
        style = f"fill:{_PLANES.get(letter, OTHER)};fill-opacity:.6"
        for index in np.flatnonzero(good[:, plane])[:: max(1, int(good[:, plane].sum()) // _MOST_PER_PLANE)]:
            text = f"{letter}: mean {mean[index, plane]:.4f}, variance {variance[index, plane]:.3g}"
            plot.dot(mean[index, plane], variance[index, plane], 2.5, text, style)
        plot.line([(x, float(y)) for x, y in zip(steps, line.variance(steps), strict=True) if y > tall[0]], f"plane plane-{letter}")
    return plot.drawn("Photon transfer")


def aberration_plot(found: AberrationResult) -> str:
    """Return a plot of displacement over radius with a curve per channel."""
    radius = np.linspace(0, 1, 41)
    curves = found.curve @ np.stack([radius, radius**3])
    seen = found.rings[np.isfinite(found.rings[..., 0])]
    reach = np.concatenate([np.abs(curves).ravel(), np.abs(seen[:, 1]) + seen[:, 2], [_LEAST_REACH]])
    high = 1.1 * float(reach.max())
    plot = _axes((0, 1.02), (-high, high), "distance from the middle, corner = 1", "displacement, pixels")
    for channel, letter in enumerate(found.channels):
        plot.line(zip(radius.tolist(), curves[channel].tolist(), strict=True), f"plane plane-{letter}")
        style = f"fill:{_PLANES.get(letter, OTHER)};stroke:{_PLANES.get(letter, OTHER)}"
        for place, value, error in found.rings[:, channel][np.isfinite(found.rings[:, channel, 0])].tolist():
            low, top = max(value - error, -high), min(value + error, high)
            plot.line([(place, low), (place, top)], f"plane plane-{letter}")
            plot.dot(place, value, 3.5, f"{letter}, {place:.2f}: {value:+.2f} ± {error:.2f} pixels", style)
    return plot.drawn("Displacement over radius")


def _axes(x: Span, y: Span, across: str, up: str, *, log: bool = False) -> Plot:
    """Return an empty plot with a grid and the names of both axes."""
    plot = Plot(x, y, _SIZE, _MARGINS, log=log)
    plot.columns(_ticks(x, log=log))
    plot.rows(_ticks(y, log=log))
    plot.text((plot.left + plot.right) / 2, _SIZE[1] - 8, across)
    plot.add(f'<g transform="translate(14 {(plot.top + plot.bottom) / 2}) rotate(-90)">')
    plot.text(0, 0, up)
    plot.add("</g>")
    return plot


def _ticks(span: Span, *, log: bool) -> list[float]:
    """Return round numbers inside a span: about five, or powers of ten."""
    if not log:
        return ticks(span, round_step(span[1] - span[0], 5))
    low, high = map(math.log10, span)
    return [10.0**power for power in ticks((low, high), max(1.0, round_step(high - low, 9)))]


def _patch(colour: str) -> str:
    return f"fill:{colour};stroke:var(--ink);stroke-width:.6"
