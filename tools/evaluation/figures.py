"""Figures of an evaluation, per scene and pooled, and who is ahead by how much; and the verdict on
a set of scenes in three sentences: who is ahead, where ours is weakest, what this does not stand
on.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from ..simulation.protocols import Protocol
from .cameras import Tile
from .metrics import PLANES, QUANTILES, Measures, colour_slopes, pooled_quantiles
from .scene_sets import SETS
from .study import Case, Study

EVEN = 0.05  # dB: smaller differences count as none


class Criterion(NamedTuple):
    """One way to compare methods: medians state how most of a picture looks, the others how its
    worst places do.

    Parameters
    ----------
    title
        Title of the column.
    figure
        Name of the value, see `Figure`.
    sign
        1 where more is better, -1 where less is, 0 where 100 is best.
    digits
        Decimals that people are shown.
    scale
        Factor from the value to what people are shown.
    error
        Name of the value's standard error; empty = none is shown.
    """

    title: str
    figure: str
    sign: int = 1
    digits: int = 1
    scale: float = 1.0
    error: str = ""

    def of(self, figure: "Figure | None") -> float:
        """Return the number that people are shown; NaN if there is none."""
        return np.nan if figure is None else self.scale * figure.values[self.figure]

    def score(self, figure: "Figure | None") -> float:
        """Return a number that is larger where the figure is better; NaN if there is none."""
        value = self.of(figure)
        return self.sign * value if self.sign else -abs(value - 100)

    def text(self, figure: "Figure") -> str:
        """Return the figure as text; a dash where there is none."""
        value, error = self.of(figure), self.scale * figure.values.get(self.error, np.nan)
        spread = "" if np.isnan(error) else f" ± {error:.{self.digits}f}"
        return "–" if np.isnan(value) else f"{value:.{self.digits}f}{spread}"


RGB = Criterion("RGB, dB", "rgb_q50")
TENTH = Criterion("RGB, 10 %", "rgb_q10")
WHOLE = Criterion("whole image", "psnr")
HUE = Criterion("wrong hue, %", "wrong_hue", sign=-1, scale=100.0)
CRITERIA = (
    RGB,
    Criterion("luminance", "luminance_q50"),
    Criterion("chrominance", "chrominance_q50"),
    TENTH,
    Criterion("chrominance, 10 %", "chrominance_q10"),
    WHOLE,
    HUE,
    Criterion("dark colour, %", "kept_1", 0, 0, 100.0, "kept_1_error"),
)


class Place(NamedTuple):
    """A set of scenes at a noise level, or one of its scenes by its name; None = the whole set."""

    group: str
    level: Protocol
    scene: str | None = None


class Figure(NamedTuple):
    """Figures of one method on a scene, or on a set of scenes: a row of the results.

    Parameters
    ----------
    place
        The scene or set, and the noise.
    method
        Name of the method.
    tile
        Pattern of the sparse-colour camera; None for a Bayer camera's method.
    scenes
        Number of scenes.
    values
        By name: PSNR quantiles of the patches of all scenes (PLANE_q10 to PLANE_q75) and PSNR of
        whole pictures (psnr, psnr_PLANE), dB; wrong_hue, the fraction of the pixels that show a
        wrong hue, 0 to 1; kept_1 to kept_5, the slopes of `colour_slopes` from dark to bright, and
        kept_1_error to kept_5_error, their standard errors. The last are NaN where there is no
        colour, or hardly any, or no red, green and blue. Figures of whole
        pictures are means over the scenes; kept is of all their pixels.
    """

    place: Place
    method: str
    tile: Tile | None
    scenes: int
    values: Mapping[str, float]


class Lead(NamedTuple):
    """Advantage of ours over the best rival by a criterion, in its unit."""

    place: Place
    criterion: Criterion
    rival: str
    value: float


class Figures:
    """All figures of a study, from the results that exist.

    groups: names of the sets that have results. rows: figures of the sets, where every scene of a
    set has a result, then of the scenes.
    """

    def __init__(self, study: Study, results: Mapping[Case, Measures]) -> None:
        self.study, self.results = study, results
        self.groups = [name for name in SETS if any(case.scene.group == name for case in results)]
        sets = [(Place(case.scene.group, case.level), case) for case in results]
        single = [(place._replace(scene=case.scene.name), case) for place, case in sets]
        pools = defaultdict[tuple[Place, str, Tile | None], list[Measures]](list)
        for place, case in sets + single:
            pools[place, case.method, case.tile].append(results[case])
        self._figures = {
            key: Figure(*key, len(pooled), _values(pooled))
            for key, pooled in pools.items()
            if key[0].scene or len(pooled) == len(self.scenes(key[0].group))
        }
        self.rows = list(self._figures.values())

    def scenes(self, group: str) -> list[str]:
        """Return the names of the scenes of a set."""
        return [scene.name for scene in self.study.scenes if scene.group == group]

    def of(self, place: Place, method: str) -> Figure | None:
        """Return the figures of a method, with the study's pattern; None if there are none."""
        tile = self.study.tile if self.study.method(method).ours else None
        return self._figures.get((place, method, tile))

    def best(self, place: Place, criterion: Criterion, names: Sequence[str]) -> str | None:
        """Return the best of some methods by a criterion; None where none has a figure."""
        scores = {name: criterion.score(self.of(place, name)) for name in names}
        measured = [name for name in names if not np.isnan(scores[name])]
        return max(measured, key=scores.__getitem__, default=None)

    def lead(self, place: Place, criterion: Criterion = RGB) -> Lead | None:
        """Return how much better ours is than the best rival; None if one of them has no such
        figure.
        """
        ours, rival = self.study.ours, self.best(place, criterion, self.study.rivals)
        if ours is None or rival is None or self.of(place, ours) is None:
            return None
        own, theirs = (criterion.score(self.of(place, name)) for name in (ours, rival))
        return Lead(place, criterion, rival, own - theirs)

    def leads(self, group: str, level: Protocol, criterion: Criterion = RGB) -> list[Lead]:
        """Return the lead on each scene of a set; scenes without results are left out."""
        places = (Place(group, level, scene) for scene in self.scenes(group))
        return [lead for place in places if (lead := self.lead(place, criterion))]


