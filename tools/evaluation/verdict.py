"""The verdict on a set of scenes in three sentences: who is ahead, where ours is weakest, what this does not stand on."""

from typing import NamedTuple

from tools.simulation.protocols import Protocol

from .figures import EVEN, HUE, KEPT, RGB, TENTH, WHOLE, Figures, Lead
from .methods import methods
from .study import can_photograph

FEW = 6  # scenes: by a sign test at 5 %, being ahead on all of fewer may be chance (2 / 2^5 = 0.06, 2 / 2^6 = 0.03)
_DENOISER = "bm3d+dlmmse-wb"  # the strongest rival in noise, which needs an extra package


class Verdict(NamedTuple):
    """tone: "good", "care" or "bad"; sentences: three, or one where there is nothing to compare."""

    tone: str
    sentences: tuple[str, ...]


def judge(figures: Figures, group: str) -> Verdict:
    """Return the verdict on a set."""
    levels = figures.study.levels
    leads = [lead for level in levels if (lead := figures.lead(group, level))]
    if not leads:
        return Verdict("care", ("There is no Bayer camera to compare with: measure a method of ours and a rival.",))
    least, most = min(lead.value for lead in leads), max(lead.value for lead in leads)
    if least >= EVEN:
        tone, standing = "good", "better than every Bayer rival"
    elif most < EVEN:
        tone, standing = (
            ("bad", "worse than the best Bayer rival") if most <= -EVEN else ("care", "no better than the best Bayer rival")
        )
    else:
        tone, standing = "care", "better than every Bayer rival at some noise levels only"
    ours = figures.study.ours or ""
    found = "; ".join(_lead(figures, group, lead) for lead in leads)
    first = f"By the median PSNR of patches, {ours} is {standing}: {found}."
    return Verdict(tone, (first, _weakest(figures, group), _caveats(figures, group)))


def _lead(figures: Figures, group: str, lead: Lead) -> str:
    scenes = figures.leads(group, lead.level)
    ahead = sum(scene.value >= EVEN for scene in scenes)
    short = figures.study.method(lead.rival).short
    return f"{lead.level.text} {lead.value:+.1f} dB ({short}), ahead on {ahead} of {_scenes(len(scenes))}"


def _weakest(figures: Figures, group: str) -> str:
    """The largest loss on any scene, and what the highest noise does to colour."""
    study = figures.study
    criteria = {RGB: "the median", TENTH: "the worst tenth", WHOLE: "the whole image"}
    leads = [lead for level in study.levels for each in criteria for lead in figures.leads(group, level, each)]
    worst = min(leads, key=lambda lead: lead.value)
    if worst.value <= -EVEN:
        place = f"{worst.scene}, {worst.level.text}, {study.method(worst.rival).short}"
        text = f"Its largest loss on a scene is {-worst.value:.1f} dB in {criteria[worst.criterion]} ({place})"
    else:
        text = "It loses on no scene, in the median, the worst tenth or the whole image"
    level = study.levels[-1]
    own = figures.of(group, level, study.ours or "")
    rival = figures.best(group, level, HUE, study.rivals)
    if own and rival and HUE.of(own) is not None:
        theirs = HUE.text(figures.of(group, level, rival))
        text += f"; at {level.text} {HUE.text(own)} % of its pixels show a wrong hue (best rival {theirs} %)"
        if KEPT.of(own) is not None:
            text += f", and the darkest tenth keeps {KEPT.text(own)} % of its colour"
    return f"{text}."


def _caveats(figures: Figures, group: str) -> str:
    """What the first two sentences do not stand on: too few scenes, a rival that was not measured, missing results."""
    study, count, found = figures.study, len(figures.scenes(group)), []
    if count < FEW:
        found.append(f"{_scenes(count)} only, and with fewer than {FEW} even being ahead on all of them may be chance")
    if _DENOISER not in study.rivals and not study.networks and any(level.noisy for level in study.levels):
        method = methods()[_DENOISER]
        why = f"{method.missing} is not installed: {method.remedy}" if method.missing else "it was not asked for"
        found.append(f"no rival denoises ({why})")
    if not study.networks:
        found.append("no rival is learned (give one with `rival`)")
    for name, levels in _missing(figures, group).items():
        found.append(f"results of {study.method(name).title} are missing at {', '.join(level.text for level in levels)}")
    return (
        f"Mind: {'; '.join(found)}."
        if found
        else "Every method was measured on every scene, denoising and learned rivals included."
    )


def _missing(figures: Figures, group: str) -> dict[str, list[Protocol]]:
    """Methods, with the levels at which a scene has no result of them, so that they are missing from the pooled figures."""
    study = figures.study
    channels = {scene.channels for scene in study.scenes if scene.group == group}
    meant = [name for name in study.methods if any(can_photograph(tile, each) for tile in study.cameras(name) for each in channels)]
    found = {name: [level for level in study.levels if figures.of(group, level, name) is None] for name in meant}
    return {name: without for name, without in found.items() if without}


def _scenes(count: int) -> str:
    return f"{count} scene{'s' * (count != 1)}"
