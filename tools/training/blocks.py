"""Learn the chromaticity of blocks, `offline.stages.block_network`.

    python -m panchroma.tools.training.blocks FOLDER... -o DIR

Photographs, drawings and pages of print are simulated with several patterns, white balances and
kinds of noise, some over-exposed, some with defects, some as the reference of a burst. From the
planes of each block the network foretells the mean colour at its sites, and that of the pixels
around by their luminance. A training that was
interrupted goes on where it stopped.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from google.protobuf.message import DecodeError
from torch import nn
from torch.nn import functional

from ...offline import BEST, clean_frame
from ...offline.frame import Sites
from ...offline.stages import block_network
from ...offline.stages.block_network import CHOICES, LINES, NEAR, PLANES, PROPOSALS, STEP, UNIT
from ...offline.stages.chromaticity import block_sums
from ...offline.stages.colour_network import BASIS
from ...offline.stages.denoising import denoise_luminance
from ...offline.stages.luminance import recover_luminance
from ...offline.stages.propagation import BEYOND, DIMMEST
from ...shared import CfaPattern, DoubleArray, FloatArray, IndexArray, NoiseModel, SensorCalibration
from ...shared.errors import InputError, PanchromaError
from ...shared.progress import SILENT
from ..batch.console import Console
from ..batch.jobs import output_folder
from ..batch.progress import StageProgress
from ..simulation.sensor import TYPICAL_READ, TYPICAL_SHOT, simulate_additive, simulate_sensor
from .__main__ import training_parser
from .drawings import with_lamps
from .examples import DRAWN, PAGE, Examples, claim, make_examples, photographs, pictured
from .graph import Graph, convolved, load_weights, rounded
from .network import Descent, begin_with, read_tensors

WIDTHS = 48, 64, 96, 128
"""Channels on the grid of blocks, and on grids of every second, fourth and eighth block."""
_BATCH, _SIDE = 16, 32  # crops in a step, and blocks along the side of one
_NEEDED = f"{_SIDE * 8} pixels a side are enough for every pattern"
_REPORT, _JUDGED = 400, 12  # steps between two checkpoints; batches of sources kept back
_SEEN = 40  # examples that tell how values inside are spread
_EXACT = "enter", "leave"  # not rounded: half of the error, a tenth of the time
# of the usual length of a step, and steps up to the largest one: longer ones diverge
_FACTOR, _WARM_UP = 0.3, 200
_LEAK = 0.1  # slope of what is below zero: with 0, nine of ten features died
# what the weights of proposals begin with: of the block itself, of blocks beside it, of blocks that
# are alike; 0 of the others
_OWN, _BESIDE, _ALIKE = 1.0, -2.0, 2.0
# pattern -> how often it is drawn
_PATTERNS = {"K=6": 7, "K=4": 2, "K=5": 1, "K=8": 1, "RGWW/BWWW/WWWW/WWWW": 1, "kodak": 1}
# how often a shot is one with additive noise, of a real sensor, the reference of a burst, and with
# defects that nobody listed
_SHOTS = {"additive": 0.65, "sensor": 0.2, "burst": 0.1, "defects": 0.05}
_CLEAN, _SIGMAS = 0.3, (0.003, 0.06)  # share without noise, and its range otherwise
_DARK, _STOPS = 0.25, 3.0  # share of scenes that are darkened, and how far at most
_NIGHT = 0.12  # share of scenes that are nights with lamps
_BALANCED, _GAMMA = 0.3, 0.25  # share with other weights of Eq. 7, standard deviation of their logs
_EXPOSURES = (-2.0, 1.7)  # stops, of a real sensor
_NOISIER = (-0.7, 1.3)  # its noise relative to a typical one, powers of ten
_OTHERS = 7  # frames of a burst at most
_DEFECTS = 3e-4  # share of samples
# squares, in units of the mean light, of errors that hardly count, of a crop and of a block; and
# light that is dark
_FAINT, _FAINTEST, _DIM = 5e-5, 2e-6, 0.01


def lit(values: Any) -> Any:
    """Make small what is below zero."""
    return functional.leaky_relu(values, _LEAK)


class BlockNetwork(nn.Module):  # type: ignore[misc]
    """A U-Net: pairs of convolutions on grids of blocks, each half as fine as the one before, and
    back.
    """

    def __init__(self) -> None:
        super().__init__()

        def wide(inputs: int, outputs: int) -> nn.Conv2d:
            return nn.Conv2d(inputs, outputs, 3, padding=1, padding_mode="replicate")

        self.enter = wide(PLANES, WIDTHS[0])
        for level, (fine, coarse) in enumerate(pairwise(WIDTHS)):
            self.add_module(f"halve{level}", nn.Conv2d(fine, coarse, 2, 2))
            self.add_module(f"spread{level}", nn.Conv2d(coarse, fine, 1))
        for level, width in enumerate(WIDTHS):
            for side in ("down", "up"):
                self.add_module(f"{side}{level}a", wide(width, width))
                self.add_module(f"{side}{level}b", wide(width, width))
        self.leave = wide(WIDTHS[0], 4 + CHOICES)
        for name, layer in self.named_children():
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)
            if name.endswith("b") or name == "leave":  # at first, a pair changes nothing
                nn.init.zeros_(layer.weight)
        with torch.no_grad():
            self.leave.bias[4 : 4 + len(NEAR)] = _BESIDE
            self.leave.bias[4 + len(NEAR) // 2] = _OWN
            self.leave.bias[-1 - len(LINES)] = _ALIKE

    def forward(self, planes: Any) -> Any:
        """(N, PLANES, h, w), h and w multiples of `STEP` -> (N, 4 + CHOICES, h, w)."""

        def convolve(name: str, values: Any) -> Any:
            return self.get_submodule(name)(values)

        def double(_: str, values: Any) -> Any:
            return functional.interpolate(values, scale_factor=2, mode="nearest")

        def add(_: str, one: Any, other: Any) -> Any:
            return one + other

        return u_net(planes, convolve, lit, double, add)


def u_net(
    values: Any,
    convolve: Callable[[str, Any], Any],
    lit: Callable[[Any], Any],
    double: Callable[[str, Any], Any],
    add: Callable[[str, Any, Any], Any],
) -> Any:
    """The answer to the planes of blocks, from operations on tensors, or on the names of values of
    a graph.

    Parameters
    ----------
    convolve, double, add : Callable
        Their first argument is the name of a layer or of a result.
    """

    def pair(name: str, values: Any) -> Any:
        return add(name, values, convolve(f"{name}b", lit(convolve(f"{name}a", values))))

    levels, values, finer = len(WIDTHS) - 1, lit(convolve("enter", values)), []
    for level in range(levels):
        finer.append(pair(f"down{level}", values))
        values = lit(convolve(f"halve{level}", finer[-1]))
    values = pair(f"up{levels}", pair(f"down{levels}", values))
    for level in reversed(range(levels)):
        spread = double(f"spread{level}", convolve(f"spread{level}", values))
        values = pair(f"up{level}", add(f"spread{level}.sum", finer[level], spread))
    return convolve("leave", values)


def lines(planes: Any, answer: Any) -> tuple[Any, Any]:
    """Chromaticities times gamma and slopes, (N, 3, h, w) each, as
    `offline.stages.block_network.mixed` has them.
    """
    weights = torch.softmax(answer[:, 4:], 1)[:, :, None]
    triples = planes[:, -3 * (len(LINES) + PROPOSALS) :].unflatten(1, (-1, 3))
    slopes, (own, *others) = triples[:, : len(LINES)], triples[:, len(LINES) :].unbind(1)
    wide, (rows, columns) = functional.pad(own, (1, 1, 1, 1), mode="replicate"), own.shape[2:]
    beside = [wide[..., down : down + rows, across : across + columns] for down, across in NEAR]
    basis = UNIT * torch.from_numpy(BASIS).to(answer)
    pairs = answer[:, :2], answer[:, 2:4]
    odd, slope = (torch.einsum("nkyx,ki->niyx", pair, basis) for pair in pairs)
    odd = odd + (weights * torch.stack([*beside, *others], 1)).sum(1)
    slope = slope + (weights[:, -len(LINES) :] * slopes).sum(1)
    return (1 + odd - odd.mean(1, keepdim=True)) / 3, (slope - slope.mean(1, keepdim=True)) / 3


def losses(found: Any, slope: Any, truth: Any) -> Any:
    """Measures of the error of colour in each crop, (6, N): three at the sites of blocks, and three
    at all pixels around them.

    The three are the logarithm of the energy; the mean logarithm of that of blocks, so that even
    places count; and the logarithm of the mean size relative to light, so that dark colour counts.
    At a pixel of luminance l the colour is l (t + s h), with the components t of chromaticity and s
    of its slope, and h = 1 - x / m for a block of luminance x, with l, or what counts for it beyond
    an end of the line, m. With the means <.> around the block, the energy of its error is

        t^2 <l^2> + 2 t s <l^2 h> + s^2 <l^2 h^2> - 2 t <l p> - 2 s <l h p> + <p^2>,

    summed over the components.

    Parameters
    ----------
    found, slope : Any
        What `lines` returns.
    truth : Any
        What `example` returns.
    """
    colour, lit_mean, along = truth[:, :3], truth[:, 3:6], truth[:, 6:9]
    first, second, tilted, square, power = truth[:, 9:].unsqueeze(2).unbind(1)
    light = colour.sum(1, keepdim=True)
    at_sites = (light * found - colour).square().sum(1)
    basis = torch.from_numpy(BASIS).to(found)
    triples = found, slope, lit_mean, along
    t, s, lp, lhp = (torch.einsum("niyx,ki->nkyx", planes, basis) for planes in triples)
    around = t * t * second + 2 * t * s * tilted + s * s * square - 2 * t * lp - 2 * s * lhp
    around = (around.sum(1) + power[:, 0]).clamp_min(0)
    return torch.cat([_measures(at_sites, light[:, 0]), _measures(around, first[:, 0])])


def _measures(square: Any, light: Any) -> Any:
    """The three measures of squared errors of blocks, (N, h, w), in light that is as bright."""
    relative = square / (light + _DIM).square()
    energy = (square + _FAINT).mean((1, 2)).log()
    even = (square + _FAINTEST).log().mean((1, 2))
    return torch.stack([energy, even, (relative + _FAINT).sqrt().mean((1, 2)).log()])


def example(source: str, seed: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Planes of the blocks of a picture, float16 (PLANES, rows, columns), and their colours,
    float32 (14, rows, columns), in units of the mean light. The same arguments give the same bytes.

    The colours, with c = (R, G, B) times gamma, l the luminance that the render finds, p the
    components of c in `BASIS`, h as in `losses`, and the mean <.> of the pixels around a block,
    which count the less the farther they are, up to K pixels down and across: c at the sites,
    <l c>, <l h c>, <l>, <l^2>, <l^2 h>, <l^2 h^2> and <p^2>.
    """
    random = np.random.default_rng(seed)
    scene = pictured(source, random)
    if random.random() < _NIGHT:
        scene = with_lamps(scene, random)
    elif random.random() < _DARK:
        scene = scene * np.float32(2 ** -random.uniform(0, _STOPS))
    odds = np.array(list(_PATTERNS.values())) / sum(_PATTERNS.values())
    pattern = CfaPattern.of_letters(str(random.choice(list(_PATTERNS), p=odds)))
    down, across = random.integers(pattern.period, size=2).tolist()
    pattern, gamma = replace(pattern, origin=(down, across)), np.ones(3)
    if random.random() < _BALANCED:
        gamma = np.exp(random.normal(0, _GAMMA, 3))
        gamma *= 3 / gamma.sum()
    scene = (scene / gamma).astype(np.float32)
    camera = SensorCalibration(gamma=tuple(gamma.tolist()))
    sigma = 0.0 if random.random() < _CLEAN else float(np.exp(random.uniform(*np.log(_SIGMAS))))
    kind = str(random.choice(list(_SHOTS), p=list(_SHOTS.values())))
    if kind == "sensor":
        noisier, exposure = 10 ** random.uniform(*_NOISIER), 2 ** random.uniform(*_EXPOSURES)
        noise = NoiseModel((TYPICAL_SHOT * noisier,) * 4, (TYPICAL_READ * noisier,) * 4)
        mosaic = simulate_sensor(scene, pattern, replace(camera, noise=noise), exposure, random)
        scene = scene * np.float32(exposure)
    else:
        mosaic = simulate_additive(scene, pattern, camera, sigma, random)
    if kind == "defects":
        samples = mosaic.signal.copy()
        wrong = random.random(samples.shape) < _DEFECTS
        samples[wrong] = random.uniform(0, 3, np.count_nonzero(wrong))
        mosaic = replace(mosaic, samples=samples)
    frame = clean_frame(mosaic)
    filled = recover_luminance(frame.mosaic, BEST.luminance)
    luminance, others = denoise_luminance(filled, frame.mosaic, BEST.denoising), None
    for _ in range(int(random.integers(1, _OTHERS)) if kind == "burst" else 0):
        shot = clean_frame(simulate_additive(scene, pattern, camera, sigma, random))
        sums = block_sums(replace(shot, luminance=luminance))
        others = sums if others is None else others + sums
    frame = replace(frame, luminance=luminance, others=others)
    alike = block_network.alike_blocks(frame, BEST.chromaticity, BEST.pooling, SILENT)
    planes, filled = block_network.block_planes(frame, alike)
    sites = Sites.in_frame(mosaic)
    colour = np.moveaxis(scene * (gamma / frame.level), 2, 0)
    at_sites = np.stack([sites.of(plane).mean(axis=2) for plane in colour])
    power = np.square(np.tensordot(BASIS, colour, 1)).sum(axis=0)
    around, level = _Around.of(sites, mosaic.shape), np.float32(frame.level)
    # not the true luminance: a slope must not make colour of its errors
    pixels, x = around.pixels(luminance), filled[:, None, :, None]
    known = pixels.clip(*(end[:, None, :, None] for end in block_network.line_ends(frame)))
    known += BEYOND * (pixels - known)
    lit, tilted = pixels / level, pixels / level * (1 - x / np.maximum(known, DIMMEST * level))
    colours = [around.pixels(plane) for plane in colour]
    of_colour = [factor * plane for factor in (lit, tilted) for plane in colours]
    of_light = lit, lit**2, lit * tilted, tilted**2, around.pixels(power)
    means = map(around.mean, (*of_colour, *of_light))
    return planes.astype(np.float16), np.array([*at_sites, *means], np.float32)


