"""Learn what corrects filled luminance, `offline.stages.luminance_network`.

    python -m panchroma.tools.training.luminance FOLDER... -o FILE

Photographs, drawings and pages of print are simulated with tiles of several K, without and with
noise, and filled by wavelets. From the pixels around each block the network foretells what its
sites are off by. The same command with as many threads gives the same weights.
"""

from collections.abc import Callable
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from ...offline.settings import UNLEARNED
from ...offline.stages.luminance import recover_luminance
from ...offline.stages.luminance_network import REACH, SIDE, network_inputs
from ...shared import CfaPattern
from ...shared.arrays import BORDER, FloatArray
from ..batch.console import Console
from .__main__ import training_parser
from .examples import DRAWN, PAGE, in_processes, kept_back, photographed, photographs
from .graph import Graph
from .network import Descent

_HIDDEN = 256, 128, 128, 128
_BLOCKS, _BATCH = 6000, 2048  # taken of a picture; and learned from at a time
_BLOCK = {4: ("RG", "GB"), 3: ("RG", "BW")}  # number of sites -> a block of 2 x 2 pixels
_PERIODS = {4: (4, 6, 6, 8), 3: (4, 4, 5, 6)}  # K, drawn
_CLEAN = 0.4  # share without noise
_CLEAR = 3.0  # standard deviations of the noise: least contrast of the blocks that are learned from
_FAINT = 0.1  # scene units: below this light contrast counts less
_ENERGY = 2.0  # weight of the energy of errors beside their size
_REPORT = 1000  # steps between two reports

Example = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def examples(source: str, number: int, sites: int = 4) -> Example:
    """Inputs around some blocks of a picture, errors of their sites in its units, these units, and
    the luminance there.

    Parameters
    ----------
    sites : int, optional
        Of a block, 3 or 4.
    """
    random = np.random.default_rng((0, number))
    patterns = [CfaPattern.with_block(_BLOCK[sites], period) for period in _PERIODS[sites]]
    scene, mosaic = photographed(source, patterns, _CLEAN, random)
    filled, grid = recover_luminance(mosaic, UNLEARNED.luminance), mosaic.pattern.grid(mosaic.shape)
    rows, columns = grid.whole_rows, grid.whole_columns
    padded, noise = np.pad(filled, REACH, mode=BORDER), mosaic.calibration.noise
    queries, inputs, units = network_inputs(padded, (rows, columns), noise)
    missing = scene.sum(axis=2) - filled
    off = [missing[np.ix_(rows + y, columns + x)].ravel() for y, x, _ in mosaic.pattern.sites]
    clear = np.flatnonzero(inputs[:, -1] < np.float32(np.log2(1 + 1 / _CLEAR)))
    chosen = random.permutation(clear)[:_BLOCKS]
    inputs, units, queries = inputs[chosen], units[chosen], queries[chosen]
    errors = (np.array(off)[:, queries].T / units).astype(np.float32)
    light = filled[np.ix_(rows, columns)].reshape(-1, 1)
    return inputs.astype(np.float16), errors, units, light[queries]


def learn(
    pictures: list[Example], sources: list[str], steps: int, say: Callable[[str], None]
) -> nn.Sequential:
    """The network.

    Parameters
    ----------
    pictures : list[Example]
        What `examples` returns of each source; a picture that is given twice is learned from twice.
    """
    torch.manual_seed(0)
    sides = list(zip(pictures, kept_back(sources), strict=True))
    learned, kept = ([picture for picture, side in sides if side == back] for back in (False, True))
    joined = map(np.concatenate, zip(*learned, strict=True))
    inputs, off, units, light = map(torch.from_numpy, joined)
    weight = (units / (light.clamp_min(0) + _FAINT)).clamp(max=1)
    sizes = SIDE**2 + 1, *_HIDDEN
    layers = [layer for pair in pairwise(sizes) for layer in (nn.Linear(*pair), nn.ReLU())]
    network = nn.Sequential(*layers, nn.Linear(sizes[-1], off.shape[1]))
    descent = Descent(network, steps, _REPORT, norm=np.inf)
    # Three sites stay the first three of a block when it is transposed alone.
    turned = [
        (_turned(SIDE, turns, flip), places[: off.shape[1]])
        for turns, flip in product(range(4), (False, True))
        if (places := _turned(2, turns, flip))[off.shape[1] :].tolist() in ([], [3])
    ]
    order = np.random.default_rng(0)
    for step in range(steps):
        chosen = torch.from_numpy(order.integers(len(inputs), size=_BATCH))
        pixels, sites = turned[order.integers(len(turned))]
        around = inputs[chosen].float()
        turned_around = torch.cat([around[:, pixels], around[:, -1:]], dim=1)
        error = network(turned_around) - off[chosen][:, sites]
        energy = error.square().mean(dim=1, keepdim=True)
        loss = (weight[chosen] * ((energy + 1e-4).sqrt() + _ENERGY * energy)).mean()
        if descent.follow(loss):
            left = f"left {_left(network, kept):.3f} of the energy of errors"
            say(f"step {step + 1}: {left} of pictures kept back")
    return network


def _turned(side: int, turns: int, flip: bool) -> Any:
    """Source pixel of each place of a square that is turned, and transposed if `flip`."""
    places = np.rot90(np.arange(side**2).reshape(side, side), turns)
    return torch.from_numpy((places.T if flip else places).ravel().copy())


def _left(network: nn.Sequential, kept: list[Example]) -> float:
    left, before = 0.0, 1e-30
    with torch.no_grad():
        for inputs, off, units, _ in kept:
            error = off - network(torch.from_numpy(inputs).float()).numpy()
            left += float(np.square(error * units).sum())
            before += float(np.square(off * units).sum())
    return left / before


def save(network: nn.Sequential, path: Path) -> None:
    """Write the network to an ONNX file."""
    graph, values = Graph(), "seen"
    layers = [layer for layer in network if isinstance(layer, nn.Linear)]
    for number, layer in enumerate(layers):
        for kind in ("weight", "bias"):
            graph.store(f"{kind}{number}", getattr(layer, kind).detach().numpy())
        output = "off" if layer is layers[-1] else f"found{number}"
        graph.add("Gemm", [values, f"weight{number}", f"bias{number}"], output, transB=1)
        if layer is not layers[-1]:
            values = graph.add("Relu", [output], f"lit{number}")
    outputs = layers[-1].out_features
    graph.write(path, ("seen", ["blocks", SIDE**2 + 1]), ("off", ["blocks", outputs]))


def main() -> int:
    """Learn, and write the file; returns the exit code."""
    parser = training_parser(".luminance", __doc__.partition("\n\n")[0], 60000)
    output = "the network, FILE.onnx"
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FILE", help=output)
    sites = "of a block of 2 x 2 pixels (default: 4)"
    parser.add_argument("--sites", type=int, default=4, choices=sorted(_BLOCK), help=sites)
    arguments, console = parser.parse_args(), Console()
    files = sorted(photographs(arguments.folders))
    few = len(files) // 5
    sources = [*files, *[DRAWN] * few, *[PAGE] * few] * arguments.variants
    torch.set_num_threads(1)  # several wait for each other
    tasks = [(source, number, arguments.sites) for number, source in enumerate(sources)]
    with console.progress("luminance") as progress:
        pictures = in_processes(examples, tasks, arguments.jobs, progress)
    save(learn(pictures, sources, arguments.steps, console.say), arguments.output)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
