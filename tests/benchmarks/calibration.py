"""Measure the accuracy of calibration: python -m tests.benchmarks.calibration [--seeds 100]

Black level and shading count as measured; `tests.benchmarks.coverage` is without. Synthetic truth: the built-in chart, gamma
(0.9, 1.1, 0.8), sensor protocol, K = 4, 6, 8 and two scattered tiles: error and coverage of gamma over many seeds, gain and read
noise from flat and dark frames, planted hot pixels. Photographs: those test photographs that show a chart; and gamma from twelve
scenes without one, its error in units of its half width.
"""

import argparse
from pathlib import Path

import numpy as np

from shared import CfaPattern, Mosaic, SensorCalibration
from shared.errors import InputError
from shared.sensor import simulate_additive
from tests.data import DATA
from tests.tools.calibration.known_camera import BLIND, MEASURED, NOISE, PATTERNS, TRUTH, edited, frame
from tools.calibration.chart.find import find_chart
from tools.calibration.chart_gamma import fit_chart_gamma
from tools.calibration.dark_frames import measure_dark
from tools.calibration.measure import conclude
from tools.calibration.noise import measure_flats, noise_of_flats
from tools.calibration.observations import Observations
from tools.calibration.parts.colour import ColourPart
from tools.calibration.parts.gamma import gamma_of
from tools.calibration.samples import patch_samples
from tools.calibration.scene_gamma import fit_scene_gamma
from tools.calibration.shot import measure_chart, measure_scene
from tools.commands.calibrate import color_checker_xyz
from tools.scenes.drawn.chart import chart_scene
from tools.scenes.load import load_scene

HOT = 400
SCENES = (
    "raw/indoor1.dng", "raw/outdoor2.dng", "raw/outdoor4.dng", "raw/rose.dng", "raw/s40_pantone.crw", "raw/g2_chart_detail.crw",
    "linear/intel_tau_001.png", "linear/intel_tau_004.png", "linear/intel_tau_011.png", "linear/intel_tau_015.png",
    "kodak/kodim05.png", "kodak/kodim23.png",
)  # fmt: skip
CHARTS = (
    "chart/g2_full.crw", "raw/indoor1.dng", "raw/outdoor2.dng", "raw/outdoor4.dng",
    "chart/g2_cut_off.crw", "chart/s40_cut_off.crw", "chart/table_srgb.jpg",
)  # fmt: skip
REFERENCE = color_checker_xyz()


def synthetic_gamma(name: str, seeds: int) -> None:
    """Print errors and coverage of gamma."""
    scene, pattern, truth = chart_scene(1200, 800), PATTERNS[name], np.array(TRUTH.gamma)
    place = find_chart(frame(scene.rgb, pattern=pattern), REFERENCE).place
    errors, covered = [], []
    for seed in range(seeds):
        samples = patch_samples(frame(scene.rgb, pattern=pattern, seed=seed), place.regions())
        fit = fit_chart_gamma(samples, BLIND, MEASURED)
        errors.append(fit.gamma / truth - 1)
        covered.append(np.abs(fit.gamma - truth) <= fit.half_width)
    worst, coverage = np.abs(errors).max(axis=0), np.mean(covered, axis=0)
    print(f"{name}: {seeds} seeds, largest error {100 * worst.max():.2f} %, each gamma's interval covers {coverage * 100} %")


def synthetic_noise(name: str) -> None:
    """Print errors of gain, read noise, black level and defects."""
    pattern, shape = PATTERNS[name], (600, 900)
    rng = np.random.default_rng(pattern.period)
    hot = rng.choice(shape[0] * shape[1], HOT, replace=False)
    above = np.zeros(shape)
    above.flat[hot] = rng.uniform(20, 800, HOT)
    black = np.zeros((*shape, 3))
    darks = [edited(frame(black, pattern=pattern, seed=n), lambda codes: np.minimum(codes + above, 4095)) for n in range(8)]
    dark = measure_dark(darks)
    found = {row * shape[1] + column for row, column in dark.defects}
    falling = 1 - 0.3 * np.linspace(0, 1, shape[1])[None, :, None] * np.ones((shape[0], 1, 3))
    levels = np.repeat((0.02, 0.1, 0.3, 0.6, 0.9), 2)
    flats = [frame(level * falling, pattern=pattern, seed=10 + n) for n, level in enumerate(levels)]
    seen, _ = measure_flats(flats)
    for known, frames in ((dark, "flats and darks"), (None, "flats alone")):
        noise = noise_of_flats(seen, BLIND, known)
        model = noise.model(sum(TRUTH.gamma))
        gain, reading = 100 * (np.array(model.shot) / NOISE.shot - 1), 100 * (np.array(model.read) / NOISE.read - 1)
        print(f"{name}, {frames}: gain off by {gain.round(1)} %, read noise by {reading.round(1)} %")
    print(
        f"{name}: hot pixels missed {len(set(hot.tolist()) - found)} of {HOT}, "
        f"false {len(found - set(hot.tolist())) / (shape[0] * shape[1]):.1e}, "
        f"black level off by {(dark.black - TRUTH.black_level).round(4)} codes"
    )


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
    outcome = conclude(Observations(mosaic, shots=(measured,)), REFERENCE)
    gamma, colours = gamma_of(outcome.evidence), outcome.evidence.part(ColourPart)
    assert gamma is not None
    off = ", ".join(f"{100 * (value - 1):+.2f}" for value in gamma.gamma)
    line = f"{path.name}{'' if chart else ' without chart'}: gamma off by {off} % (± {100 * gamma.worst:.1f})"
    if colours is not None:
        colour = colours.fit
        line += (
            f"; dE2000 {colour.difference.mean():.2f}, without field {colour.plain.mean():.2f}, "
            f"left out {colour.left_out.mean():.2f}; light uneven by {colour.unevenness:.2f}"
        )
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


def main() -> None:
    """Print every figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    seeds = parser.parse_args().seeds
    for name in CHARTS:
        photograph(DATA / name)
    for name in ("raw/outdoor2.dng", "raw/s40_pantone.crw"):
        photograph(DATA / name, chart=False)
    for name in PATTERNS:
        scenes(name)
        synthetic_noise(name)
        synthetic_gamma(name, seeds)


if __name__ == "__main__":
    main()
