"""Noise, from pairs of flat frames."""

from functools import partial

import numpy as np

from tools.batch.html import figure

from ..dark_frames import DarkResult
from ..noise import SIGMAS, NoiseResult, noise_of_flats
from ..part import Evidence, Part, axes, plane_colour, rounded, table
from .gamma import black_error

_GOOD_READ = 0.05  # half width over read noise
_GOOD_NOISE = 0.1  # half width over variance at full scale
_MOST_POINTS = 150  # per plane, in the plot: more only make the file larger


def noise(evidence: Evidence) -> Part | None:
    """The noise of each plane."""
    seen = evidence.seen
    if not seen.flats:
        line = "noise was not measured; take pairs of flat frames (`flat`), and dark frames (`dark`)"
        return Part("noise", warnings=[line]) if seen.shots and "noise" not in evidence.known else None
    found = noise_of_flats(seen.flats, evidence.calibration, seen.dark, black_error(evidence))
    # In scene units noise is as uncertain as their size, which is that of gamma.
    full_scale, error = evidence.calibration.full_scale, 0.0
    if evidence.gamma is not None:
        full_scale, error = float(evidence.gamma.gamma.sum()), float(evidence.gamma.covariance.sum()) ** 0.5
    shot_error = [np.hypot(full_scale * line.shot_error, error * line.shot) for line in found.lines]
    read_error = [np.hypot(full_scale * line.read_error, error * line.read) for line in found.lines]
    return Part(
        "noise",
        {"from": found.source, "shot_error": rounded(np.array(shot_error)), "read_error": rounded(np.array(read_error))},
        {"noise": found.model(full_scale)},
        _warnings(found, seen.dark),
        sections=partial(_sections, found, evidence.planes),
    )


def _sections(noise: NoiseResult, planes: str) -> dict[str, str]:
    """Plot variance and mean, and list gain and read noise per plane."""
    if not (plot := _plot(noise, planes)):
        return {}
    rows = [
        (
            letter,
            f"{line.shot:.3g} ± {SIGMAS * line.shot_error:.1g}",
            f"{1 / line.shot if line.shot > 0 else float('inf'):,.0f}",
            f"{line.read:.3g} ± {SIGMAS * line.read_error:.1g}",
            f"{line.read / line.shot:.2f}" if line.shot > 0 else "",
        )
        for letter, line in zip(planes, noise.lines, strict=True)
    ]
    head = ("plane", "variance / mean", "electrons at full scale", "read noise, part of full scale", "read noise, electrons")
    caption = f"From {noise.source}; one line per filter colour, without the effect of rounding to codes."
    return {"Noise (photon transfer)": f'<div class="pair">{figure(plot, caption)}<div>{table(head, rows)}</div></div>'}


def _warnings(noise: NoiseResult, dark: DarkResult | None) -> list[str]:
    """Warn of an uncertain gain, and of an uncertain read noise: in all but the darkest frames shot noise hides it."""
    warnings = []
    if not noise.uncertainty <= _GOOD_NOISE:
        warnings.append(
            f"the noise at full scale is only known to ±{100 * noise.uncertainty:.0f} % (95 %); "
            "take more pairs of flat frames (`flat`)"
        )
    part = max(line.read_error / max(line.read, 1e-12) for line in noise.lines)
    if part > _GOOD_READ / SIGMAS:
        known = f"only known to ±{100 * SIGMAS * part:.0f} % (95 %)" if SIGMAS * part < 1 else "unknown"
        if dark is not None and dark.shows_read:
            warnings.append(f"read noise is {known}; take more dark frames (`dark`)")
        else:
            instead = "; take dark frames (`dark`)" if dark is None else " either"
            warnings.append(f"read noise is {known}, because {noise.source} hardly show it{instead}")
    return warnings


def _plot(noise: NoiseResult, planes: str) -> str:
    """Return a plot of variance and mean with a line per plane, "" if there are no points."""
    mean, variance = noise.points.mean, noise.points.variance
    good = (mean > 0) & (variance > 0) & (noise.points.count > 1)
    if not good.any():
        return ""
    span = (float(mean[good].min()) / 1.5, float(mean[good].max()) * 1.5)
    tall = (float(variance[good].min()) / 2, float(variance[good].max()) * 2)
    plot = axes(span, tall, "mean, part of full scale", "variance", log=True)
    steps = np.geomspace(*span, 40)
    for plane, (letter, line) in enumerate(zip(planes, noise.lines, strict=True)):
        style = f"fill:{plane_colour(letter)};fill-opacity:.6"
        for index in np.flatnonzero(good[:, plane])[:: max(1, int(good[:, plane].sum()) // _MOST_POINTS)]:
            text = f"{letter}: mean {mean[index, plane]:.4f}, variance {variance[index, plane]:.3g}"
            plot.dot(mean[index, plane], variance[index, plane], 2.5, text, style)
        plot.line([(x, float(y)) for x, y in zip(steps, line.variance(steps), strict=True) if y > tall[0]], f"plane plane-{letter}")
    return plot.drawn("Photon transfer")