class _Around(NamedTuple):
    """The pixels around each block, up to K down and across: rows and columns, and how far each
    counts, (block rows, 2 K) and (block columns, 2 K) each; those of a block sum to 1.
    """

    places: list[IndexArray]
    shares: list[DoubleArray]

    @classmethod
    def of(cls, sites: Sites, shape: tuple[int, int]) -> "_Around":
        """Those of the whole blocks of a frame."""
        places, shares, period = [], [], sites.grid.period
        for middle, count, size in zip(sites.middle, sites.shape, shape, strict=True):
            middles = middle + period * np.arange(count)[:, None]
            there = np.floor(middles).astype(int) + np.arange(1 - period, period + 1)
            near = np.maximum(1 - np.abs(there - middles) / period, 0)
            near[(there < 0) | (there >= size)] = 0
            places.append(there.clip(0, size - 1))
            shares.append(near / near.sum(axis=1, keepdims=True))
        return cls(places, shares)

    def pixels(self, plane: FloatArray) -> FloatArray:
        """Those of a plane, (block rows, 2 K, block columns, 2 K)."""
        down, across = self.places
        return plane[down[:, :, None, None], across]

    def mean(self, pixels: FloatArray | DoubleArray) -> DoubleArray:
        """The mean of such pixels for each block."""
        return np.einsum("jokp,jo,kp->jk", pixels, *self.shares)


