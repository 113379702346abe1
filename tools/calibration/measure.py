"""From measurements to a camera: measure each shot, combine the results, and decide what to warn of. Start reading here."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from shared import Camera, Mosaic, SensorCalibration
from shared.arrays import ByteArray, DoubleArray
from shared.colorimetry import SRGB_TO_XYZ, Matrix, as_rows
from shared.colour_difference import delta_e_2000
from shared.errors import InputError
from shared.progress import SILENT, Progress

from .advice import colour_warnings, gamma_warnings, noise_warnings
from .chart.find import chart_at, find_chart
from .chart.judge import FoundChart
from .chart.picture import overlay
from .chart_gamma import fit_chart_gamma, reconciled
from .colour_matrix import ColourFit, fit_colour, white_balanced
from .gamma import GammaFit, check_determined, combined
from .noise import DarkResult, NoiseResult, noise_of_places
from .samples import PlaceSamples, patch_samples
from .scene_gamma import fit_scene_gamma

_BAD_COLOUR = 6.0  # mean dE2000: above it the colours are useless
_RECIPES = {"chart": "the patches of a ColorChecker", "scene": "smooth places of ordinary scenes"}


@dataclass(frozen=True, eq=False)
class ShotMeasurement:
    """Measurements of one shot.

    name: file name.
    calibration: the calibration stored in the shot.
    fits: independent estimates of gamma; if there is a chart, the first one comes from its patches.
    chart: the chart; None for an ordinary scene.
    places: statistics of the patches; None for an ordinary scene.
    picture: uint8 RGB (H, W, 3), the shot with the patches outlined; None for an ordinary scene.
    """

    name: str
    calibration: SensorCalibration
    fits: tuple[GammaFit, ...]
    chart: FoundChart | None = None
    places: PlaceSamples | None = None
    picture: ByteArray | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of a calibration.

    camera: the camera; None if the shots cannot determine it.
    refusal: the reason why there is no camera; "" if there is one.
    warnings: sentences for the user.
    shots: measurements of the shots.
    gamma: combined estimate of all shots.
    colour: colours from the chart that fits best.
    colour_shot: name of its shot.
    before: (24, 3), L*a*b* of its patches with the matrix in the shot (without one: sRGB primaries).
    camera_rgb: (24, C), its patches under even light, 1 = what white reads in the largest channel.
    noise, dark: measurements of the flat (or chart) and dark frames.
    channels: letters of the channels.

    What was not measured is None.
    """

    camera: Camera | None
    refusal: str
    warnings: tuple[str, ...]
    shots: tuple[ShotMeasurement, ...]
    gamma: GammaFit | None
    colour: ColourFit | None
    colour_shot: str
    before: DoubleArray | None
    camera_rgb: DoubleArray | None
    noise: NoiseResult | None
    dark: DarkResult | None
    channels: str

    @property
    def verdict(self) -> str:
        """The verdict: "use it", "use it with care" or "do not use it"."""
        if self.camera is None or (self.colour is not None and self.colour.difference.mean() > _BAD_COLOUR):
            return "do not use it"
        return "use it with care" if self.warnings else "use it"


def measure_chart(
    name: str, mosaic: Mosaic, reference: DoubleArray, corners: Matrix | None = None, progress: Progress = SILENT
) -> ShotMeasurement:
    """Find the chart in a shot, measure its patches, and estimate gamma from them and from the scene around the chart.

    name: file name.
    mosaic: the shot.
    reference: (24, 3), XYZ (D50), white = 1.
    corners: of the chart, see `ChartPlace`; None = find it.
    progress: receives the stages of the search.

    Raises InputError with the reason if the shot cannot be used.
    """
    chart = chart_at(mosaic, corners, reference) if corners else find_chart(mosaic, reference, progress)
    progress.stage("measuring", 1)
    places = patch_samples(mosaic, chart.place.regions())
    fits = [fit_chart_gamma(places)]
    with suppress(InputError):  # Surroundings are optional: a wall behind the chart has no colours.
        fits.append(fit_scene_gamma(mosaic, chart.place.covered(mosaic.shape)))
    return ShotMeasurement(name, mosaic.calibration, tuple(fits), chart, places, overlay(mosaic, chart.place))


def measure_scene(name: str, mosaic: Mosaic) -> ShotMeasurement:
    """Estimate gamma from a shot without a chart. Raises InputError with the reason if the shot cannot be used."""
    return ShotMeasurement(name, mosaic.calibration, (fit_scene_gamma(mosaic),))


