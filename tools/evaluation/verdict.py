"""The verdict of an evaluation in words."""

from collections import Counter
from dataclasses import dataclass

from tools.camera.protocols import Protocol
from tools.host.console import one_line

from .claims import FEW, ahead, claims
from .criteria import CRITERIA, EVEN, HUE, RGB, TENTH, WHOLE
from .figures import Comparison, Figures, SetFigures
from .methods import methods
from .pattern_verdict import best_patterns, pattern_table
from .scene_sets import SPECTRAL
from .strokes import COLOURS, WIDTHS
from .text_table import aligned

# The strongest rivals in our figures, which need extra packages: name, what it is, whether noise is where it is strong.
_STRONGEST = (("bm3d+dlmmse-wb", "denoises (BM3D does)", True), ("demosaicnet", "is learned (Gharbi 2016 is)", False))
STROKES = (
    f"Colour kept in strokes {', '.join(map(str, WIDTHS[:-1]))} and {WIDTHS[-1]} pixels wide on white, the least of "
    f"{', '.join(list(COLOURS)[:-1])} and {list(COLOURS)[-1]}"
)


@dataclass(frozen=True)
class Defeat:
    """Where we lose at one level by one criterion.

    together: the set as a whole beside the best rival, if we lose there.
    worst: on each scene on which we lose, the rival that is furthest ahead; the largest margin first.
    """

    level: Protocol
    criterion: int
    together: Comparison | None
    worst: tuple[Comparison, ...]


def plain_text(figures: Figures) -> str:
    """The verdict for a terminal: for each set a table of pooled medians, then sentences."""
    lines = []
    study = figures.study
    for group in figures.sets:
        rows = [["", *(level.text for level in study.levels)]]
        for name in study.methods:
            cells = [group.pooled(level, name) for level in study.levels]
            if any(cells):
                rows.append([methods()[name].title, *(f"{cell.quality.median[RGB]:.1f}" if cell else "-" for cell in cells)])
        lines += [f"{heading(group)}: median RGB PSNR of all 10 x 10 patches, dB, {study.tile.title}", *aligned(rows)]
        lines += [headline(group), *caveats(group)]
        lines += [*comparisons(group), *worst_places(group)]
        lines += [f"{claim.text}: {claim.finding}, {claim.scenes} ({claim.why})." for claim in claims(group)]
        if summary := losses(group):
            lines.append(f"Where we lose: {summary}")
        lines += [f"  {defeat_text(group, each)}" for each in defeats(group)]
        if best := periods(group):
            lines.append(best)
        lines += [*pattern_table(group), *best_patterns(group)]
        lines.append("")
    lines += stroke_lines(figures)
    return "\n".join(map(one_line, lines)).rstrip()


def stroke_lines(figures: Figures) -> list[str]:
    """A table of the colour that each method keeps in narrow strokes on white, at every level; empty if none was measured."""
    study = figures.study
    if not figures.strokes:
        return []
    table = [["", *(level.text for level in study.levels)]]
    for name, tile in dict.fromkeys((each.method, each.tile) for each in figures.strokes):
        found = {each.level: each.least for each in figures.strokes if (each.method, each.tile) == (name, tile)}
        texts = [" ".join(f"{100 * part:3.0f}" for part in found[level]) if level in found else "-" for level in study.levels]
        table.append([methods()[name].title + (f", {tile.title}" if tile and len(study.tiles) > 1 else ""), *texts])
    return [f"{STROKES}, %:", *aligned(table)]


def heading(group: SetFigures) -> str:
    """Name of a set with its number of scenes."""
    count = len(group.names)
    return f"{group.name[0].upper()}{group.name[1:]} ({count} scene{'s' * (count != 1)})"


def headline(group: SetFigures) -> str:
    """The verdict on a set: the levels at which we beat every rival in median RGB PSNR, and by how many other figures we do not."""
    margins = [(level, margin[1]) for level in group.study.levels if (margin := group.at(level).margin()) is not None]
    if not margins and group.name == SPECTRAL:
        return "A Bayer camera is left out: these scenes have other channels than red, green and blue."
    if not margins:
        return "There is no Bayer camera to compare with: measure a method of ours and a rival."
    kinds = (
        ("better than every Bayer rival", [level for level, lead in margins if lead >= EVEN]),
        ("even with the best", [level for level, lead in margins if abs(lead) < EVEN]),
        ("worse than the best", [level for level, lead in margins if lead <= -EVEN]),
    )
    parts = [f"{text} at {_listed([level.text for level in levels])}" for text, levels in kinds if levels]
    text = capital("; ".join(parts)) + " in median RGB PSNR."
    others = Counter(each.level for each in defeats(group) if each.criterion != RGB and each.together)
    if others:
        counts = _listed([f"{count} at {level.text}" for level, count in others.items()])
        text += f" But of the {len(CRITERIA) - 1} other figures some are better for a rival: {counts}."
    return text


