"""The verdict on a set of scenes in three sentences: who is ahead, where ours is weakest, what this
does not stand on.
"""

from itertools import product
from typing import NamedTuple

from .figures import EVEN, RGB, TENTH, WHOLE, Figures, Lead, Place

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
        needed = "best, unlearned, paper or preview, a rival, and scenes in red, green and blue"
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
    complete = "Every method was measured on every scene, denoising and learned rivals included."
    return f"Mind: {'; '.join(limits)}." if limits else complete


def _scenes(count: int) -> str:
    return f"{count} scene{'s' * (count != 1)}"
