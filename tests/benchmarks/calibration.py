"""Measure the accuracy of calibration on photographs: python -m tests.benchmarks.calibration

Black level and shading count as measured. Gamma and colour of those test photographs that show a chart; and gamma from twelve
scenes without one, at K = 4, 6, 8 and two scattered tiles, its error in units of its half width. `tests.benchmarks.coverage` draws
cameras at random.
"""

from pathlib import Path

import numpy as np

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.errors import InputError
from shared.sensor import simulate_additive
from tests.data import DATA
from tests.tools.calibration.known_camera import MEASURED, PATTERNS, REFERENCE, TRUTH, frame
from tools.calibration.measure import conclude
from tools.calibration.observations import Observations, measure_chart, measure_scene
from tools.calibration.scene_gamma import fit_scene_gamma
from tools.scenes.load import load_scene

SCENES = (
    "raw/indoor1.dng", "raw/outdoor2.dng", "raw/outdoor4.dng", "raw/rose.dng", "raw/s40_pantone.crw", "raw/g2_chart_detail.crw",
    "linear/intel_tau_001.png", "linear/intel_tau_004.png", "linear/intel_tau_011.png", "linear/intel_tau_015.png",
    "kodak/kodim05.png", "kodak/kodim23.png",
)  # fmt: skip
CHARTS = (
    "chart/g2_full.crw", "raw/indoor1.dng", "raw/outdoor2.dng", "raw/outdoor4.dng",
    "chart/g2_cut_off.crw", "chart/s40_cut_off.crw", "chart/table_srgb.jpg",
)  # fmt: skip
COLOUR = ("mean_dE2000", "leave_one_out_dE2000", "light_unevenness")


def photograph(path: Path, *, chart: bool = True) -> None:
    """Print gamma and colour from a shot simulated from a photograph."""
    scene = load_scene(str(path))
    pattern = CfaPattern.bayer(6)
    calibration = SensorCalibration.of_bits(12)
    taken = simulate_additive(scene.rgb, pattern, calibration, 0.003, np.random.default_rng(0))
    mosaic = Mosaic(taken.codes, pattern, calibration)
    try:
        measured = measure_chart(path.name, mosaic, REFERENCE) if chart else measure_scene(path.name, mosaic)
    except InputError as error:
        print(f"{path.name}: refused: {error}")
        return
    outcome = conclude(Observations(mosaic, shots=[measured]), REFERENCE)
    gamma, facts = outcome.evidence.gamma, outcome.camera.measured if outcome.camera else {}
    off = ", ".join(f"{100 * (value - 1):+.2f}" for value in gamma.gamma)
    line = f"{path.name}{'' if chart else ' without chart'}: gamma off by {off} % (± {100 * gamma.worst:.1f})"
    line += "".join(f"; {name} {facts['colour'][name]}" for name in COLOUR if "colour" in facts)
    print(line + (f"; {outcome.refusal}" if outcome.refusal else ""), flush=True)


def scenes(name: str) -> None:
    """Print how far gamma from ordinary scenes is off, in half widths of its intervals, and how wide these are."""
    errors, widths, refused = [], [], 0
    for source in SCENES:
        try:
            taken = frame(load_scene(str(DATA / source)).rgb, pattern=PATTERNS[name])
            fit = fit_scene_gamma(taken, assumed=MEASURED)
        except InputError:
            refused += 1
            continue
        errors.append((fit.gamma - TRUTH.gamma) / fit.half_width)
        widths.append(fit.worst)
    off = np.abs(errors)
    print(
        f"{name}, {len(SCENES)} scenes, {refused} refused: off by {np.sqrt(np.square(off).mean()):.2f} half widths (root mean "
        f"square), {off.max():.1f} at most, intervals cover {100 * (off <= 1).mean():.0f} %, median half width "
        f"{100 * np.median(widths):.1f} %",
        flush=True,
    )


if __name__ == "__main__":
    for name in CHARTS:
        photograph(DATA / name)
    for name in ("raw/outdoor2.dng", "raw/s40_pantone.crw"):
        photograph(DATA / name, chart=False)
    for name in PATTERNS:
        scenes(name)
