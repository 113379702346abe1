"""The network, in PyTorch: residual convolutions on the grid of superpixels, with inputs and output
in the units of `offline.stages.colour_network.Contrast`.

A network that works in units of brightness instead learns nothing, or harms flat places.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from ...offline.stages.colour_network import REACH, SURROUNDINGS
from ...shared.arrays import FloatArray
from ...shared.writing import durable_file
from .examples import read_example

CHANNELS, BLOCKS = 128, REACH - 1
"""Width, and number of residual blocks: a 3 x 3 convolution and a 1 x 1 one each."""
HUE, DARK = 0.06, 0.002
"""A hue is wrong if colour is off by more than this share of luminance (mean of the channels), and
this many scene units.
"""


# of gradient descent: largest step, steps up to it, weight decay
_RATE, _WARM_UP, _DECAY = 2e-3, 100, 1e-4
_BETAS = 0.9, 0.98  # of gradients, and of their squares, which vary much
_NORM = 1.0  # of the gradient: larger ones are cut
_FAINT = 1e-5  # error, scene units squared, that hardly counts: 50 dB
# one value in so many shows how they are spread: a prime number, to meet every channel
_SAMPLED = 7


class Network(nn.Module):  # type: ignore[misc]
    """Correction of two components of colour (`BASIS`) for every pixel of a superpixel, and of
    luminance for its sites.

    Parameters
    ----------
    period : int
        K.
    sites : int
        S, of a block. `forward` takes what `Contrast.inputs` returns.
    """

    def __init__(self, period: int, sites: int, channels: int = CHANNELS) -> None:
        super().__init__()
        pixels = period**2
        self.enter = nn.Conv2d(3 * pixels + sites + SURROUNDINGS, channels, 3)
        self.wide = nn.ModuleList(nn.Conv2d(channels, channels, 3) for _ in range(BLOCKS))
        self.deep = nn.ModuleList(nn.Conv2d(channels, channels, 1) for _ in range(BLOCKS))
        self.leave = nn.Conv2d(channels, 2 * pixels + sites, 1)
        nn.init.zeros_(self.leave.weight)
        nn.init.zeros_(self.leave.bias)

    def forward(self, inputs: Any) -> Any:
        """(N, 3 K^2 + S + SURROUNDINGS, h, w) -> (N, 2 K^2 + S, h - 2 BLOCKS - 2, w - 2 BLOCKS -
        2), in units of the bound.
        """
        values = self.enter(inputs)
        for block in range(BLOCKS):
            values = inner(values) + self.inside(block, values)[-1]
        return self.leave(functional.relu(values))

    def inside(self, block: int, values: Any) -> tuple[Any, Any, Any]:
        """Input of the 3 x 3 convolution of a block, input of the 1 x 1 one, and output of the
        block.
        """
        lit = functional.relu(values)
        deep = functional.relu(self.wide[block](lit))
        return lit, deep, self.deep[block](deep)


def read_tensors(path: Path) -> list[Any]:
    """Arrays of an example, as tensors."""
    return list(map(torch.from_numpy, read_example(path)))


def begin_with(network: nn.Module, weights: Mapping[str, FloatArray]) -> None:
    """Give a network the weights of another, by name, as `graph.load_weights` reads them."""
    network.load_state_dict({name: torch.from_numpy(values) for name, values in weights.items()})


def units(network: Network, batches: Iterable[Sequence[Any]]) -> dict[str, float]:
    """The steps in which values inside a network can be rounded to 8 bits with the least squared
    error.

    By name: "features", what goes in; "found", what comes of the first convolution; "wide.N" and
    "deep.N", what comes into a convolution of block N; "added.N", what the block adds.

    Parameters
    ----------
    batches : Iterable[Sequence[Any]]
        As for `losses`.
    """
    samples: dict[str, list[FloatArray]] = defaultdict(list)
    with torch.no_grad():
        for inputs, *_ in batches:
            values = {"features": inputs}
            output = values["found"] = network.enter(values["features"])
            for block in range(BLOCKS):
                names = (f"wide.{block}", f"deep.{block}", f"added.{block}")
                values |= zip(names, network.inside(block, output), strict=True)
                output = inner(output) + values[names[-1]]
            for name, planes in values.items():
                samples[name].append(planes.abs().flatten()[::_SAMPLED].numpy())
    return {
        name: _unit(np.concatenate(arrays), 255 if name.startswith(("wide", "deep")) else 127)
        for name, arrays in samples.items()
    }


def _unit(values: FloatArray, most: int) -> float:
    """The step with the least squared error if positive values become 0 to `most` of it, and larger
    ones are cut.
    """

    def error(step: float) -> float:
        rounded = np.minimum(np.rint(values / step), most) * step
        return float(np.square(rounded - values).sum())

    return min((values.max() / most * np.linspace(0.2, 1, 33)).tolist(), key=error)


@dataclass
class Descent:
    """Gradient descent, from the last checkpoint on.

    Attributes
    ----------
    network : nn.Module
        What learns.
    steps, every : int
        Number of steps, and of those from one report to the next.
    checkpoint : Path | None
        File that is written at each report; None = there is none.
    factor : float
        How far a step goes, relative to the usual length, which falls towards the end.
    warm_up : int
        Steps up to the largest one.
    norm : float
        Of the gradient: larger ones are cut.
    done : int
        Steps that the network has made.
    """

    network: nn.Module
    steps: int
    every: int
    checkpoint: Path | None = None
    factor: float = 1.0
    warm_up: int = _WARM_UP
    norm: float = _NORM
    done: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        weights = self.network.parameters()
        self._optimiser = torch.optim.AdamW(weights, lr=_RATE, weight_decay=_DECAY, betas=_BETAS)
        if self.checkpoint and self.checkpoint.exists():
            device = next(self.network.parameters()).device
            state = torch.load(self.checkpoint, map_location=device, weights_only=True)
            self.network.load_state_dict(state["network"])
            self._optimiser.load_state_dict(state["optimiser"])
            self.done = state["steps"]

    def follow(self, loss: Any) -> bool:
        """Make a step that lowers a loss; returns True if it is one to report."""
        rate = min(1.0, (self.done + 1) / self.warm_up)
        rate *= 0.5 + 0.5 * float(np.cos(np.pi * self.done / self.steps))
        for group in self._optimiser.param_groups:
            group["lr"] = self.factor * _RATE * rate
        self._optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.norm)
        self._optimiser.step()
        self.done += 1
        is_reported = self.done % self.every == 0 or self.done == self.steps
        if is_reported and self.checkpoint:
            weights, state = self.network.state_dict(), self._optimiser.state_dict()
            with durable_file(self.checkpoint, overwrite=True) as file:
                torch.save({"network": weights, "optimiser": state, "steps": self.done}, file)
        return is_reported


def inner(planes: Any, width: int = 1) -> Any:
    """All but the outermost superpixels."""
    return planes[..., width:-width, width:-width]


def losses(network: Network, batch: Sequence[Any]) -> tuple[Any, Any]:
    """Remaining error, and the initial one; four measures of each in each crop of the batch, (4,
    N).

    The measures of colour: the robust mean in units of activity; the energy; and the share of
    pixels with a wrong hue. Of luminance at the sites: the energy.

    Parameters
    ----------
    batch : Sequence[Any]
        What `run.prepare` returns, of each crop.
    """
    inputs, *rest = batch
    missing, light, scale, variance = (inner(planes, REACH) for planes in rest)
    unit = torch.sqrt(scale**2 + 0.25 * variance + 1e-5)
    limit = HUE * light + DARK
    left = missing - network(inputs).float() * scale
    return _measures(left, unit, limit), _measures(missing, unit, limit)


def share_left(left: Any, before: Any) -> Any:
    """The share of each measure that is left, (4,), for gradient descent.

    Those of energy are means of the shares of crops: a photograph counts whatever its brightness,
    as in a mean of PSNR.

    Parameters
    ----------
    left, before : Any
        From `losses`.
    """
    shares = left.mean(dim=1) / before.mean(dim=1).clamp_min(1e-7)
    energies = (left[1::2] / (before[1::2] + _FAINT)).mean(dim=1)
    return torch.stack([shares[0], energies[0], shares[2], energies[1]])


def _measures(error: Any, unit: Any, limit: Any) -> Any:
    pixels = limit.shape[1]
    colour, light = error[:, : 2 * pixels], error[:, 2 * pixels :]
    robust = torch.sqrt(((colour / unit) ** 2).mean(dim=1) + 1e-4)
    apart = (colour[:, :pixels] ** 2 + colour[:, pixels:] ** 2) / limit**2
    terms = robust, colour**2, apart**2 / (1 + apart**2), light**2
    return torch.stack([term.flatten(1).mean(dim=1) for term in terms])