def _batch(examples: Sequence[list[Any]], seed: tuple[int, ...]) -> tuple[Any, Any]:
    """Crops of random examples, turned and mirrored, some with red and blue in exchange."""
    random, crops = np.random.default_rng(seed), list[list[Any]]()
    for _ in range(_BATCH):
        pair = examples[int(random.integers(len(examples)))]
        down, across = (int(random.integers(size - _SIDE + 1)) for size in pair[1].shape[1:])
        pair = [plane[:, down : down + _SIDE, across : across + _SIDE] for plane in pair]
        pair = [plane.transpose(1, 2) for plane in pair] if random.random() < 0.5 else pair
        flipped = [axis for axis in (1, 2) if random.random() < 0.5]
        pair = [plane.flip(flipped) for plane in pair]
        if random.random() < 0.5:
            pair = [pair[0][_EXCHANGED], pair[1][[2, 1, 0, 5, 4, 3, 8, 7, 6, *range(9, 14)]]]
        crops.append(pair)
    planes, truth = (torch.stack(arrays).float() for arrays in zip(*crops, strict=True))
    return planes.contiguous(memory_format=torch.channels_last), truth


def _exchanged() -> list[int]:
    """The order of the planes of a block with red and blue in exchange."""
    order = list(range(PLANES))
    for first in (0, 4, 7, 13, *range(PLANES - 3 * (len(LINES) + PROPOSALS), PLANES, 3)):
        order[first], order[first + 2] = first + 2, first
    return order


