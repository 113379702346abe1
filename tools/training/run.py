"""Train one network: examples on the disk, steps of gradient descent that can be interrupted, a
file.

Everything follows from the sources, the pattern and the seed: the examples, the order in which they
are seen, and the first weights. An interrupted run goes on at its last checkpoint and ends with the
weights of one that was not interrupted, on the same machine with the same number of threads.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ...offline.stages.colour_network import BASIS, MARGIN, REACH, SURROUNDINGS, WEIGHTS, Contrast
from ...shared import CfaPattern, FloatArray, InputError
from ...shared.networks import Block, network_file, network_for
from ...shared.pattern import PANCHROMATIC
from ..batch.progress import StageProgress
from .examples import DRAWN, PAGE, Examples, claim, make_example, make_examples, read_example
from .graph import Turn, load_weights, save_graph
from .network import Descent, Network, begin_with, losses, share_left, units

Example = list[Any]
"""Tensors of what `prepare` returns."""
# of the measures in the loss: robust, energy, wrong hue, luminance
_SHARES = (1.0, 0.75, 1.0, 1.0)
_REPORT = 200  # steps between two checkpoints
_JUDGED = 12  # batches of the sources kept back
_MEASURED = 64  # examples that show how large the values in a network are


@dataclass(frozen=True)
class Plan:
    """Plan of a training: data and steps.

    Attributes
    ----------
    sources : tuple[str, ...]
        Files of photographs.
    pattern : CfaPattern
        Of the blocks, wherever they begin. It is square; the network serves its mirror images too.
    steps : int
        Of gradient descent; 0 = keep the weights of `start`, and measure `network.units` alone.
    batch : int
        Examples in each.
    variants : int
        Examples made of each source; a page of print is added for every two photographs, and a
        drawing for every four.
    patch : int
        Superpixels per side of what is learned from at a time, without surroundings.
    seed : int
        Of everything random.
    start : CfaPattern | None
        A pattern with a network in `offline/models`; training begins with its weights (see
        `weights_for`) and in half as large steps. None = with random ones.
    """

    sources: tuple[str, ...]
    pattern: CfaPattern
    steps: int
    batch: int = 16
    variants: int = 4
    patch: int = 24
    seed: int = 0
    start: CfaPattern | None = None

    @property
    def transposed(self) -> list[int]:
        """Order of the sites of the mirrored block when it is transposed, which exchanges the
        greens of RGGB.

        Empty if it is another block then.
        """
        letters = np.array([list(row) for row in Block.of(self.pattern).letters])
        if not np.array_equal(letters, letters.T):
            return []
        numbers = (letters != PANCHROMATIC).cumsum().reshape(letters.shape) - 1
        return numbers.T[letters != PANCHROMATIC].tolist()

    @property
    def exchanged(self) -> bool:
        """True if a superpixel is the same after half a turn and with red and blue in exchange; its
        sites are then in reverse order.
        """
        letters, period = Block.of(self.pattern).letters, self.pattern.period
        turned = tuple(row[::-1].translate(str.maketrans("RB", "BR")) for row in letters[::-1])
        return letters == turned and (period - len(letters)) % 2 == 0


def train(plan: Plan, folder: Path, jobs: int, progress: StageProgress) -> Path:
    """Train the network of one pattern, or go on with it; returns the path of its file in `folder`.

    Parameters
    ----------
    folder : Path
        For examples, checkpoints and result; it exists.
    jobs : int
        Processes that make examples, and threads that compute.
    progress : StageProgress
        Its remarks are the losses.

    Raises
    ------
    InputError
        When `folder` holds another training of this pattern.
    """
    path, count = folder / network_file(plan.pattern), len(plan.sources)
    work = path.with_suffix("")
    names = [Path(source).name for source in plan.sources]
    claim(work, asdict(plan) | {"sources": names}, "settings")
    make, period = partial(make_example, pattern=plan.pattern), plan.pattern.period
    seeds = [(plan.seed, period, variant) for variant in range(plan.variants)]
    sources = [*plan.sources, *[PAGE] * -(-count // 2), *[DRAWN] * -(-count // 4)]
    examples = make_examples(make, sources, seeds, work, jobs, progress)
    network, learned = _learn(plan, work, examples, jobs, progress), examples[0]
    chosen = learned[:: -(-len(learned) // _MEASURED)]
    sampled = [_read(path, plan, "cpu", progress) for path in chosen]
    batches = (_batch(sampled, plan, (plan.seed, 2, number)) for number in range(_JUDGED))
    steps = units(network, batches)
    weights = {name: weight.numpy() for name, weight in network.state_dict().items()}
    # The second look is from the farthest of the orientations in which superpixels are the same.
    turn = turned(plan, transposed=bool(plan.transposed), exchanged=plan.exchanged)
    save_graph(weights, steps, path, turn)
    return path


def turned(plan: Plan, *, transposed: bool, exchanged: bool) -> Turn:
    """An orientation of a picture in which its superpixels are the same: rows become columns, or
    half a turn with red and blue in exchange, or both, or neither.
    """
    period, sites = plan.pattern.period, len(plan.pattern.sites)
    pixels, order = np.arange(period**2).reshape(period, period), list(range(sites))
    colour: FloatArray = np.eye(len(BASIS), dtype=np.float32)
    if transposed:
        pixels, order = pixels.T, plan.transposed
    if exchanged:
        pixels, order, colour = pixels[::-1, ::-1], order[::-1], BASIS[:, ::-1] @ BASIS.T
    places = np.eye(period**2, dtype=np.float32)[pixels.ravel()]
    outputs = block_diag(np.kron(colour, places), np.eye(sites, dtype=np.float32)[order])
    rest = np.eye(SURROUNDINGS - len(BASIS), dtype=np.float32)
    inputs = block_diag(places, outputs, colour, rest)
    return Turn(inputs, outputs, transposed, exchanged)


def _learn(plan: Plan, work: Path, paths: Examples, jobs: int, progress: StageProgress) -> Network:
    """Gradient descent from the last checkpoint on; returns the network."""
    device = "cuda" if torch.cuda.is_available() else "cpu"
    torch.set_num_threads(jobs)
    torch.manual_seed(plan.seed)
    network = _beginning(plan).to(device=device, memory_format=torch.channels_last)
    factor = 0.5 if plan.start else 1.0
    descent = Descent(network, plan.steps, _REPORT, work / "checkpoint.pt", factor)
    if descent.done == plan.steps:
        return network.to("cpu")
    progress.stage("reading", sum(map(len, paths)))
    examples, judges = ([_read(path, plan, device, progress) for path in side] for side in paths)
    judged = [_batch(judges, plan, (plan.seed, 1, number)) for number in range(_JUDGED)]
    progress.stage("training", plan.steps)
    progress.advance(descent.done)
    for step in range(descent.done, plan.steps):
        batch = _batch(examples, plan, (plan.seed, 0, step))
        with torch.autocast(device, dtype=torch.bfloat16):
            left, before = losses(network, batch)
        loss = (share_left(left, before) * torch.tensor(_SHARES, device=device)).sum()
        progress.advance()
        if descent.follow(loss):
            robust, energy, hue, light = _judge(network, judged)
            progress.remark(
                f"step {step + 1}: left {robust:.4f} of the error, {energy:.4f} of its energy, "
                f"{hue:.4f} of wrong hues, {light:.4f} of luminance at sites"
            )
    return network.to("cpu")


def _beginning(plan: Plan) -> Network:
    """The network before the first step: of random weights, or of those of `start` and as wide."""
    period, sites = plan.pattern.period, len(plan.pattern.sites)
    if plan.start is None:
        return Network(period, sites)
    weights = weights_for(plan.pattern, plan.start)
    network = Network(period, sites, len(weights["enter.bias"]))
    begin_with(network, weights)
    return network


def weights_for(pattern: CfaPattern, known: CfaPattern) -> dict[str, FloatArray]:
    """Weights to begin with: those of the network for a known pattern, for pixels at the same
    places of a superpixel, and for its sites of the same colours, in their order and again.
    """
    path = network_for(known)
    if path is None:
        raise InputError(f"no network for {'/'.join(known.tile)} to begin with")
    weights, before = load_weights(path), known.period // 2 - pattern.period // 2
    along = (np.arange(pattern.period) + before).clip(0, known.period - 1)
    pixels = (along[:, None] * known.period + along).ravel()
    planes = known.period**2 * np.arange(3)[:, None]
    colours, numbers = _site_colours(known), list[int]()
    for place, colour in enumerate(wanted := _site_colours(pattern)):
        alike = [number for number, other in enumerate(colours) if other == colour]
        alike = alike or [place % len(colours)]  # such as green, of RCCB
        numbers.append(alike[wanted[:place].count(colour) % len(alike)])
    others = np.concatenate([numbers, len(colours) + np.arange(SURROUNDINGS)])
    inputs = np.concatenate([(planes + pixels).ravel(), 3 * known.period**2 + others])
    sites = 2 * known.period**2 + np.array(numbers)
    outputs = np.concatenate([(planes[:2] + pixels).ravel(), sites])
    return weights | {
        "enter.weight": weights["enter.weight"][:, inputs],
        "leave.weight": weights["leave.weight"][outputs],
        "leave.bias": weights["leave.bias"][outputs],
    }


def _site_colours(pattern: CfaPattern) -> str:
    """The letters of the mirrored block without panchromatic pixels, row by row."""
    return "".join(Block.of(pattern).letters).replace(PANCHROMATIC, "")


def prepare(pattern: CfaPattern, example: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """What the network sees of a picture and what it has to find, for all superpixels but the
    outermost `MARGIN`; all but the first two are in scene units.

    Parameters
    ----------
    example : Sequence[NDArray[Any]]
        What `examples.make_example` returns.

    Returns
    -------
    list[NDArray[Any]]
        `Contrast.inputs`; missing colour, and luminance at the sites, (2 K^2 + S, h, w); true
        luminance, (K^2, h, w); bound and variance, (1, h, w) each. The first three are float16.
    """
    *pictures, error, variance = example
    pixels, right = (_superpixels(planes, *variance.shape[1:]) for planes in pictures)
    contrast = Contrast.of(pixels, error.astype(np.float32), variance[0])
    right = right[..., MARGIN:-MARGIN, MARGIN:-MARGIN]
    light, *colour = right - contrast.pixels
    missing = np.concatenate([*colour, light[Block.of(pattern).sites(pattern.period)]])
    small = (contrast.inputs(), missing, right[0])
    large = contrast.bound, contrast.variance
    return [*(planes.astype(np.float16) for planes in small), *(plane[None] for plane in large)]


def _superpixels(planes: FloatArray, rows: int, columns: int) -> FloatArray:
    """Luminance and colour of the pixels of superpixels, (3, K^2, rows, columns)."""
    period = planes.shape[1] // rows
    parted = planes.astype(np.float32).reshape(3, rows, period, columns, period)
    pixels = parted.transpose(0, 2, 4, 1, 3).reshape(3, period**2, rows, columns)
    return np.tensordot(WEIGHTS, pixels, 1)


def _read(path: Path, plan: Plan, device: str, progress: StageProgress) -> Example:
    """An example, as tensors."""
    progress.advance()
    prepared = prepare(plan.pattern, read_example(path))
    return [torch.from_numpy(planes).to(device) for planes in prepared]


def _judge(network: Network, batches: Sequence[Example]) -> list[float]:
    """The share that is left of each measure in `losses`."""
    with torch.no_grad():
        measures = torch.stack([torch.stack(losses(network, batch)) for batch in batches])
    left, before = measures.sum(dim=(0, 3)).cpu().numpy()
    return (left / before).tolist()


def _batch(examples: Sequence[Example], plan: Plan, seed: tuple[int, ...]) -> Example:
    """Crops of random examples, each turned at random if its superpixels allow it."""
    random, side, period = np.random.default_rng(seed), plan.patch + 2 * REACH, plan.pattern.period
    large = [example for example in examples if min(example[-1].shape[1:]) >= side]
    if not large:
        needed = f"{(side + 2 * MARGIN) * period} pixels a side are needed"
        raise InputError(f"the pictures are too small to learn from: {needed}")
    windows: list[Example] = []
    for _ in range(plan.batch):
        example = large[random.integers(len(large))]
        first = [int(random.integers(size - side + 1)) for size in example[-1].shape[1:]]
        down, across = (slice(start, start + side) for start in first)
        window = [planes[:, down, across].float() for planes in example]
        aside, over = (random.random(2) < 0.5).tolist()
        transposed, exchanged = aside and bool(plan.transposed), over and plan.exchanged
        turn = turned(plan, transposed=transposed, exchanged=exchanged)
        windows.append(turn_window(window, turn))
    return [torch.stack(planes) for planes in zip(*windows, strict=True)]


def turn_window(window: Example, turn: Turn) -> Example:
    """An example in another orientation."""
    pixels = len(window[2])
    matrices = turn.inputs, turn.outputs, turn.inputs[:pixels, :pixels]
    pairs = zip(matrices, window[:3], strict=True)
    planes = [torch.tensordot(torch.from_numpy(matrix).to(of), of, 1) for matrix, of in pairs]
    planes += window[3:]
    planes = [values.transpose(1, 2) for values in planes] if turn.transposed else planes
    return [values.flip(1, 2) for values in planes] if turn.back else planes
