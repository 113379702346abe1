"""The sections of the report, each as HTML; "" if there is nothing to report."""

import json
from collections.abc import Sequence
from html import escape

import numpy as np

from shared import Camera
from shared.arrays import ByteArray, DoubleArray
from shared.colorimetry import SRGB_TO_XYZ, encode_srgb, lab_to_xyz
from shared.colour_difference import delta_e_2000
from tools.pictures.html import cell, data_address, row, table

from ..chart.place import COLUMNS, NAMES, PATCHES
from ..measure import Outcome
from ..noise import SIGMAS
from ..shot import ShotMeasurement
from .plots import OTHER, aberration_plot, luminance_plot, noise_plot, residuals_plot

_WIDEST = 1200  # pixels of a picture


def charts(shots: Sequence[ShotMeasurement]) -> str:
    """Show where the chart was found and measured."""
    return "".join(
        _figure(
            _picture(shot.picture, "The shot with the measured places outlined"),
            f"{shot.name}: corners {shot.chart.place}, {shot.chart.place.pitch:.0f} pixels between patches. "
            "White: patches; magenta: their measured parts.",
        )
        for shot in shots
        if shot.chart is not None and shot.picture is not None
    )


def gamma(outcome: Outcome) -> str:
    """Show gamma with its intervals, how well it fits, and the estimates it was combined from."""
    fit = outcome.gamma
    if fit is None:
        return ""
    rows = [
        (letter, f"{value:.4f}", f"{value - half:.4f} to {value + half:.4f}", f"±{100 * half / value:.2g} %")
        for letter, value, half in zip(outcome.channels, fit.gamma, fit.half_width, strict=True)
    ]
    shots = [
        (
            shot.name,
            "chart" if shot.chart and number == 0 else "scene",
            _row(each.gamma),
            _row(each.half_width),
            f"{int(each.used.sum())} of {each.used.size}",
        )
        for shot in outcome.shots
        for number, each in enumerate(shot.fits)
    ]
    facts = (
        f"Condition number of the colours: {fit.condition:.1f}, 1 is ideal. Residuals: {fit.spread:.2f} times what noise explains. "
        f"Offset of the panchromatic samples: {fit.off:+.1f} standard errors."
    )
    head = ("shot", "measured on", "gamma", "± (95 %)", "places used")
    return _table(("channel", "gamma", "95 % interval", ""), rows) + f"<p>{escape(facts)}</p>" + _table(head, shots)


def luminance(outcome: Outcome) -> str:
    """Plot measured and predicted luminance of all shots, and the residuals of the first chart."""
    if outcome.gamma is None or not outcome.gamma.level.size:
        return ""
    fits = [(shot.name, fit, shot.chart is not None and fit is shot.fits[0]) for shot in outcome.shots for fit in shot.fits]
    colours = _css(outcome.colour.reference) if outcome.colour is not None else [OTHER] * PATCHES
    bars = next((_figure(residuals_plot(fit, colours), name) for name, fit, chart in fits if chart), "")
    return f'<div class="pair">{_figure(luminance_plot(fits, colours))}{bars}</div>'


def colour(outcome: Outcome) -> str:
    """Show the patches before and after, the colour differences, the matrix, and the light on the chart."""
    fit, before = outcome.colour, outcome.before
    if fit is None:
        return ""
    differences = {
        "before (only white balance, or the shot's own matrix)": None if before is None else delta_e_2000(before, fit.reference),
        "matrix, light treated as even": fit.plain,
        "matrix, corrected for uneven light": fit.difference,
        "the same, leave-one-out (each patch predicted from the others)": fit.left_out,
    }
    rows = [(name, f"{each.mean():.2f}", f"{each.max():.2f}") for name, each in differences.items() if each is not None]
    stripes = [_css(lab) for lab in (before, fit.lab, fit.reference) if lab is not None]
    patches = ""
    for name, difference, *colours in zip(NAMES, fit.difference, *stripes, strict=True):
        striped = "".join(f'<i style="background:{css}"></i>' for css in colours)
        patches += f'<div class="patch" title="{name}"><b>{striped}</b><span>{name}</span><span>ΔE {difference:.1f}</span></div>'
    bright = 45 + 45 * np.clip((fit.light - fit.light.min()) / max(float(np.ptp(fit.light)), 0.1), 0, 1)
    light = "".join(
        f'<div style="background:hsl(45 85% {tone:.0f}%)">{value:.2f}</div>' for value, tone in zip(fit.light, bright, strict=True)
    )
    return (
        f"<p>From {escape(outcome.colour_shot)}. Each patch shows, from left to right: "
        f"{'' if before is None else 'before, '}after, reference.</p>"
        f'<div class="patches">{patches}</div>'
        + _table(("ΔE2000", "mean", "maximum"), rows)
        + '<div class="pair"><div><h3>Matrix from scene units to XYZ (D50)</h3>'
        + _table((), [tuple(f"{value:+.4f}" for value in row) for row in fit.matrix])
        + f"<p>White reads {_row(fit.neutral)}.</p></div>"
        + f'<div><h3>Light on the chart</h3><div class="light" style="grid-template-columns:repeat({COLUMNS},1fr)">{light}</div>'
        + f"<p>Brightest over dimmest: {fit.unevenness:.2f}.</p></div></div>"
    )