_EXCHANGED = _exchanged()


def first_network(start: Path | None = None) -> BlockNetwork:
    """The network before the first step: of random weights, or of those in a file of `save`.

    Raises
    ------
    InputError
        If the file is not such a network.
    """
    torch.manual_seed(0)
    network = BlockNetwork().to(memory_format=torch.channels_last)
    if start is not None:
        try:
            begin_with(network, load_weights(start))
        except (OSError, RuntimeError, DecodeError) as error:
            raise InputError(f"{start}: no network of blocks: name a blocks.onnx") from error
    return network


def learn(
    network: BlockNetwork, sides: Examples, steps: int, work: Path, progress: StageProgress
) -> BlockNetwork:
    """The network after gradient descent, from the last checkpoint in `work` on.

    Parameters
    ----------
    network : BlockNetwork
        What `first_network` returns.
    sides : Examples
        Files of examples to learn from, and of those kept back.
    """
    descent = Descent(network, steps, _REPORT, work / "checkpoint.pt", _FACTOR, _WARM_UP)
    if descent.done == steps:
        return network
    progress.stage("reading", 1)
    read = (map(read_tensors, paths) for paths in sides)
    learned, kept = ([pair for pair in pairs if min(pair[1].shape[1:]) >= _SIDE] for pairs in read)
    if not (learned and kept):
        raise InputError(f"the pictures are too small to learn from: {_NEEDED}")
    judged = [_batch(kept, (1, number)) for number in range(_JUDGED)]
    progress.stage("training", steps)
    progress.advance(descent.done)
    for step in range(descent.done, steps):
        planes, truth = _batch(learned, (0, step))
        with torch.autocast("cpu", torch.bfloat16):
            answer = network(planes)
        loss = losses(*lines(planes, answer.float()), truth).sum(0).mean()
        progress.advance()
        if descent.follow(loss):
            with torch.no_grad():
                left = [losses(*lines(x, network(x)), y).mean(1) for x, y in judged]
            decibels = torch.stack(left).mean(0) * (10 / np.log(10))
            figures = ", ".join(f"{figure:.2f}" for figure in decibels.tolist())
            progress.remark(f"step {step + 1}: {figures} dB")
    return network


