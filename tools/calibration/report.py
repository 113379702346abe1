"""The calibration report: one HTML page for sign-off, with the verdict first, then the measurements
and how well they fit.
"""

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...shared.arrays import DoubleArray
from ...shared.colorimetry import SRGB_TO_XYZ
from ..io.colour import encode_srgb, lab_to_xyz, xyz_to_lab
from ..io.page import embed_picture, embed_plot, render_page
from .chart.place import NAMES
from .colour_matrix import ColourFit
from .conclude import Result
from .photon_transfer import SIGMAS, NoiseResult
from .places import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TONES = {"use it": "good", "use it with care": "care", "do not use it": "bad"}
# "": of what has no colour of its own
_PLANES = {"R": "#e5484d", "G": "#30a46c", "B": "#3e63dd", "W": "#8d8d86", "": "#b658c4"}


def build_report(result: Result) -> bytes:
    """Return the content of the page's file, with the result of a calibration."""
    camera, measured = result.camera, result.measured
    told = () if result.refusal else result.contradictions  # a refusal names them already
    fits = {name: one.result for name, one in result.findings.items() if one.result is not None}
    plots = {"gamma": partial(_plot_residuals, result)}
    if "noise" in fits:
        plots["noise"] = partial(_plot_transfer, fits["noise"], measured.planes)
    return render_page(
        Path(__file__).with_name("report.html"),
        title=f"Calibration of {(camera and camera.calibration.sensor) or 'the camera'}",
        result=result,
        tone=_TONES[result.verdict],
        warnings=[*told, *result.warnings],
        measured=measured,
        shots=[(shot, embed_picture(shot.picture, photograph=True)) for shot in measured.shots],
        gamma=fits.get("gamma"),
        noise=fits.get("noise"),
        plots={name: embed_plot(plot) for name, plot in plots.items() if name in fits},
        colours=[(chart, _patches(chart.fit)) for chart in fits.get("colour", ())],
        document=json.dumps(camera.to_json(), indent=1, ensure_ascii=False) if camera else "",
        figures=figures,
        sigmas=SIGMAS,
        zip=zip,
    )


def _plot_residuals(result: Result, axes: "Axes") -> None:
    """Plot how far the luminance of every patch is off that of Eq. 7, in per cent; those that were
    left out are crosses.
    """
    colours = np.array(_css_colours(xyz_to_lab(result.measured.chart_colours)))
    for shot in result.measured.shots:
        fit, level = shot.fit, shot.places.mean[:, -1]
        percent = 100 * (fit.predicted / np.maximum(level, 1e-9) - 1)
        for here, marker in ((fit.used, "o"), (~fit.used, "X")):
            x, y, fill = level[here], percent[here], colours[here]
            axes.scatter(x, y, s=38, c=fill, marker=marker, edgecolors="#1f1f1c", linewidths=0.6)
    axes.axhline(0, color="#6b6b64", linestyle="--", linewidth=1)
    axes.set(xlabel="measured, part of full scale", ylabel="predicted - measured, %")


def _plot_transfer(noise: NoiseResult, planes: str, axes: "Axes") -> None:
    """Plot variance over mean, with a line per plane."""
    for plane, (letter, line) in enumerate(zip(planes, noise.lines, strict=True)):
        colour, mean = _PLANES.get(letter, _PLANES[""]), noise.points.mean[:, plane]
        axes.scatter(mean, noise.points.variance[:, plane], s=12, c=colour, alpha=0.6)
        steps = np.geomspace(max(mean.min(), 1e-5) / 1.5, max(mean.max(), 1e-4) * 1.5, 40)
        axes.plot(steps, line.variance(steps), color=colour, label=letter)
    axes.set(xlabel="mean, part of full scale", ylabel="variance", xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")  # a narrow range would show formulas as they are written
    axes.legend()


def _patches(fit: ColourFit) -> list[tuple[str, float, tuple[str, ...]]]:
    """Return of each patch its name, its dE2000, and its colours: measured, reference."""
    stripes = zip(_css_colours(fit.lab), _css_colours(xyz_to_lab(fit.colours)), strict=True)
    return list(zip(NAMES, fit.difference.tolist(), stripes, strict=True))


def _css_colours(lab: DoubleArray) -> list[str]:
    """Return CSS colours for L*a*b* (N, 3): sRGB, clipped."""
    linear = np.linalg.solve(np.array(SRGB_TO_XYZ), lab_to_xyz(lab).T).T
    encoded = encode_srgb(linear.astype(np.float32))
    return ["#" + "".join(f"{round(255 * value):02x}" for value in row) for row in encoded.tolist()]
