"""The verdict on a set of scenes in sentences: where ours is better or loses, what that does not stand on, the paper's claims."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from tools.simulation.noise import Protocol

from .figures import CHROMINANCE, CRITERIA, EVEN, LUMINANCE, RGB, Comparison, Criterion, SetFigures
from .measures import TITLES
from .methods import methods
from .scene_sets import SPECTRAL

FEW = 6  # scenes: by a sign test at 5 %, being ahead on all of fewer may be chance (2 / 2^5 = 0.06, 2 / 2^6 = 0.03)
# The strongest rivals in our figures, which need extra packages: name, what it is, whether noise is where it is strong.
_STRONGEST = (("bm3d+dlmmse-wb", "denoises (BM3D does)", True), ("demosaicnet", "is learned (Gharbi 2016 is)", False))
_BETTER, _SAME, _WORSE = "better than every Bayer rival", "even with the best", "worse than the best"


@dataclass(frozen=True)
class Claim:
    """A claim of the paper, the finding, the scenes that it stands on, and the figures behind it.

    finding: "shown" if it holds on the set and on each scene, "shown in part" if not on each scene or not in all, or "refuted".
    scenes: on how many scenes it holds, and by how much.
    """

    claim: str
    finding: str
    scenes: str
    why: str


def claims(group: SetFigures) -> list[Claim]:
    """The two claims of section 4, tested with the paper's own method and its own rival where both were measured.

    Each is tested on the set as a whole and on each of its scenes.
    """
    levels, rivals, methods_ = group.study.levels, group.study.rivals, group.study.methods
    rival = next((name for name in ("dlmmse", "menon", *rivals) if name in rivals), None)
    own = "paper" if "paper" in methods_ else group.study.ours
    if rival is None or own is None:
        return []

    def leads(scene: str | None) -> list[list[float]]:
        """By level, those that are measured: the lead in RGB, luminance and chrominance."""
        found = [[group.lead(level, rival, plane, scene, own) for plane in (RGB, LUMINANCE, CHROMINANCE)] for level in levels]
        return [[value for value in lead if value is not None] for lead in found if None not in lead]

    pooled, of_scenes, found = leads(None), [leads(scene) for scene in group.names], list[Claim]()
    if len(pooled) < len(levels):
        return []
    few = f" (fewer than {FEW} scenes: this may be chance)" * (len(of_scenes) < FEW)
    by_plane = list(zip(*pooled, strict=True))

    def claim(text: str, margin: float, margins: Sequence[float], verb: str, whole: bool, why: str) -> None:
        """margin, margins: what has to be positive, dB, on the set and on its scenes; whole: whether the rest of it holds."""
        finding = "refuted" if margin < EVEN else "shown" if whole and min(margins) >= EVEN else "shown in part"
        found.append(Claim(text, finding, ahead(margins).replace("ahead", verb, 1) + few, f"{own} minus {rival}{why}"))

    if levels[0].clear:
        rgb, luminance, chrominance = pooled[0]
        light = f"At {levels[0].text}" if levels[0].noisy else "Noise-free"
        why = f": {rgb:+.1f} dB RGB, {luminance:+.1f} dB luminance, {chrominance:+.1f} dB chrominance"
        mainly = luminance > max(chrominance, 0)
        claim(f"{light}, better than Bayer, mainly in luminance", rgb, [scene[0][0] for scene in of_scenes], "ahead", mainly, why)
    if len(pooled) > 1:
        parts = [f"{name} " + ", ".join(f"{lead:+.1f}" for lead in each) for name, each in zip(TITLES, by_plane, strict=True)]
        why = f", dB, at {', '.join(level.text for level in levels)}: {'; '.join(parts)}"
        rgb_, rising = by_plane[0], all(after > before - EVEN for before, after in pairwise(by_plane[0]))
        growth = [scene[-1][0] - scene[0][0] for scene in of_scenes]
        claim("The more noise, the larger the lead", rgb_[-1] - rgb_[0], growth, "the lead grows", rising, why)
    return found


def ahead(margins: Sequence[float]) -> str:
    """On how many scenes margins (dB) are more than none, and their range, in words."""
    count, least, most = sum(lead >= EVEN for lead in margins), min(margins), max(margins)
    text = f"ahead on {count} of {len(margins)} scene{'s' * (len(margins) != 1)}, by "
    span = f"{least:.1f} to {most:.1f} dB" if least >= EVEN else f"{least:+.1f} to {most:+.1f} dB"
    return text + (f"{least:+.1f} dB" if len(margins) == 1 else span)


def heading(group: SetFigures) -> str:
    """Name of a set with its number of scenes."""
    return f"{capital(group.name)} ({_scenes(len(group.names))})"


def headline(group: SetFigures) -> str:
    """The verdict on a set: the levels at which we beat every rival in median RGB PSNR, and by how many other figures we do not.

    A claim for all scenes together has to hold on each of them, or the scenes are counted instead.
    """
    margins = [margin for level in group.study.levels if (margin := group.margin(level)) is not None]
    if not margins and group.name == SPECTRAL:
        return "A Bayer camera is left out: these scenes have other channels than red, green and blue."
    if not margins:
        return "There is nothing to compare: measure a method of ours and a Bayer camera's."
    kinds: dict[str, list[Protocol]] = {_BETTER: [], _SAME: [], _WORSE: []}
    for each in margins:
        kinds.setdefault(_standing(each, [scene.lead for scene in group.margins(each.level)]), []).append(each.level)
    text = capital("; ".join(f"{text} at {_listed(levels)}" for text, levels in kinds.items() if levels)) + " in median RGB PSNR."
    lost = {(each.level, each.criterion) for each in group.comparisons if each.lost and each.criterion != RGB}
    if counts := Counter(level for level in group.study.levels for criterion in CRITERIA if (level, criterion) in lost):
        listed = " and ".join(f"{count} at {level.text}" for level, count in counts.items())
        text += f" But of the {len(CRITERIA) - 1} other figures some are better for a rival, if only on one scene: {listed}."
    return text


def _standing(together: Comparison, leads: Sequence[float]) -> str:
    """What can be said of ours beside the best Bayer rival. leads: on each scene, dB."""
    if min(leads) >= EVEN and together.lead >= EVEN:
        return _BETTER
    if max(leads) <= -EVEN and together.lost:
        return _WORSE
    if max(map(abs, (*leads, together.lead))) < EVEN:
        return _SAME
    return ahead(leads).replace("ahead", "ahead of the best Bayer rival", 1)


def caveats(group: SetFigures) -> list[str]:
    """Sentences on what the headline does not stand on: too few scenes, rivals that were not measured, missing results."""
    study, count = group.study, len(group.names)
    if not (study.ours and study.rivals):
        return []
    found = []
    if count < FEW:
        found.append(f"Only {_scenes(count)}: with fewer than {FEW}, even being ahead on all of them may be chance.")
    for name, what, noisy in _STRONGEST:
        same = [name == each or (noisy and (methods()[each].denoise or methods()[each].whole_shot)) for each in study.rivals]
        if any(same) or not any(level.noisy if noisy else level.clear for level in study.levels):
            continue
        method = methods()[name]
        why = f"{method.missing} is not installed: {method.remedy}" if method.missing else "it was not asked for"
        found.append(f"No rival here {what}, which is the strongest kind {'in' if noisy else 'without'} noise; {why}.")
    for name, levels in group.missing().items():
        missing = f"Without {methods()[name].title} at {_listed(levels)}"
        found.append(f"{missing}: results of it are missing, so that it is not compared there.")
    return found


def standing(group: SetFigures, level: Protocol, criterion: Criterion) -> str:
    """How ours stands beside the best rivals by a criterion: all scenes together, and each by itself; "" where nothing is known."""
    together, scenes = group.margin(level, criterion), sorted(group.margins(level, criterion), key=lambda each: each.lead)
    parts = [f"{criterion.difference(together.lead)} ({methods()[together.rival].short})"] if together else []
    if len(scenes) > 1:
        ahead = sum(each.lead >= criterion.even for each in scenes)
        parts.append(f"ahead on {ahead} of {_scenes(len(scenes))}, {_on_scene(scenes[0])} to {_on_scene(scenes[-1])}")
    return "; ".join(parts)


def losses(group: SetFigures) -> str:
    """How many comparisons we lose, of how many, and to whom; "" if there are none."""
    compared = group.comparisons
    if not compared:
        return ""
    lost = Counter(methods()[each.rival].short for each in compared if each.lost)
    what = f"{len(CRITERIA)} figures, each rival, level and scene, and all scenes together"
    if not lost:
        return f"nowhere in {len(compared)} comparisons ({what}; less than {EVEN} dB counts as none)."
    rivals = ", ".join(f"{rival} {count}" for rival, count in lost.most_common())
    every = f"in {lost.total()} of {len(compared)} comparisons ({what}; less than {EVEN} dB counts as none)"
    return f"{every}, by rival: {rivals}. evaluation.json lists them all."


def best_period(group: SetFigures, level: Protocol) -> int | None:
    """The best of the paper's patterns for our renderer by median RGB, if the study's own was measured, too."""
    values = group.by_pattern(level)
    medians = {tile.period: value for tile, value in values.items() if tile.period}
    return max(medians, key=lambda period: medians[period], default=None) if group.study.tile in values else None


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def _on_scene(each: Comparison) -> str:
    return f"{each.criterion.difference(each.lead)} ({each.scene}, {methods()[each.rival].short})"


def _scenes(count: int) -> str:
    return f"{count} scene{'s' * (count != 1)}"


def _listed(levels: list[Protocol]) -> str:
    texts = [level.text for level in levels]
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)
