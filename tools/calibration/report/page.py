"""The report: one self-contained page that an engineer reads from the top and signs, or does not."""

import base64
import io
import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from shared.arrays import ByteArray, DoubleArray
from shared.colorimetry import SRGB_TO_XYZ, encode_srgb, lab_to_xyz

from ..chart.place import COLUMNS, NAMES, PATCHES
from ..delta_e import delta_e_2000
from ..measure import Outcome, ShotMeasurement
from .svg import Axes
from .template import PAGE

_WIDEST = 1200  # pixels of an overlay
_MOST_POINTS = 600  # of a scatter plot: more only make the file large
_PLANES = {"R": "#e5484d", "G": "#30a46c", "B": "#3e63dd", "W": "#8d8d86"}
_OTHER = "#b658c4"
_ADVICE = {"use it": "good", "use it with care": "care", "do not use it": "bad"}


def report(outcome: Outcome, skipped: Sequence[str], provenance: Mapping[str, str]) -> str:
    """The page as HTML. skipped: a sentence per file that could not be used."""
    channels = outcome.channels
    sections = [
        _section("Chart", "".join(_overlay(shot) for shot in outcome.shots)),
        _section("Gamma (Eq. 7)", _gamma(outcome, channels)),
        _section("Luminance, measured against predicted", _luminance(outcome)),
        _section("Colour", _colour(outcome)),
        _section("Noise: photon transfer", _noise(outcome, channels + "W")),
        _section("Dark frames", _dark(outcome, channels + "W")),
        _section("Skipped", _list(skipped)),
        _section("camera.json", _file(outcome)),
    ]
    title = outcome.camera.calibration.sensor if outcome.camera else ""
    return PAGE.substitute(
        title=escape(f"Calibration of {title or 'the camera'}"),
        made=escape(", ".join(provenance.values())),
        kind=_ADVICE[outcome.verdict],
        verdict=escape(outcome.verdict[0].upper() + outcome.verdict[1:]),
        why=_why(outcome),
        sections="\n".join(sections),
    )


def _why(outcome: Outcome) -> str:
    facts = []
    if outcome.refusal:
        facts.append(outcome.refusal)
    elif outcome.gamma is not None:
        facts.append(f"Gamma is known to ±{100 * outcome.gamma.worst:.2g} % (95 %).")
    if outcome.colour is not None:
        facts.append(
            f"Colours match the reference to a mean ΔE2000 of {outcome.colour.difference.mean():.2f} "
            f"(patches left out: {outcome.colour.left_out.mean():.2f})."
        )
    if not outcome.refusal and not outcome.warnings:
        facts.append("Nothing speaks against it.")
    return f"<p>{escape(' '.join(facts))}</p>" + _list(outcome.warnings)


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>" if body else ""


def _list(sentences: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences) + "</ul>" if sentences else ""


def _overlay(shot: ShotMeasurement) -> str:
    if shot.chart is None or shot.picture is None:
        return ""
    corners = " ".join(f"{x:.0f},{y:.0f}" for x, y in shot.chart.place.corners)
    return (
        f'<figure><img src="{_picture(shot.picture)}" alt="The shot with the measured places outlined">'
        f"<figcaption>{escape(shot.name)}: corners {corners}, {shot.chart.place.pitch:.0f} pixels from patch to patch. "
        "White: patches; magenta: what is measured of them.</figcaption></figure>"
    )


def _picture(pixels: ByteArray) -> str:
    from PIL import Image

    image = Image.fromarray(pixels)
    image.thumbnail((_WIDEST, _WIDEST))
    data = io.BytesIO()
    image.save(data, "JPEG", quality=85)
    return "data:image/jpeg;base64," + base64.b64encode(data.getvalue()).decode()


def _gamma(outcome: Outcome, channels: str) -> str:
    fit = outcome.gamma
    if fit is None:
        return ""
    rows = [
        (letter, f"{value:.4f}", f"{value - half:.4f} to {value + half:.4f}", f"±{100 * half / value:.2g} %")
        for letter, value, half in zip(channels, fit.gamma, fit.half_width, strict=True)
    ]
    shots = [
        (
            shot.name,
            "chart" if shot.chart and number == 0 else "scene",
            " ".join(f"{value:.4f}" for value in each.gamma),
            " ".join(f"{half:.4f}" for half in each.half_width),
            f"{int(each.used.sum())} of {each.used.size}",
        )
        for shot in outcome.shots
        for number, each in enumerate(shot.fits)
    ]
    facts = (
        f"Condition number of the colours {fit.condition:.1f}; residuals {fit.spread:.2f} times what noise explains; "
        f"offset of the panchromatic samples {fit.offset:+.1f} standard errors."
    )
    return (
        _table(("channel", "gamma", "95 % interval", ""), rows)
        + f"<p>{escape(facts)}</p>"
        + _table(("shot", "measured on", "gamma", "± (95 %)", "places used"), shots)
    )


