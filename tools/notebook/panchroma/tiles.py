"""Which filter tile a sensor should have."""

from __future__ import annotations  # help() then shows them as they are written here

from collections.abc import Sequence
from dataclasses import dataclass

from .arguments import checked

_DRAWN = 8


@dataclass(frozen=True, repr=False, match_args=False)
class Design:
    """Tiles that a search found, the best first. Jupyter draws the first eight.

    patterns: their letters, as `simulate` takes them for its pattern.
    scores: weighted mean of the expected PSNR of whole pictures and of colour where it is finest, dB.
    light: collected, as a multiple of a Bayer sensor's.

    >>> import panchroma
    >>> panchroma.design(sigma=0.03, sizes=[3], steps=0)
    <Design: 46 tiles, the best RGB/BWW/WWW, 31.18 dB, 2.11 times the light of a Bayer sensor>
    """

    patterns: tuple[str, ...]
    scores: tuple[float, ...]
    light: tuple[float, ...]

    def __repr__(self) -> str:
        best = f"{self.patterns[0]}, {self.scores[0]:.2f} dB, {self.light[0]:.2f} times the light of a Bayer sensor"
        return f"<Design: {len(self.patterns)} tiles, the best {best}>"

    def _repr_html_(self) -> str:
        from tools.pictures.illustrations import tile_picture

        drawn = "".join(
            f'<div style="width:120px">{tile_picture(pattern.split("/"))}'
            f"<small>{score:.2f} dB, light {light:.2f}<br>{pattern}</small></div>"
            for pattern, score, light in zip(self.patterns[:_DRAWN], self.scores, self.light, strict=False)
        )
        style = "<style>.tiles rect { stroke: #8a8b92 } .tiles text { fill: #fff; font-size: 8px; text-anchor: middle }</style>"
        return f'{style}<div class="tiles" style="display:flex;flex-wrap:wrap;gap:16px;overflow-wrap:anywhere">{drawn}</div>'


@checked
def design(
    *,
    sigma: float = 0.01,
    channels: str = "RGB",
    sizes: Sequence[int] = (3, 4),
    share: tuple[float, float] = (0.5, 1.0),
    steps: int = 200,
    seed: int = 0,
) -> Design:
    """Search filter tiles with the fast judge of `panchroma design`, which says what the options mean.

    sigma: additive noise, scene units.
    channels: letters of the colour filters, each of which a tile has.
    sizes: K, pixels.
    share: of panchromatic pixels, least and most.
    steps: of annealing, for each size. seed: of annealing.
    Raises PanchromaError where no tile meets the limits.

    >>> import panchroma
    >>> panchroma.design(sigma=0.01, sizes=[3], share=(0.6, 1), steps=0).patterns[0]
    'RGB/WWW/WWW'
    """
    from tools.evaluation.design.judge import FastJudge, Light
    from tools.evaluation.design.proposals import Proposal
    from tools.evaluation.design.search import Judged, Limits, Search

    judge = FastJudge.of(channels, [Light.of_sigma(sigma)])
    search = Search(Judged(judge), Limits(channels, tuple(sizes), *share), {"worst": 1.0, "whole": 1.0}, steps, seed)
    found = [Proposal.of(search, judge, tile) for tile in search.run()]
    return Design(*(tuple(values) for values in zip(*((each.letters, each.score, each.light) for each in found), strict=True)))