def conclude(
    base: Mosaic,
    shots: Sequence[ShotMeasurement],
    reference: DoubleArray,
    dark: DarkResult | None = None,
    noise: NoiseResult | None = None,
    provenance: dict[str, Any] | None = None,
    extra_defects: Sequence[tuple[int, int]] = (),
) -> Outcome:
    """Combine all measurements into one camera.

    base: any frame of the camera; it gives the pattern, the levels, the sensor, and whatever was not measured.
    shots: measured shots.
    reference: (24, 3), XYZ (D50) of the chart, white = 1.
    dark, noise: measurements of dark and flat frames, if any.
    provenance: facts that every part of the camera file records.
    extra_defects: (row, column) of further defective pixels.
    """
    noted = provenance or {}
    changes: dict[str, Any] = {}
    measured: dict[str, dict[str, Any]] = {}
    warnings: list[str] = []
    refusal, gamma = "", None
    full_scale = base.calibration.full_scale
    if shots:
        gamma = combined([fit for shot in shots for fit in shot.fits])
        try:
            check_determined(gamma)
        except InputError as error:
            refusal = str(error)
        full_scale = float(gamma.gamma.sum())
        changes["gamma"] = tuple(gamma.gamma.tolist())
        measured["gamma"] = {**noted, **_gamma_facts(gamma, shots)}
        warnings += gamma_warnings(gamma, shots)
    if dark:
        changes["black_level"] = tuple(dark.black.tolist())
        measured["black_level"] = {**noted, "frames": dark.frames, "standard_error": _rounded(dark.black_error)}
    defects = sorted({*(dark.defects if dark else ()), *extra_defects})
    if dark or extra_defects:
        changes["defects"] = tuple(defects)
        measured["defects"] = {**noted, "part_of_pixels": len(defects) / base.samples.size}
        if len(defects) > 1e-3 * base.samples.size:
            warnings.append(f"there are many defective pixels: {len(defects)} ({100 * len(defects) / base.samples.size:.2f} %)")
    charts = [shot for shot in shots if shot.chart is not None and shot.places is not None]
    if noise is None and charts:
        read = dark.read / (base.calibration.white_level - dark.black) if dark else None
        noise = noise_of_places(PlaceSamples.joined([shot.places for shot in charts if shot.places]), base, read)
        warnings.append(
            "noise was measured on the chart's patches, whose texture adds to it; pairs of flat frames (--flat) show only noise"
        )
    if noise:
        changes["noise"] = noise.model(full_scale)
        measured["noise"] = {
            **noted,
            "from": noise.source,
            "shot_error": _rounded(np.array([full_scale * line.shot_error for line in noise.lines])),
            "read_error": _rounded(np.array([full_scale * line.read_error for line in noise.lines])),
        }
        warnings += noise_warnings(noise)
    colour, shot, before, camera_rgb = _colour(charts, gamma, reference)
    if colour is not None:
        changes["camera_to_xyz"] = as_rows(colour.matrix)
        changes["neutral"] = tuple(colour.neutral.tolist())
        measured["colour"] = {
            **noted,
            "shot": shot,
            "mean_dE2000": round(float(colour.difference.mean()), 3),
            "mean_dE2000_before": None if before is None else round(float(delta_e_2000(before, colour.reference).mean()), 3),
            "max_dE2000": round(float(colour.difference.max()), 3),
            "leave_one_out_dE2000": round(float(colour.left_out.mean()), 3),
            "light_unevenness": round(colour.unevenness, 3),
        }
        warnings += colour_warnings(colour, shot)
    calibration = replace(base.calibration, **changes)
    camera = None if refusal else Camera(calibration, base.pattern, measured)
    return Outcome(
        camera, refusal, tuple(warnings), tuple(shots), gamma, colour, shot, before, camera_rgb, noise, dark, base.pattern.channels
    )


def _colour(
    charts: Sequence[ShotMeasurement], gamma: GammaFit | None, reference: DoubleArray
) -> tuple[ColourFit | None, str, DoubleArray | None, DoubleArray | None]:
    """Return the best chart's colours, its shot's name, L*a*b* before, and camera RGB of its patches under even light."""
    if gamma is None:
        return None, "", None, None
    candidates = []
    for shot in charts:
        if shot.places is None or shot.chart is None or shot.places.clipped.any():
            continue
        levels = reconciled(shot.places, gamma.gamma)
        candidates.append((fit_colour(levels, reference, shot.chart.place.cells), shot, levels))
    if not candidates:
        return None, "", None, None
    colour, shot, levels = min(candidates, key=lambda candidate: float(candidate[0].left_out.mean()))
    known = shot.calibration.camera_to_xyz
    before = None
    if known is not None or levels.shape[1] == 3:
        before = white_balanced(levels, reference, np.array(known if known is not None else SRGB_TO_XYZ))
    even = levels / colour.light[:, None]
    scale = float((reference[18:21, 1] / (even[18:21] / colour.neutral).mean(axis=1)).mean())
    return colour, shot.name, before, even * scale


def _gamma_facts(gamma: GammaFit, shots: Sequence[ShotMeasurement]) -> dict[str, Any]:
    kinds = ["chart" if shot.chart else "scene" for shot in shots]
    return {
        "from": " and ".join(_RECIPES[kind] for kind in dict.fromkeys(kinds)),
        "shots": [shot.name for shot in shots],
        "half_width_95": _rounded(gamma.half_width),
        "condition": round(gamma.condition, 2),
        "residuals_over_noise": round(gamma.spread, 2),
    }


def _rounded(values: DoubleArray) -> list[float]:
    return [float(f"{value:.3g}") for value in values.tolist()]