def _luminance(outcome: Outcome) -> str:
    fit = outcome.gamma
    if fit is None or not fit.level.size:
        return ""
    fits = [(shot, each, shot.chart is not None and number == 0) for shot in outcome.shots for number, each in enumerate(shot.fits)]
    highest = 1.08 * max(float(each.level.max()) for _, each, _ in fits)
    plot = Axes((0, highest), (0, highest), ("measured, of full scale", "predicted, gamma · channels"))
    plot.line([(0, 0), (highest, highest)], "ideal")
    colours = _hex(outcome.colour.reference) if outcome.colour is not None else [_OTHER] * PATCHES
    bars = ""
    for shot, each, chart in fits:
        step = max(1, each.level.size // _MOST_POINTS)
        for index in range(0, each.level.size, step):
            name = NAMES[index] if chart else "block"
            text = f"{shot.name}, {name}: measured {each.level[index]:.4f}, predicted {each.predicted[index]:.4f}"
            fill = colours[index] if chart else "var(--soft)"
            look = f"fill:{fill};stroke:var(--ink);stroke-width:.6" if chart else f"fill:{fill};fill-opacity:.35"
            plot.dot(each.level[index], each.predicted[index], style=look, title=text, radius=5 if chart else 2)
        if chart and not bars:
            bars = _residuals(shot.name, each.level, each.predicted, each.used, colours)
    return f'<div class="pair"><figure>{plot.drawn("Measured against predicted luminance")}</figure>{bars}</div>'


def _residuals(name: str, level: DoubleArray, predicted: DoubleArray, used: Any, colours: Sequence[str]) -> str:
    percent = 100 * (predicted - level) / np.maximum(level, 1e-9)
    high = max(1.1 * float(np.abs(percent).max()), 0.1)
    plot = Axes((0.2, PATCHES + 0.8), (-high, high), ("patch, in reading order", "predicted - measured, %"))
    for index, value in enumerate(percent):
        note = "" if used[index] else " (left out)"
        look = f"fill:{colours[index]};stroke:var(--ink);stroke-width:.6" + ("" if used[index] else ";stroke-dasharray:2")
        plot.bar(index + 1, float(value), 0.7, style=look, title=f"{NAMES[index]}: {value:+.2f} %{note}")
    return f"<figure>{plot.drawn('Residual of each patch')}<figcaption>{escape(name)}</figcaption></figure>"


def _colour(outcome: Outcome) -> str:
    fit = outcome.colour
    if fit is None:
        return ""
    before = delta_e_2000(outcome.before, fit.reference) if outcome.before is not None else None
    rows = [
        (name, f"{values.mean():.2f}", f"{values.max():.2f}")
        for name, values in (
            ("before (white balance only, or the shot's own matrix)", before),
            ("matrix, light taken for even", fit.plain),
            ("matrix with illumination field", fit.difference),
            ("the same, each patch predicted by the others", fit.left_out),
        )
        if values is not None
    ]
    matrix = [tuple(f"{value:+.4f}" for value in row) for row in fit.matrix]
    cells = []
    stripes = [_hex(values) for values in ([outcome.before] if outcome.before is not None else []) + [fit.lab, fit.reference]]
    for index in range(PATCHES):
        inner = "".join(f'<i style="background:{stripe[index]}"></i>' for stripe in stripes)
        words = f"<span>{NAMES[index]}</span><span>ΔE {fit.difference[index]:.1f}</span>"
        cells.append(f'<div class="patch" title="{NAMES[index]}"><b>{inner}</b>{words}</div>')
    order = "before, after, reference" if outcome.before is not None else "after, reference"
    bright = 45 + 45 * np.clip((fit.light - fit.light.min()) / max(float(np.ptp(fit.light)), 0.1), 0, 1)
    light = "".join(
        f'<div style="background:hsl(45 85% {tone:.0f}%)">{value:.2f}</div>' for value, tone in zip(fit.light, bright, strict=True)
    )
    return (
        f"<p>From {escape(outcome.colour_shot)}. Each patch from left to right: {order}.</p>"
        f'<div class="patches">{"".join(cells)}</div>'
        + _table(("ΔE2000", "mean", "maximum"), rows)
        + '<div class="pair"><div><h3>Scene units to XYZ (D50)</h3>'
        + _table((), matrix)
        + f"<p>White reads {' '.join(f'{value:.4f}' for value in fit.neutral)}.</p></div>"
        + f'<div><h3>Light on the chart</h3><div class="light" style="grid-template-columns:repeat({COLUMNS},1fr)">{light}</div>'
        + f"<p>Brightest over dimmest: {fit.unevenness:.2f}.</p></div></div>"
    )


def _noise(outcome: Outcome, planes: str) -> str:
    noise = outcome.noise
    if noise is None:
        return ""
    mean, variance = noise.points.mean, noise.points.variance
    good = (mean > 0) & (variance > 0) & (noise.points.count > 1)
    if not good.any():
        return ""
    span = (float(mean[good].min()) / 1.5, float(mean[good].max()) * 1.5)
    tall = (float(variance[good].min()) / 2, float(variance[good].max()) * 2)
    plot = Axes(span, tall, ("mean, of full scale", "variance"), log=True)
    rows = []
    for plane, (letter, line) in enumerate(zip(planes, noise.lines, strict=True)):
        colour = _PLANES.get(letter, _OTHER)
        chosen = np.flatnonzero(good[:, plane])[:: max(1, int(good[:, plane].sum()) // 150)]
        for index in chosen:
            text = f"{letter}: mean {mean[index, plane]:.4f}, variance {variance[index, plane]:.3g}"
            plot.dot(mean[index, plane], variance[index, plane], style=f"fill:{colour};fill-opacity:.6", title=text, radius=2.5)
        steps = np.geomspace(*span, 40)
        plot.line([(x, float(y)) for x, y in zip(steps, line.variance(steps), strict=True) if y > tall[0]], f"plane plane-{letter}")
        full = 1 / line.shot if line.shot > 0 else float("inf")
        rows.append(
            (
                letter,
                f"{line.shot:.3g} ± {1.96 * line.shot_error:.1g}",
                f"{full:,.0f}",
                f"{line.read:.3g}" + (f" ± {1.96 * line.read_error:.1g}" if line.read_error else " (dark frames)"),
                f"{line.read / line.shot:.2f}" if line.shot > 0 else "",
            )
        )
    return (
        f'<div class="pair"><figure>{plot.drawn("Photon transfer curve")}<figcaption>From {escape(noise.source)}; '
        "one line per filter colour, rounding taken out.</figcaption></figure><div>"
        + _table(
            ("plane", "variance / mean", "electrons at full scale", "read noise, of full scale", "read noise, electrons"), rows
        )
        + "</div></div>"
    )


def _dark(outcome: Outcome, planes: str) -> str:
    dark = outcome.dark
    if dark is None:
        return ""
    rows = [
        (letter, f"{black:.3f} ± {1.96 * error:.3f}", f"{read:.3f}")
        for letter, black, error, read in zip(planes, dark.black, dark.black_error, dark.read, strict=True)
    ]
    return _table(("plane", "black level, codes", "read noise, codes"), rows) + (
        f"<p>{dark.frames} frames; {len(dark.defects)} pixels are not black.</p>"
    )


def _file(outcome: Outcome) -> str:
    if outcome.camera is None:
        return ""
    text = json.dumps(outcome.camera.to_json(), indent=1, ensure_ascii=False)
    return f"<details><summary>Content, id {outcome.camera.calibration.id}</summary><pre>{escape(text)}</pre></details>"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = "<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>" if head else ""
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table>{top}{body}</table></div>'


def _hex(lab_values: DoubleArray) -> list[str]:
    """CSS colours of L*a*b* (N, 3), sRGB, clipped."""
    encoded = encode_srgb((lab_to_xyz(lab_values) @ np.linalg.inv(np.array(SRGB_TO_XYZ)).T).astype(np.float32))
    return ["#" + "".join(f"{round(255 * value):02x}" for value in row) for row in encoded.tolist()]
