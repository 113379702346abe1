"""Extreme scenes through every way to a picture: each has to end in a picture that is finite, and
right where that is known.

    python -m tests.fuzz.scenes --count 2000 --seed 1
    python -m tests.fuzz.scenes --number 4711 --seed 1        repeat one of them

A case is a scene, its light, a filter pattern, a calibration and a way to the picture. What is
known of the result:
    finite      every value of every picture, without an invalid operation in NumPy on the way
    even        a constant scene without noise comes back constant, and a black one black
    moderate    nothing is brighter, or darker than black, than a few times the brightest sample
    in units    the same scene under 2 or 1/2 of the light comes back with as much more or less light
"""

import sys
import traceback
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from random import Random

import numpy as np

from panchroma.device import Preview
from panchroma.offline import PRESETS, render
from panchroma.offline.burst import merge_burst, render_burst_bands
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration, Shading
from panchroma.shared.arrays import FloatArray
from panchroma.tools.simulation.sensor import sample, simulate_additive, simulate_sensor
from tests.fuzz.sweep import FAULT, Result, arguments, report

RIGHT = "right"
WAYS = (*PRESETS, "burst", "preview")
SCENES = (
    *("black", "white", "constant", "pixel", "row", "checker"),
    *("letterbox", "below black", "strokes", "random"),
)
LIGHTS = (1.0, 1.0, 1.0, 2.0**-6, 30.0, 100.0)  # times the scene
KODAK = "WBWG/BWGW/WGWR/GWRW"
EIGHT = ("HIJ", "KWL", "NOP"), ("HIJK", "LNOP")
TAKES = ("exact", "exact", "exact", "noisy", "codes")
NOISES = (
    *("none", "none", "unknown", "typical", "no read noise"),
    *("no shot noise", "tiny", "tiny shot noise", "huge"),
)
LENSES = ("none", "none", "none", "shading")
_ORDINARY = 0.3  # least gamma; beyond it and its inverse a picture has to be finite and moderate
# of the brightest: what a constant scene may be off by; the solvers end at residuals of this size
_EVEN = 1e-3
# likewise with shading, whose slopes over a few pixels are harder to fill in than any lens's
_SHADED = 0.03
# likewise of previews, which see codes: ten bits, of which the black level may leave forty codes
_CODES = 0.1
_BLACK = 1e-6  # scene units: what a black scene may show
_WILD = 10.0  # times the brightest: where light is below black, colours are hardly bound
# of the brightest, root mean square: thresholds in scene units make the same scene come back a
# little differently
_UNITS = 0.1


@dataclass(frozen=True)
class Case:
    """One case. scene: (H, W, C), scene units, `light` included; for the other fields see the
    module.
    """

    way: str
    name: str
    light: float
    take: str
    noise: str
    lens: str
    pattern: CfaPattern
    calibration: SensorCalibration = field(repr=False)
    scene: FloatArray = field(repr=False)
    seed: int


def case(seed: int, number: int) -> Case:
    """Case `number` of a campaign."""
    random = Random(f"{seed} {number}")
    pattern, way = _pattern(random), random.choice(WAYS)
    least = 24 if way == "burst" else 2 * pattern.period
    height, width = (
        random.choice((least, random.randrange(least, least + 12), random.randrange(60, 140)))
        for _ in range(2)
    )
    name, light, seed = random.choice(SCENES), random.choice(LIGHTS), random.randrange(1 << 30)
    shape = height, width, len(pattern.channels)
    scene = light * _draw(name, shape, np.random.default_rng(seed))
    noise, lens = random.choice(NOISES), random.choice(LENSES)
    calibration = _calibration(random, pattern, (height, width), noise, lens, light)
    take, seed = random.choice(TAKES), random.randrange(1 << 30)
    return Case(way, name, light, take, noise, lens, pattern, calibration, scene, seed)