def save(network: BlockNetwork, path: Path, examples: Sequence[Path]) -> None:
    """Write the network to an ONNX file, which computes all but the first and the last convolution
    with integers of 8 bits, in half the time. They pad with zeros, unlike in training: chunks of a
    render overlap so far that none shows, and at the border of the frame blocks are repeated.

    Parameters
    ----------
    examples : Sequence[Path]
        Files whose planes tell between which values those inside the network are.
    """
    steps = _steps(network, examples)
    weights = {name: weight.numpy() for name, weight in network.state_dict().items()}
    graph = Graph()
    graph.store_weights(weights)
    twice = graph.store("twice", np.array([1, 1, 2, 2], np.float32))
    # by the size of a kernel
    attributes = {1: {}, 2: {"strides": [2, 2]}, 3: {"pads": [1, 1, 1, 1]}}

    def convolve(name: str, values: str) -> str:
        weight = weights[f"{name}.weight"]
        placed = attributes[len(weight[0, 0])]
        if name in _EXACT:
            inputs = [values, f"{name}.weight", f"{name}.bias"]
            return graph.add("Conv", inputs, f"{name}.found", **placed)
        before, after = steps[name]
        values = rounded(graph, values, *before)
        found = convolved(graph, name, values, weight, float(before[0]), **placed)
        return rounded(graph, found, *after)

    def kept(values: str) -> str:
        return graph.add("LeakyRelu", [values], f"{values}.lit", alpha=_LEAK)

    def double(name: str, values: str) -> str:
        nearest = {"mode": "nearest", "nearest_mode": "floor"}
        nearest["coordinate_transformation_mode"] = "asymmetric"
        return graph.add("Resize", [values, "", twice], f"{name}.fine", **nearest)

    def add(name: str, one: str, other: str) -> str:
        return graph.add("Add", [one, other], name)

    answer = u_net("planes", convolve, kept, double, add)
    shape = ["rows", "columns"]
    graph.write(path, ("planes", [1, PLANES, *shape]), (answer, [1, 4 + CHOICES, *shape]))


