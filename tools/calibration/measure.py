"""From observations to a camera: combine what the frames show, and decide what to warn of. Start reading here."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from shared import Camera, Mosaic, SensorCalibration
from shared.arrays import DoubleArray
from shared.colorimetry import SRGB_TO_XYZ, as_rows
from shared.colour_difference import delta_e_2000
from shared.errors import InputError

from .aberration import AberrationResult
from .advice import CONTRADICTION, colour_warnings, coloured_light, contradicting, dark_warnings, gamma_warnings, noise_warnings
from .assumed import Assumed
from .chart_gamma import reconciled
from .colour_matrix import ColourFit, fit_colour, white_balanced
from .dark_frames import DarkResult
from .gamma import GammaFit, check_determined, combined
from .noise import NoiseResult, noise_of_flats, noise_of_places
from .observations import KEPT, Observations
from .samples import PlaceSamples
from .shading import ShadingResult
from .shot import ShotMeasurement

_UNEVEN_BLACK = 1 / 128  # of the black level, by which planes may differ: 2 codes of 256
_BLIND = 0.01  # of the pixels: so many may be left out in the search for dead ones
_BAD_COLOUR = 6.0  # mean dE2000: above it the colours are useless
_RECIPES = {"chart": "the patches of a ColorChecker", "scene": "smooth places of ordinary scenes"}


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of a calibration.

    camera: the camera; None if the shots cannot determine it.
    refusal: the reason why there is no camera; "" if there is one.
    contradictions: sentences on what does not fit together, beyond doubt: the camera must not be used.
    warnings: sentences for the user.
    shots: measurements of the shots.
    gamma: combined estimate of all shots.
    colour: colours from the chart that fits best.
    colour_shot: name of its shot.
    before: (24, 3), L*a*b* of its patches with the matrix in the shot (without one: sRGB primaries).
    camera_rgb: (24, C), its patches under even light, 1 = what white reads in the largest channel.
    noise, dark: measurements of the flat (or chart) and dark frames.
    shading: what the flat frames show of it.
    aberration: what the shots with edges show of it.
    channels: letters of the channels.

    What was not measured is None.
    """

    camera: Camera | None
    refusal: str
    contradictions: tuple[str, ...]
    warnings: tuple[str, ...]
    shots: tuple[ShotMeasurement, ...]
    gamma: GammaFit | None
    colour: ColourFit | None
    colour_shot: str
    before: DoubleArray | None
    camera_rgb: DoubleArray | None
    noise: NoiseResult | None
    dark: DarkResult | None
    shading: ShadingResult | None
    aberration: AberrationResult | None
    channels: str

    @property
    def verdict(self) -> str:
        """The verdict: "use it", "use it with care" or "do not use it"."""
        if self.camera is None or self.contradictions or (self.colour is not None and self.colour.difference.mean() > _BAD_COLOUR):
            return "do not use it"
        return "use it with care" if self.warnings else "use it"