def _values(pooled: Sequence[Measures]) -> dict[str, float]:
    """`Figure.values` of some pictures; a single one's quantiles are exact."""
    values: dict[str, float] = {}
    for name, exact in zip(PLANES, pooled[0].quality, strict=True):
        histograms = [getattr(result, name) for result in pooled]
        quantiles = exact if len(pooled) == 1 else pooled_quantiles(histograms)
        for quantile, value in zip(QUANTILES, quantiles, strict=True):
            values[f"{name}_q{round(100 * quantile)}"] = value
    whole = ("psnr", *(f"psnr_{plane}" for plane in PLANES[1:]))
    values |= zip(whole, np.mean([result.psnr for result in pooled], axis=0), strict=True)
    values["wrong_hue"] = float(np.mean([result.wrong_hue for result in pooled]))
    kept = zip(*colour_slopes(np.sum([result.kept for result in pooled], axis=0)), strict=True)
    for place, (slope, error) in enumerate(kept, 1):
        values |= {f"kept_{place}": slope, f"kept_{place}_error": error}
    return {name: float(value) for name, value in values.items()}


# scenes: by a sign test at 5 %, being ahead on all of fewer may be chance (2 / 2^5 = 0.06, 2 / 2^6
# = 0.03)
FEW = 6
_DENOISER = "bm3d+dlmmse-wb"  # the strongest rival in noise, which needs an extra package


class Verdict(NamedTuple):
    """A verdict: its tone, "good", "care" or "bad", and three sentences, or one where there is
    nothing to compare.
    """

    tone: str
    sentences: tuple[str, ...]


def judge(figures: Figures, group: str) -> Verdict:
    """Return the verdict on a set."""
    levels = figures.study.levels
    leads = [lead for level in levels if (lead := figures.lead(Place(group, level)))]
    if not leads:
        needed = "best, unlearned, paper or preview, a rival, RGB scenes, and all their results"
        return Verdict("care", (f"There is no verdict: it needs {needed}.",))
    together = [lead.value for lead in leads]
    alone = [lead.value for level in levels for lead in figures.leads(group, level)]
    if min(*together, *alone) >= EVEN:
        tone, standing = "good", "better than every Bayer rival, on every scene"
    elif min(together) >= EVEN:
        tone, standing = "care", "better than every Bayer rival, but not on every scene"
    elif max(together) >= EVEN:
        tone, standing = "care", "better than every Bayer rival at some noise levels only"
    else:
        tone, standing = "bad", "no better than the best Bayer rival"
    ours = figures.study.ours or ""
    listed = "; ".join(_lead(figures, lead) for lead in leads)
    first = f"By the median PSNR of patches, {ours} is {standing}: {listed}."
    return Verdict(tone, (first, _weakest(figures, group), _caveats(figures, group)))


def _lead(figures: Figures, lead: Lead) -> str:
    group, level, _ = lead.place
    scenes = figures.leads(group, level)
    ahead = sum(scene.value >= EVEN for scene in scenes)
    count = _scenes(len(scenes))
    return f"{level.text} {lead.value:+.1f} dB ({lead.rival}), ahead on {ahead} of {count}"


def _weakest(figures: Figures, group: str) -> str:
    """Return the sentence on the largest loss on any scene."""
    study = figures.study
    criteria = {RGB: "the median", TENTH: "the worst tenth", WHOLE: "the whole image"}
    pairs = product(study.levels, criteria)
    leads = [lead for noise, criterion in pairs for lead in figures.leads(group, noise, criterion)]
    worst = min(leads, key=lambda lead: lead.value)
    if worst.value > -EVEN:
        return "It loses on no scene, in the median, the worst tenth or the whole image."
    loss = f"{-worst.value:.1f} dB in {criteria[worst.criterion]}"
    where = f"{worst.place.scene}, {worst.place.level.text}, {worst.rival}"
    return f"Its largest loss on a scene is {loss} ({where})."


def _caveats(figures: Figures, group: str) -> str:
    """Return the sentence on the limits of the other two: few scenes, no strong rival, missing
    results.
    """
    study, count, limits = figures.study, len(figures.scenes(group)), []
    if count < FEW:
        chance = f"with fewer than {FEW} even being ahead on all of them may be chance"
        limits.append(f"{_scenes(count)} only, and {chance}")
    if not any(study.method(name).source for name in study.rivals):
        limits.append("no rival is learned")
        if study.levels[-1].level and _DENOISER not in study.rivals:
            limits.append(f"no rival denoises, such as {_DENOISER}")
    for name, level in product(study.methods, study.levels):
        if figures.of(Place(group, level), name) is None:
            limits.append(f"results of {name} are missing at {level.text}")
    complete = "Every method was measured on every scene, a learned rival included."
    return f"Mind: {'; '.join(limits)}." if limits else complete


def _scenes(count: int) -> str:
    return f"{count} scene{'s' * (count != 1)}"