def _steps(
    network: BlockNetwork, examples: Sequence[Path]
) -> dict[str, list[tuple[np.float32, np.uint8]]]:
    """The length of the steps of 8 bits, and the step that is 0, of what goes into each convolution
    and of what comes of it.
    """
    spans = defaultdict[str, list[tuple[float, float]]](lambda: [(0.0, 0.0)] * 2)

    def note(name: str, _: nn.Module, inputs: tuple[Any], output: Any) -> None:
        spans[name] = [
            (min(low, float(values.min())), max(high, float(values.max())))
            for (low, high), values in zip(spans[name], (*inputs, output), strict=True)
        ]

    layers = network.named_children()
    hooks = [layer.register_forward_hook(partial(note, name)) for name, layer in layers]
    with torch.no_grad():
        for path in examples:
            planes = read_tensors(path)[0].float()
            rows, columns = (size // STEP * STEP for size in planes.shape[1:])
            if rows and columns:
                network(planes[None, :, :rows, :columns])
    for hook in hooks:
        hook.remove()
    return {name: [_step(*span) for span in of_layer] for name, of_layer in spans.items()}


def _step(low: float, high: float) -> tuple[np.float32, np.uint8]:
    length = (high - low) / 255 or 1.0
    return np.float32(length), np.uint8(round(-low / length))


def main() -> int:
    """Learn, and write the file; returns the exit code."""
    parser = training_parser(".blocks", __doc__.partition("\n\n")[0], 12000)
    output = f"for {block_network.PATH.name}, the examples and the checkpoint"
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help=output)
    parser.add_argument("--start", type=Path, help="network to begin with, blocks.onnx")
    parser.add_argument("--seed", type=int, default=0, help="first variant (default: 0)")
    arguments, console = parser.parse_args(), Console()
    try:
        files, steps, seed = photographs(arguments.folders), arguments.steps, arguments.seed
        sources = [*files, *[PAGE] * len(files), *[DRAWN] * (-(-len(files) // 4))]
        path = output_folder(arguments.output) / block_network.PATH.name
        work, names = path.with_suffix(""), [Path(source).name for source in sources]
        claim(work, {"sources": names, "steps": steps, "seed": seed}, "steps, seed")
        torch.set_num_threads(arguments.jobs)
        is_begun = (work / "checkpoint.pt").exists()  # it has weights of its own
        first = first_network(None if is_begun else arguments.start)
        with console.progress("blocks") as progress:
            seeds = [(seed + variant,) for variant in range(arguments.variants)]
            paths = make_examples(example, sources, seeds, work, arguments.jobs, progress)
            network = learn(first, paths, steps, work, progress)
        save(network, path, paths[0][:: -(-len(paths[0]) // _SEEN)])
        console.say(str(path))
    except PanchromaError as error:
        parser.error(str(error))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