def noise(outcome: Outcome) -> str:
    """Plot variance and mean, and list gain and read noise per plane."""
    found, planes = outcome.noise, outcome.channels + "W"
    if found is None or not (plot := noise_plot(found, planes)):
        return ""
    rows = [
        (
            letter,
            f"{line.shot:.3g} ± {SIGMAS * line.shot_error:.1g}",
            f"{1 / line.shot if line.shot > 0 else float('inf'):,.0f}",
            f"{line.read:.3g} ± {SIGMAS * line.read_error:.1g}",
            f"{line.read / line.shot:.2f}" if line.shot > 0 else "",
        )
        for letter, line in zip(planes, found.lines, strict=True)
    ]
    head = ("plane", "variance / mean", "electrons at full scale", "read noise, part of full scale", "read noise, electrons")
    caption = f"From {found.source}; one line per filter colour, without the effect of rounding to codes."
    return f'<div class="pair">{_figure(plot, caption)}<div>{_table(head, rows)}</div></div>'


def dark(outcome: Outcome) -> str:
    """List black level and read noise per plane."""
    found = outcome.dark
    if found is None:
        return ""
    rows = [
        (letter, f"{black:.3f} ± {SIGMAS * error:.3f}", f"{read:.3f}")
        for letter, black, error, read in zip(outcome.channels + "W", found.black, found.black_error, found.read, strict=True)
    ]
    facts = f"<p>{found.frames} frames; {len(found.defects)} pixels are not black.</p>"
    return _table(("plane", "black level, codes", "read noise, codes"), rows) + facts


def shading(outcome: Outcome) -> str:
    """List the gain of each plane in the corners, and how well it is known."""
    if outcome.shading is None:
        return ""
    words = f"<p>{escape(outcome.shading.words.capitalize())}.</p>"
    if outcome.shading.shading is None:
        return words
    corners = outcome.shading.shading.sketch[:, [0, 0, -1, -1], [0, -1, 0, -1]]
    rows = [(letter, *(f"{gain:.3f}" for gain in gains)) for letter, gains in zip(outcome.channels + "W", corners, strict=True)]
    return _table(("plane", "gain top left", "top right", "bottom left", "bottom right"), rows) + words


def aberration(outcome: Outcome) -> str:
    """Plot how far each channel is displaced over the radius, and list it for the corners."""
    found = outcome.aberration
    if found is None:
        return ""
    rows = [
        (letter, f"{corner:+.3f}", f"{error:.2g}" if error else "the others relate to it")
        for letter, corner, error in zip(found.channels, found.corner, found.error, strict=True)
    ]
    head = ("channel", "displacement in the corners, pixels", "standard error")
    words = f"<p>{escape(found.words[0].upper() + found.words[1:])}.</p>"
    caption = "How much further out each channel looks; points: rings of the frame by themselves, with standard errors."
    return f'<div class="pair">{_figure(aberration_plot(found), caption)}<div>{_table(head, rows)}{words}</div></div>'


def camera_file(camera: Camera | None) -> str:
    """Show the content of camera.json."""
    if camera is None:
        return ""
    text = json.dumps(camera.to_json(), indent=1, ensure_ascii=False)
    return f"<details><summary>Content, id {camera.calibration.id}</summary><pre>{escape(text)}</pre></details>"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return table(head, [row(map(cell, texts)) for texts in rows])


def _figure(content: str, caption: str = "") -> str:
    """Return a figure. content: HTML; caption: text."""
    return f"<figure>{content}" + (f"<figcaption>{escape(caption)}</figcaption>" if caption else "") + "</figure>"


def _picture(pixels: ByteArray, description: str) -> str:
    """Return uint8 RGB (H, W, 3) as an image inside the page, reduced if it is large."""
    from PIL import Image

    image = Image.fromarray(pixels)
    image.thumbnail((_WIDEST, _WIDEST))
    return f'<img src="{data_address(image, "JPEG", quality=85)}" alt="{escape(description)}">'


def _row(values: DoubleArray) -> str:
    return " ".join(f"{value:.4f}" for value in values)


def _css(lab: DoubleArray) -> list[str]:
    """Return CSS colours for L*a*b* (N, 3): sRGB, clipped."""
    encoded = encode_srgb((lab_to_xyz(lab) @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T).astype(np.float32))
    return ["#" + "".join(f"{round(255 * value):02x}" for value in row) for row in encoded.tolist()]