def caveats(group: SetFigures) -> list[str]:
    """Sentences on what the headline does not stand on: too few scenes, rivals that were not measured, missing results."""
    if not (group.study.ours and group.study.rivals):
        return []
    study, count = group.study, len(group.names)
    found = []
    if count < FEW:
        found.append(
            f"Only {count} scene{'s' * (count != 1)}: with fewer than {FEW}, even being ahead on all of them may be chance."
        )
    for name, what, noisy in _STRONGEST:
        same = [each for each in group.study.rivals if name == each or (noisy and methods()[each].denoise)]
        meant = [level for level in study.levels if (level.noisy if noisy else level.clear)]
        if same or not meant:
            continue
        method = methods()[name]
        why = f"{method.missing} is not installed: {method.remedy}" if method.missing else "it was not asked for"
        found.append(f"No rival here {what}, which is the strongest kind {'in' if noisy else 'without'} noise; {why}.")
    for name, levels in group.missing().items():
        at = _listed([level.text for level in levels])
        found.append(f"Without {methods()[name].title} at {at}: results of it are missing, so that it is not compared there.")
    return found


def comparisons(group: SetFigures) -> list[str]:
    """One sentence for each level: the comparison with the best rival."""
    sentences = []
    for level in group.study.levels:
        margin = group.at(level).margin()
        if margin is None:
            continue
        rival, lead = methods()[margin[0]].short, margin[1]
        text = f"{capital(level.text)}: "
        if abs(lead) < EVEN:
            text += f"even with {rival}"
        else:
            text += f"{group.study.ours} is {abs(lead):.1f} dB {'better' if lead > 0 else 'worse'} than the best rival, {rival}"
        scenes = ahead(group.scene_leads(level)).replace("ahead", "ahead of every rival", 1)
        sentences.append(f"{text}; {scenes}.")
    return sentences


def worst_places(group: SetFigures) -> list[str]:
    """One sentence for each level: the worst tenth of the patches, whole images and wrong hues, each beside its best rival."""
    sentences = []
    for level in group.study.levels:
        own = group.study.ours and group.pooled(level, group.study.ours)
        leads = [group.at(level).margin(criterion) for criterion in (TENTH, WHOLE, HUE)]
        if not own or None in leads:
            continue
        tenth, whole, hue = ((lead, methods()[name].short) for name, lead in filter(None, leads))
        share, described = own.values[HUE], capital(level.text)
        sentences.append(
            f"{described}, worst places beside the best rivals: {tenth[0]:+.1f} dB in the worst tenth of the patches "
            f"({tenth[1]}), {whole[0]:+.1f} dB in whole images ({whole[1]}); wrong hue in {share:.1f} % of the pixels, "
            f"{share + hue[0]:.1f} % with the best rival ({hue[1]})."
        )
    return sentences


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


def defeats(group: SetFigures) -> list[Defeat]:
    """Where a rival beats us, by level, because losses without noise have other causes than those in noise; then by criterion."""
    lost = [each for each in group.comparisons if each.lost]
    found = []
    for level, criterion in sorted(
        {(each.level, each.criterion) for each in lost}, key=lambda key: (group.study.levels.index(key[0]), key[1])
    ):
        furthest: dict[str | None, Comparison] = {}
        for each in lost:
            if (each.level, each.criterion) == (level, criterion):
                furthest[each.scene] = min(each, furthest.get(each.scene, each), key=lambda loss: loss.lead)
        together = furthest.pop(None, None)
        found.append(Defeat(level, criterion, together, tuple(sorted(furthest.values(), key=lambda loss: loss.lead))))
    return found


def defeat_text(group: SetFigures, defeat: Defeat) -> str:
    """Where we lose at a level by a criterion, in one sentence."""
    described, title = capital(defeat.level.text), CRITERIA[defeat.criterion].title
    return f"{described}, {title}: {'; '.join(defeat_parts(group, defeat))}."


def defeat_parts(group: SetFigures, defeat: Defeat) -> list[str]:
    """The set as a whole, and the scenes, each beside the rival that is furthest ahead."""
    criterion, count, parts = CRITERIA[defeat.criterion], len(group.names), []
    if defeat.together:
        parts.append(
            f"all together {criterion.difference(defeat.together.lead)}{criterion.unit} ({methods()[defeat.together.rival].short})"
        )
    if defeat.worst:
        worst, number = defeat.worst[0], len(defeat.worst)
        scenes = f"{number} of {count} scenes, most on " if count > 1 else ""
        parts.append(f"{scenes}{worst.scene} {criterion.difference(worst.lead)}{criterion.unit} ({methods()[worst.rival].short})")
    return parts


def periods(group: SetFigures) -> str:
    """The best period at each level, in a sentence; empty when only one was measured."""
    study = group.study
    found = [(level, best) for level in study.levels if (best := group.best_period(level)) is not None]
    if len(study.periods) < 2 or not found:
        return ""
    parts = [f"{level.text} K = {period} ({lead:+.1f} dB)" for level, (period, lead) in found]
    return f"Best K of {group.study.ours}, and its margin over {study.tile.title}: {', '.join(parts)}."


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def _listed(texts: list[str]) -> str:
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)
