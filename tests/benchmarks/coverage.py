"""How often 95 % is 95 %: python -m tests.benchmarks.coverage [--cameras 100] [--seed 0] [--kinds
chart chart+dark ...]

Each camera is drawn at random, and simulated here, without the program's own simulator: pattern,
bits, gamma, electrons, read noise, black levels that are not what the shots state, a lens whose
colours fall off unlike each other, and the light on a chart of any size at any place. It is
calibrated from every subset of its frames. Of each kind of subset the table says how many cameras
are refused, how many get the verdict "do not use it", and how often the 95 % intervals of the
others cover the truth, with the largest error, in half widths: of gamma; of black level, gain and
read noise, where frames measure them. Rows of a variant (`VARIANTS`) begin with its name. Without
flat frames the truth is gamma at the place of the charts.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np

from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.arrays import DoubleArray, FloatArray
from panchroma.shared.colorimetry import as_rows
from panchroma.shared.errors import InputError
from panchroma.tools.batch.console import Console
from panchroma.tools.calibration.chart.place import ChartPlace
from panchroma.tools.calibration.conclude import Result, conclude
from panchroma.tools.calibration.measure import Measurements, Session
from tests.benchmarks.harness import options
from tests.tools.calibration.known_camera import PATTERNS, REFERENCE, chart, true_place

SHAPE = (400, 600)
VARIANTS: dict[str, dict[str, Any]] = {
    "": {},
    "corner, planes": {"corner": True},
    "corner, light": {"corner": True, "in_light": True},
    "small": {"share": 0.45},
    **{f"bad pixels, {number}": {"bad": number} for number in (1, 10, 100)},
    **{f"flicker, {part} %": {"flicker": part / 100} for part in (1, 3, 10)},
    **{f"W off by {percent} %": {"off": percent / 100} for percent in (0.3, 1, 3)},
}
"""What differs from the cameras as they are drawn."""
KINDS = (
    "chart", "charts", "chart+dark", "chart+flat", "chart+flat1", "chart+dark+flat", "charts+dark+flat", "dark+flat", "flat",
    "small: chart+dark", "small: chart+dark+flat",
    *(f"bad pixels, {number}: {kind}" for number in (1, 10, 100) for kind in ("chart", "chart+dark", "chart+dark+flat")),
    *(f"flicker, {part} %: {kind}" for part in (1, 3, 10) for kind in ("chart+dark+flat", "chart+flat")),
    *(f"W off by {percent} %: {kind}+dark+flat" for percent in (0.3, 1, 3) for kind in ("chart", "charts")),
    *(f"corner, {where}: {kind}" for where in ("planes", "light") for kind in ("chart+dark", "chart+dark+flat", "charts+dark+flat")),
)  # fmt: skip
SIGMAS = 1.96
NAMES = ("gamma", "black", "shot", "read")


@dataclass(frozen=True)
class SimulatedCamera:
    """A camera whose truth is known.

    pattern: its filters.
    states: the calibration that its shots state.
    gamma: (C,), weights of Eq. 7.
    black: (C + 1,), codes.
    electrons: at full scale.
    read: (C + 1,), electrons.
    falls: (C + 1, 4), fall-off per plane: shares of r^2, r^4, row and column.
    in_light: the fall-off of the channels is that of the light, and that of panchromatic samples
    follows.
    corner: its charts are of half the width of the frame, and in its corners.
    share: of the frame that a chart takes along each side, and coloured areas are around it; None =
    a larger share, and an even grey.
    bad: number of pixels that are stuck at some level.
    flicker: amplitude of the lamp's, over flat frames, as a share of the light.
    off: standard deviation of panchromatic levels of patches from what Eq. 7 says, a share.
    """

    pattern: CfaPattern
    states: SensorCalibration
    gamma: DoubleArray
    black: DoubleArray
    electrons: float
    read: DoubleArray
    falls: DoubleArray
    in_light: bool = False
    corner: bool = False
    share: float | None = None
    bad: int = 0
    flicker: float = 0.0
    off: float = 0.0

    @staticmethod
    def drawn(random: np.random.Generator) -> "SimulatedCamera":
        """A camera at random."""
        bits = int(random.choice([10, 12, 14]))
        states = SensorCalibration.of_bits(bits, headroom=False)
        level = states.black_level[0]
        errors = [0.0, random.normal(0, level / 16), random.uniform(-0.75, 0.5) * level]
        off = float(random.choice(errors))
        falls = np.zeros((4, 4))
        falls[:, :2] += random.uniform(0, 0.6) * np.array([0.8, 0.2])
        falls[:3, :2] += random.choice([0.3, 1.0]) * random.normal(0, (0.1, 0.05), (3, 2))
        falls[:3, 2:] += random.normal(0, 0.005, (3, 2))
        return SimulatedCamera(
            pattern=list(PATTERNS.values())[int(random.integers(len(PATTERNS)))],
            states=states,
            gamma=random.uniform(0.6, 1.4, 3),
            black=level + off + random.normal(0, level / 256, 4),
            electrons=float(np.exp(random.uniform(np.log(6e3), np.log(6e4)))),
            read=random.uniform(1.5, 8, 4),
            falls=falls,
        )

    def shot(
        self,
        rgb: FloatArray | DoubleArray,
        random: np.random.Generator,
        more: DoubleArray | float = 1.0,
    ) -> Mosaic:
        """A frame that looks at a scene (H, W, 3), scene units; more: panchromatic light over that
        of Eq. 7, (H, W).
        """
        height, width = rgb.shape[:2]
        planes = self.pattern.filter_map((height, width))
        middle = np.array([height - 1, width - 1]) / 2
        y, x = (np.mgrid[:height, :width] - middle[:, None, None]) / np.hypot(*middle)
        left = self.left_at(y, x)
        light = rgb * left[..., :-1]
        clear = light @ self.gamma if self.in_light else (rgb @ self.gamma) * left[..., -1]
        clear = clear * more
        signal = np.concatenate([light, clear[..., None]], axis=2, dtype=np.float64)
        filtered = np.take_along_axis(signal, planes[..., None].astype(int), axis=2)[..., 0]
        light = filtered / self.gamma.sum() * self.electrons
        counted = random.poisson(light) + random.normal(0, 1, light.shape) * self.read[planes]
        white, black = self.states.white_level, self.black[planes]
        codes = np.rint(black + counted / self.electrons * (white - black)).clip(0, white)
        return Mosaic(codes.astype(np.uint16), self.pattern, self.states)

    def left_at(self, y: DoubleArray, x: DoubleArray) -> DoubleArray:
        """What the fall-off leaves of each plane at places, (..., C + 1)."""
        square = y**2 + x**2
        shapes = np.stack([square, square**2, y, x], axis=-1)
        return np.asarray(np.maximum(1 - shapes @ self.falls.T, 0.1))

    def gamma_at(self, places: DoubleArray) -> DoubleArray:
        """The mean of gamma at places (N, 2) of a frame whose shading is not undone."""
        *left, clear = self.left_at(*places.T).T
        return self.gamma * (1 if self.in_light else np.mean(clear / left, axis=1))


@dataclass
class Frames:
    """The frames of one session, by name, and where the charts are in them."""

    mosaics: dict[str, Mosaic] = field(default_factory=dict)
    places: dict[str, ChartPlace] = field(default_factory=dict)

    def named(self, kind: str) -> list[str]:
        return [name for name in self.mosaics if name.startswith(kind)]


def areas(random: np.random.Generator) -> FloatArray:
    """Rectangles of all sizes and colours, most of them dull, some with a texture."""
    scene = np.full((*SHAPE, 3), 0.35, np.float32)
    for _ in range(150):
        top, left = (int(random.integers(-60, side)) for side in SHAPE)
        high, wide = np.exp(random.uniform(np.log(15), np.log(150), 2)).astype(int).tolist()
        colour = random.uniform(0.05, 0.8) * random.uniform(0.2, 1, 3) ** random.choice([0.3, 1.5])
        area = scene[max(top, 0) : top + high, max(left, 0) : left + wide]
        rough = random.choice([0, 0, 0.01, 0.1])
        area[:] = colour * np.exp(random.normal(0, rough, (*area.shape[:2], 1)))
    return scene


def session_of(camera: SimulatedCamera, random: np.random.Generator) -> Frames:
    """Three charts, four dark frames and pairs of flat frames of three exposures."""
    frames = Frames()
    off = camera.off * random.normal(0, 1, 24) if camera.off else np.zeros(24)
    for number in range(3):
        colour = random.uniform(0.5, 1, 3)
        share = camera.share or (0.5 if camera.corner else random.choice([1.0, 0.8]))
        high, wide = (round(share * side) for side in SHAPE)
        rows = np.linspace(0, SHAPE[0] - 1, high).round().astype(int)
        columns = np.linspace(0, SHAPE[1] - 1, wide).round().astype(int)
        scene = areas(random) if camera.share else np.full((*SHAPE, 3), 0.35, np.float32)
        top = int(random.integers(0, SHAPE[0] - high + 1))
        left = int(random.integers(0, SHAPE[1] - wide + 1))
        if camera.corner:
            top = int(random.choice([0, SHAPE[0] - high]))
            left = int(random.choice([0, SHAPE[1] - wide]))
        scene[top : top + high, left : left + wide] = chart().rgb[np.ix_(rows, columns)]
        scene *= colour / (colour.max() * 0.9) * random.uniform(0.4, 0.95)
        scale = wide / SHAPE[1], high / SHAPE[0]
        corners = np.array(true_place().corners) * scale + (left, top)
        frames.places[f"chart{number}"] = ChartPlace(as_rows(corners))
        more = np.ones(SHAPE)
        for pixels, deviation in zip(frames.places[f"chart{number}"].measured(), off, strict=True):
            more[pixels] += deviation
        frames.mosaics[f"chart{number}"] = camera.shot(scene, random, more=more)
    for number in range(4):
        frames.mosaics[f"dark{number}"] = camera.shot(np.zeros((*SHAPE, 3)), random)
    colour = random.uniform(0.6, 1, 3)
    other = random.spawn(1)[0]  # what the others draw does not depend on it
    rows = 2 * np.pi * np.arange(SHAPE[0])[:, None, None] / other.uniform(20, 300)
    for number, light in enumerate(np.repeat((0.1, 0.35, 0.75), 2)):
        even = np.ones((*SHAPE, 3)) * colour / colour.max() * light
        even *= 1 + camera.flicker * np.sin(rows + other.uniform(0, 2 * np.pi))
        frames.mosaics[f"flat{number}"] = camera.shot(even, random)
    places = tuple(other.integers(0, SHAPE, (camera.bad, 2)).T)
    stuck = other.choice([0.0, 0.3, 1.0, 1.0], camera.bad) * camera.states.white_level
    for name, mosaic in frames.mosaics.items():
        codes = mosaic.codes.copy()
        codes[places] = stuck
        frames.mosaics[name] = replace(mosaic, samples=codes)
    return frames


def calibrated(frames: Frames, kind: str) -> Result | None:
    """Calibrate from a subset: chart, charts, dark, flat, or flat1, one flat frame; None = no frame
    can be used.
    """
    parts, console = set(kind.split("+")), Console(json=True, quiet=True)
    session = Session(console, Measurements(REFERENCE), None, frames.mosaics.__getitem__)
    if "dark" in parts:
        session.dark(frames.named("dark"))
    if parts & {"flat", "flat1"}:
        session.flat(frames.named("flat")[0 if "flat" in parts else -1 :])
    charts = frames.named("chart")[: None if "charts" in parts else int("chart" in parts)]
    for name in charts:
        session.shots([name], frames.places[name].corners)
    if session.measured.base is None or (charts and not session.measured.shots):
        return None
    try:
        return conclude(session.measured)
    except InputError:
        return None


def errors(
    outcome: Result, camera: SimulatedCamera, *, gamma_known: bool
) -> dict[str, DoubleArray]:
    """How far each figure is off, in half widths of its interval; a figure that was not measured is
    left out.
    """
    off = {}
    gamma, dark = outcome.measured.gamma, outcome.measured.dark
    if gamma is not None:
        flat = outcome.measured.shading is not None
        truth = camera.gamma if flat else camera.gamma_at(gamma.where)
        off["gamma"] = (gamma.gamma - truth) / gamma.half_width
    if dark is not None:
        off["black"] = (dark.black - camera.black) / (SIGMAS * dark.black_error)
    if outcome.camera is not None and "noise" in outcome.camera.measured:
        model, how = outcome.camera.calibration.noise, outcome.camera.measured["noise"]
        scale = (float(camera.gamma.sum()) if gamma_known else 3.0) / camera.electrons
        for name, true in (("shot", scale), ("read", scale * camera.read)):
            half = SIGMAS * np.array(how[f"{name}_error"])
            off[name] = (np.array(getattr(model, name)) - true) / half
    return off


@dataclass
class Counts:
    """What came of the cameras of one kind of subset."""

    refused: int = 0
    unfit: int = 0
    off: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def line(self, kind: str, cameras: int) -> str:
        cells = [kind, *(f"{100 * n / cameras:.0f} %" for n in (self.refused, self.unfit))]
        for name in NAMES:
            off = np.abs(self.off[name])
            cells.append(f"{100 * (off <= 1).mean():.0f} %, {off.max():.1f}" if off.size else "")
        return f"| {' | '.join(cells)} |"


def campaign(cameras: Iterable[int], kinds: Sequence[str]) -> dict[str, Counts]:
    """Calibrate cameras, by their numbers, from these kinds of subsets."""
    counts = {kind: Counts() for kind in kinds}
    wanted = [(kind, *kind.rpartition(": ")[::2]) for kind in kinds]
    for number, variant in product(cameras, dict.fromkeys(name for _, name, _ in wanted)):
        random = np.random.default_rng(number)
        camera = replace(SimulatedCamera.drawn(random), **VARIANTS[variant])
        frames = session_of(camera, random)
        for kind, of_variant, parts in wanted:
            if of_variant != variant:
                continue
            count, outcome = counts[kind], calibrated(frames, parts)
            if outcome is None or (outcome.camera is None and not outcome.contradictions):
                count.refused += 1
                continue
            if outcome.verdict == "do not use it":
                count.unfit += 1
                continue
            for name, off in errors(outcome, camera, gamma_known="chart" in parts).items():
                count.off[name] += off.tolist()
    return counts


def main() -> None:
    """Print the table."""
    kinds = {"nargs": "+", "default": list(KINDS), "choices": KINDS}
    arguments = options(__doc__, cameras=100, seed=0, kinds=kinds)
    first, count = arguments.seed, arguments.cameras
    table = campaign(range(first, first + count), arguments.kinds)
    print(f"| frames | refused | do not use | {' | '.join(NAMES)} |")
    print(f"{'|---' * 7}|")
    for kind, counts in table.items():
        print(counts.line(kind, count))


if __name__ == "__main__":
    main()