def conclude(
    base: Mosaic,
    seen: Observations,
    reference: DoubleArray,
    provenance: dict[str, Any] | None = None,
    notes: Sequence[str] = (),
    shading: ShadingResult | None = None,
    aberration: AberrationResult | None = None,
    old: Camera | None = None,
) -> Outcome:
    """Combine all measurements into one camera. The order in which they were made does not matter.

    base: any frame of the camera; it gives the pattern, the levels, the sensor, and whatever was not measured.
    seen: what was measured.
    reference: (24, 3), XYZ (D50) of the chart, white = 1.
    provenance: facts that every part of the camera file records.
    notes: further warnings.
    shading: of new flat frames; None = there are none, or they do not tell it.
    aberration: of new shots with edges, likewise.
    old: the camera to which the observations are added; None = there is none.
    """
    noted = provenance or {}
    changes: dict[str, Any] = {}
    measured: dict[str, dict[str, Any]] = {}
    warnings: list[str] = list(notes)
    refusal, gamma, noise = "", None, None
    calibration, dark = base.calibration, seen.dark
    if dark:
        changes["black_level"] = tuple(dark.black.tolist())
        measured["black_level"] = {**noted, "frames": dark.frames, "standard_error": _rounded(dark.black_error)}
        calibration = replace(calibration, black_level=changes["black_level"])
        warnings += dark_warnings(dark)
    before_this = old.measured if old else {}
    assumed = assumptions(calibration, dark, before_this, even=shading is not None)
    seen = seen.rebased(calibration, assumed)
    contradictions: list[str] = []
    shots = (*seen.charts, *seen.scenes)
    full_scale = calibration.full_scale
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
        contradictions = contradicting(gamma, shots)
        # If only a black level that was assumed is contradicted, gamma covers it, and dark frames may follow.
        if contradictions and (refusal or assumed.black_measured or gamma.apart > CONTRADICTION):
            refusal = "; ".join(contradictions)
    elif "gamma" not in before_this:
        warnings.append(
            f"gamma was not measured, and stays as the shots state it ({_listed(calibration.gamma)}); shoot a ColorChecker, and "
            "add it with --update"
        )
    black = assumed.black if gamma is None or assumed.black_measured else np.minimum(assumed.black, _black_error(gamma))
    dead = seen.flats.dead if seen.flats else ()
    if dark or seen.flats:
        defects = sorted({*(dark.defects if dark else ()), *dead})
        changes["defects"] = tuple(defects)
        measured["defects"] = {**noted, "part_of_pixels": len(defects) / base.samples.size}
        if len(defects) > 1e-3 * base.samples.size:
            warnings.append(f"there are many defective pixels: {len(defects)} ({100 * len(defects) / base.samples.size:.2f} %)")
    if seen.flats:
        noise = noise_of_flats(seen.flats, calibration, dark, black)
        if seen.flats.blind > _BLIND:
            warnings.append(
                f"the flat frames are too dark, or too uneven, to tell dead pixels in {100 * seen.flats.blind:.0f} % of the frame; "
                "expose the brightest pair up to three quarters of full scale"
            )
    elif seen.charts:
        warnings.append(
            "noise was measured on the chart's patches, whose texture adds to it; pairs of flat frames (--flat) show only noise"
        )
        try:
            places = PlaceSamples.joined([shot.places.as_recorded() for shot in seen.charts if shot.places])
            noise = noise_of_places(places, calibration, dark, black)
        except InputError as error:
            warnings[-1] = str(error)
    if noise:
        changes["noise"] = noise.model(full_scale)
        # In scene units noise is as uncertain as their size, which is that of gamma.
        unsure = 0.0 if gamma is None else float(gamma.covariance.sum()) ** 0.5
        measured["noise"] = {
            **noted,
            "from": noise.source,
            "shot_error": _rounded(np.array([np.hypot(full_scale * line.shot_error, unsure * line.shot) for line in noise.lines])),
            "read_error": _rounded(np.array([np.hypot(full_scale * line.read_error, unsure * line.read) for line in noise.lines])),
        }
        warnings += noise_warnings(noise, dark)
    if shading:
        gain = changes["shading"] = shading.shading
        unsure = shading.error
        if not assumed.black_measured:  # light that is black in truth does not fall off
            unsure = float(np.hypot(unsure, shading.error_of_black(black)))
            warnings.append(
                f"shading was measured with a black level that is assumed, and so is only known to ±{100 * unsure:.2g} % in the "
                "corners (standard error); take dark frames (--dark)"
            )
        measured["shading"] = {**noted, "frames": shading.frames, "standard_error": float(f"{unsure:.2g}")}
        if gain:
            measured["shading"] |= {"stops": round(gain.stops, 3), "colour": round(gain.colour, 4)}
            measured["shading"] |= {"residual": gain.residual, "focal_length": gain.focal_length}
    if aberration:
        known = changes["aberration"] = aberration.aberration
        measured["aberration"] = {**noted, "shots": aberration.shots, "standard_error": _rounded(aberration.error)}
        if known:
            measured["aberration"] |= {"corner": _rounded(aberration.corner), "focal_length": known.focal_length}
    colour, shot, before, camera_rgb = _colour(seen.charts, gamma, reference, base.pattern.channels)
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
        tinted = any(coloured_light(each) for each in shots if each.name == shot)
        warnings += colour_warnings(colour, shot, coloured=tinted)
    for part, kept in seen.to_json().items():
        measured[part] = {**measured[part], KEPT: kept}
    camera = None if refusal else Camera(replace(calibration, **changes), base.pattern, measured)
    channels = base.pattern.channels
    lens = shading, aberration
    said = refusal, tuple(contradictions), tuple(warnings)
    return Outcome(camera, *said, shots, gamma, colour, shot, before, camera_rgb, noise, dark, *lens, channels)


def assumptions(
    calibration: SensorCalibration, dark: DarkResult | None, measured: Mapping[str, Mapping[str, Any]], *, even: bool
) -> Assumed:
    """Return what is assumed of a camera.

    calibration: with its black level.
    dark: measurement of the black level by these dark frames, or those before; None = there are none.
    measured: parts of the camera before, as its file describes them.
    even: whether these flat frames tell the shading.
    """
    known = measured.get("black_level", {}).get("standard_error")
    return Assumed.of(calibration, dark, black_error=known, even=even or "shading" in measured)


def _colour(
    charts: Sequence[ShotMeasurement], gamma: GammaFit | None, reference: DoubleArray, channels: str
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
    if known is not None or channels == "RGB":
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


def _black_error(gamma: GammaFit) -> DoubleArray:
    """Return how far the black level may be off as the shots show it, (C + 1,), codes: on all planes, and on each by itself."""
    offset, error = gamma.offset
    black = np.array(gamma.calibration.black_level)
    common = np.hypot(offset, error) / max(abs(1 - float(gamma.gamma.sum())), 0.2) * (gamma.calibration.white_level - black)
    found: DoubleArray = np.hypot(common, _UNEVEN_BLACK * black)
    return found


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _rounded(values: DoubleArray) -> list[float]:
    return [float(f"{value:.3g}") for value in values.tolist()]
