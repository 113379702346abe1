"""The verdict on a set of scenes in sentences: where ours is better, what that does not stand on, and where it loses."""

from collections import Counter

from tools.camera.protocols import Protocol

from .claims import FEW
from .criteria import CRITERIA, EVEN, RGB, Criterion
from .figures import Comparison, SetFigures
from .methods import methods
from .scene_sets import SPECTRAL

# The strongest rivals in our figures, which need extra packages: name, what it is, whether noise is where it is strong.
_STRONGEST = (("bm3d+dlmmse-wb", "denoises (BM3D does)", True), ("demosaicnet", "is learned (Gharbi 2016 is)", False))


def heading(group: SetFigures) -> str:
    """Name of a set with its number of scenes."""
    return f"{capital(group.name)} ({_scenes(len(group.names))})"


def headline(group: SetFigures) -> str:
    """The verdict on a set: the levels at which we beat every rival in median RGB PSNR, and by how many other figures we do not."""
    margins = [margin for level in group.study.levels if (margin := group.margin(level)) is not None]
    if not margins and group.name == SPECTRAL:
        return "A Bayer camera is left out: these scenes have other channels than red, green and blue."
    if not margins:
        return "There is no Bayer camera to compare with: measure a method of ours and a rival."
    kinds = (
        ("better than every Bayer rival", [each.level for each in margins if each.lead >= EVEN]),
        ("even with the best", [each.level for each in margins if abs(each.lead) < EVEN]),
        ("worse than the best", [each.level for each in margins if each.lead <= -EVEN]),
    )
    text = capital("; ".join(f"{text} at {_listed(levels)}" for text, levels in kinds if levels)) + " in median RGB PSNR."
    found = [group.margin(level, criterion) for level in group.study.levels for criterion in CRITERIA if criterion != RGB]
    if lost := Counter(each.level for each in found if each and each.lost):
        counts = " and ".join(f"{count} at {level.text}" for level, count in lost.items())
        text += f" But of the {len(CRITERIA) - 1} other figures some are better for a rival: {counts}."
    return text


def caveats(group: SetFigures) -> list[str]:
    """Sentences on what the headline does not stand on: too few scenes, rivals that were not measured, missing results."""
    study, count = group.study, len(group.names)
    if not (study.ours and study.rivals):
        return []
    found = []
    if count < FEW:
        found.append(f"Only {_scenes(count)}: with fewer than {FEW}, even being ahead on all of them may be chance.")
    for name, what, noisy in _STRONGEST:
        same = [
            each for each in study.rivals if name == each or (noisy and (methods()[each].denoise or methods()[each].whole_shot))
        ]
        meant = [level for level in study.levels if (level.noisy if noisy else level.clear)]
        if same or not meant:
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