def _pattern(random: Random) -> CfaPattern:
    kind = random.choice(("bayer", "bayer", "kodak", "honda", "cmy", "many", "pair"))
    origin = random.randrange(16), random.randrange(16)
    order = random.choice(("RGGB", "BGGR", "GRBG", "GBRG"))
    match kind:
        case "bayer":
            return CfaPattern.bayer(random.choice((3, 4, 5, 6, 8, 12)), order, origin)
        case "kodak" | "honda":
            return CfaPattern.of_letters({"kodak": KODAK, "honda": "RG/BW"}[kind], origin)
        case "cmy":
            return CfaPattern.with_block(("CM", "YC"), random.choice((4, 6)), origin)
        case "many":
            return CfaPattern.with_block(random.choice(EIGHT), random.choice((6, 8)), origin)
        case _:
            return CfaPattern.with_block(("AB",), 5, origin)


def _draw(name: str, shape: tuple[int, int, int], random: np.random.Generator) -> FloatArray:
    colour, row, column = random.uniform(0.05, 1, shape[2]), *np.indices(shape[:2])
    scene = np.full(shape, {"black": 0.0, "white": 1.0}.get(name, colour))
    place = tuple(int(random.integers(size)) for size in shape[:2])
    period = int(random.integers(1, 9))
    match name:
        case "pixel":
            scene = np.full(shape, random.choice((0, 0.01, 0.5)))
            scene[place] = random.choice((1, 10))
        case "row":
            scene[place[0]] = 0
        case "checker":
            scene *= ((row // period + column // period) % 2)[..., None]
        case "letterbox":
            scene = random.uniform(0, 1, shape)
            scene[: shape[0] * 3 // 4] = 0
        case "below black":
            scene -= random.uniform(0, 2 * colour.max(), shape)
        case "strokes":
            scene[((row - column) % (3 * period)) < period] = random.uniform(0, 0.1, shape[2])
        case "random":
            scene = random.uniform(0, 1, shape)
    return scene.astype(np.float32)


def _calibration(
    random: Random, pattern: CfaPattern, shape: tuple[int, int], noise: str, lens: str, light: float
) -> SensorCalibration:
    count, letters = len(pattern.channels), pattern.channels
    near = tuple(random.uniform(0.5, 1.5) for _ in letters)
    far = tuple(10 ** random.uniform(-2, 2) for _ in letters)
    gamma = random.choice(((1.0,) * count, near, far))
    figures = {
        "unknown": None,
        "typical": (2e-4, 6e-4),
        "no read noise": (random.choice((1e-12, 1e-4, 1.0)), 0.0),
        "no shot noise": (0.0, random.choice((1e-12, 1e-3, 1.0))),
        "tiny": (1e-12, 1e-12),
        "tiny shot noise": (1e-9, 0.01 * light),
        "huge": (random.choice((1.0, 1e3)), random.choice((1.0, 1e3))),
    }.get(noise, (0.0, 0.0))
    model = figures and NoiseModel((figures[0],) * (count + 1), (figures[1],) * (count + 1))
    bits = random.choice((10, 12, 16))
    black = random.choice((0, 1 << (bits - 4), (1 << bits) - 40))
    slopes = [random.uniform(-0.1, 0.1) for _ in range(count + 1)]
    points = 1 + np.array(slopes)[:, None, None] * (np.arange(4) - 1.5)[:, None] * np.ones(4)
    some = tuple((random.randrange(shape[0]), random.randrange(shape[1])) for _ in range(20))
    return SensorCalibration(
        letters,
        gamma,
        model,
        (black,) * (count + 1),
        (1 << bits) - 1,
        defects=random.choice(((), some)),
        shading=Shading(points, shape) if lens == "shading" else None,
    )


def photographed(case: Case, factor: float = 1.0, frame: int = 0) -> Mosaic:
    """The shot of a case. factor: times its light. frame: of a burst; each is displaced, and has
    noise of its own.
    """
    random = np.random.default_rng((case.seed, frame))
    scene = np.roll(case.scene, frame, (0, 1)) * np.float32(factor)
    if case.take == "codes":
        return simulate_sensor(scene, case.pattern, case.calibration, 1.0, random)
    sigma = 0.02 * case.light if case.take == "noisy" else 0.0
    taken = simulate_additive(scene, case.pattern, case.calibration, sigma, random)
    return replace(taken, calibration=case.calibration)


def pictures(case: Case, factor: float = 1.0) -> list[FloatArray]:
    """What comes of a case: the picture first, then everything else that has to be finite."""
    shot = photographed(case, factor)
    match case.way:
        case "preview":
            return [
                Preview.for_mosaic(shot, linear=linear, threads=1).run(shot).astype(np.float32)
                for linear in (True, False)
            ]
        case "burst":
            merged = merge_burst([shot, *(photographed(case, factor, frame) for frame in (1, 2))])
            picture = np.concatenate(list(render_burst_bands(merged)))
            return [picture, merged.noise_ratio, merged.measured.luminance]
        case preset:
            rendered = render(shot, PRESETS[preset])
            return [rendered.rgb, rendered.luminance, rendered.chromaticity]


def outcome(case: Case) -> tuple[str, str]:
    """Whether a case comes out right, and what is wrong with it."""
    try:
        with np.errstate(divide="raise", invalid="raise", over="raise"):
            results = pictures(case)
            if not all(np.isfinite(picture).all() for picture in results):
                return FAULT, "not finite"
            return judge(case, results[0])
    except Exception:
        return FAULT, traceback.format_exc()


def judge(case: Case, picture: FloatArray) -> tuple[str, str]:
    """Whether a picture is what is known of it: of scenes alone, without noise."""
    if case.take != "exact" or case.noise == "huge":
        return RIGHT, ""
    gamma = np.array(case.calibration.gamma)
    samples = np.abs(sample(case.scene, case.pattern, case.calibration))
    brightest = float(max(samples.max(), (gamma * np.abs(case.scene)).max()))
    weighted, quantised = picture * gamma, case.way == "preview"
    if case.name == "black" and np.abs(weighted).max() > _BLACK:
        return FAULT, f"not black: {weighted.min():g} to {weighted.max():g}"
    if np.abs(weighted).max() > _WILD * brightest + _BLACK and not quantised:
        extremes = f"{weighted.min():g} to {weighted.max():g}"
        return FAULT, f"wild: {extremes} where {brightest:g} is the brightest"
    ordinary = _ORDINARY <= gamma.min() <= gamma.max() <= 1 / _ORDINARY
    if case.name in ("white", "constant") and ordinary and (case.light == 1 or not quantised):
        limit = _EVEN if case.calibration.shading is None else _SHADED
        limit = brightest * (_CODES if quantised else limit)
        # what is in the noise may move
        limit += case.calibration.noise.sigma(brightest) if case.calibration.noise else 0.0
        if case.noise == "none":
            fault, off = "off", float(np.abs(weighted - gamma * case.scene[0, 0]).max())
        else:
            fault, off = "uneven", float(np.ptp(weighted, axis=(0, 1)).max())
        if off > limit:
            return FAULT, f"{fault} by {off:g} where the brightest is {brightest:g}"
    if case.way in PRESETS and ordinary and case.noise == "none":
        off = float(np.sqrt(np.square((pictures(case, 2.0)[0] / 2 - picture) * gamma).mean()))
        if off > _UNITS * brightest:
            return FAULT, f"twice the light is off by {off:g} where the brightest is {brightest:g}"
    return RIGHT, ""


def results(seed: int, numbers: Iterable[int]) -> Iterator[Result]:
    """What comes of these cases; their kinds are the ways."""
    for number in numbers:
        chosen = case(seed, number)
        result, why = outcome(chosen)
        yield Result(number, chosen.way, result, f"{chosen}: {why.strip()}")


if __name__ == "__main__":
    given = arguments(__doc__, 200)
    sys.exit(bool(report(results(given.seed, given.numbers), given)))
