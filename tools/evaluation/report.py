"""The tables of a report, which the terminal and the page print alike, and the report for a terminal."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import nan
from typing import TypeVar

from tools.batch.console import one_line
from tools.io.scene import RGB as RGB_CHANNELS
from tools.simulation.noise import Protocol

from .figures import CHROMINANCE, CRITERIA, HUE, LUMINANCE, RGB, TENTH_CHROMINANCE, WHOLE, Criterion, Figures, SetFigures
from .hue import PLACES
from .methods import methods
from .verdict import capital, caveats, claims, heading, headline, losses, standing

T = TypeVar("T")

_OF_PATTERNS = {"median RGB": RGB, "worst colour": TENTH_CHROMINANCE, "whole image": WHOLE, "hue, %": HUE}
"""By what patterns are compared: how most of a picture looks, and its worst places."""


KEPT = "Colour kept by luminance of the truth, both pictures blurred: 1 is all of it, 0 is grey"


@dataclass(frozen=True)
class Row:
    """A row of a table: its title, its texts, which of these are the best of their columns, and a CSS class."""

    title: str
    texts: Sequence[str]
    best: Sequence[bool] = ()
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """A table: titles of the columns, the rows' own first; and rows."""

    head: Sequence[str]
    rows: Sequence[Row]


def method_table(group: SetFigures, *criteria: Criterion, scene: str | None = None) -> Table:
    """A set by criteria, or one of its scenes: a row for each method, a column for each level.

    The best are those by the first criterion. A set also has a row that says how much better ours is than the best rival by it.
    """
    study, first = group.study, criteria[0]
    best, rows = [group.best(level, first, scene=scene) for level in study.levels], []
    for name in study.methods:
        found = [group.figure(level, name, scene) for level in study.levels]
        texts = [" / ".join(each.text(each.of(figure)) for each in criteria) for figure in found]
        rows.append(_of_method(name, texts, [name == each for each in best]))
    margins = [group.margin(level, first) for level in study.levels if scene is None]
    if any(margins):
        texts = [f"{first.difference(each.lead)} ({each.rival})" if each else first.text(nan) for each in margins]
        rows.append(Row(f"{study.ours} minus best rival", texts, kind="margin"))
    return Table(["Method", *_levels(group)], rows)


def scene_table(group: SetFigures, scene: str) -> Table:
    """The median RGB, luminance and chrominance of a scene: a row for each method, a column for each level."""
    return method_table(group, RGB, LUMINANCE, CHROMINANCE, scene=scene)


def standing_table(group: SetFigures) -> Table:
    """How ours stands beside the best rivals: a row for each criterion, a column for each level."""
    found = {each: [standing(group, level, each) for level in group.study.levels] for each in CRITERIA}
    rows = [Row(capital(each.title), texts, kind="standing") for each, texts in found.items() if any(texts)]
    return Table([f"{group.study.ours} minus best rival", *_levels(group)], rows)


def pattern_table(group: SetFigures, level: Protocol) -> Table:
    """The patterns of a study for our renderer, with what it gains on the other methods for any pattern."""
    study, rows = group.study, []
    others = [name for name in study.methods if methods()[name].sparse and not methods()[name].ours]
    values = [(each, group.by_pattern(level, each), group.best_pattern(level, each)) for each in _OF_PATTERNS.values()]
    medians, gains = group.by_pattern(level), [group.by_pattern(level, RGB, name) for name in others]
    for tile in study.tiles:
        light = study.light(tile)
        facts = [f"{100 * tile.panchromatic_share:.0f} %", f"{light:.2f}×" if light else "–"]
        texts = [each.text(found.get(tile, nan)) for each, found, _ in values]
        leads = [f"{medians[tile] - each[tile]:+.1f}" if tile in medians and tile in each else "–" for each in gains]
        marks = [False, False, *(best == tile for *_, best in values), *[False] * len(leads)]
        rows.append(Row(tile.name, [*facts, *texts, *leads], marks))
    return Table([capital(level.text), "W", "light", *_OF_PATTERNS, *(f"over {name}" for name in others)], rows)


def kept_table(group: SetFigures, level: Protocol) -> Table:
    """What each method keeps of colour by luminance: a row for each method, a column for each bin."""
    found = [(name, figure.values) for name in group.study.methods if (figure := group.figure(level, name))]
    texts = [(name, [_part(values[f"kept_{place}"], 2) for place in range(1, len(PLACES) + 1)]) for name, values in found]
    return Table([capital(level.text), *PLACES], [_of_method(*each) for each in texts])


def sensors(figures: Figures) -> str:
    """The scenes, cameras and light of a study in a sentence."""
    study, count = figures.study, len(figures.study.scenes)
    tile = f"one Bayer block per {study.tile.period} × {study.tile.period} pixels" if study.tile.period else ""
    text = f"a panchromatic sensor with {tile or f'the colour filters of {study.tile.name}'}"
    if others := len(study.tiles) - 1:
        text += f", with {others} other pattern{'s' * (others != 1)} of it"
    text = f"{count} scene{'s' * (count != 1)}, photographed with {text}, and with a Bayer sensor under the same light"
    return f"{text}; {study.protocol.summary}; {', '.join(level.text for level in study.levels)}."


def pattern_conditions(figures: Figures) -> str:
    """Under which light patterns are compared, and in which colours."""
    study = figures.study
    text = f"Every pattern photographs the same scenes under the same light, {study.protocol.equal_noise}."
    if any(tile.pattern.channels != RGB_CHANNELS for tile in study.tiles):
        text += " Pictures in other colours than the scene's are unmixed (by the inverse of the filters' matrix) and measured so."
    return text


def plain_text(figures: Figures) -> str:
    """The report for a terminal: for each set a table of pooled medians, sentences and the patterns."""
    study, lines = figures.study, []
    for group in figures.sets:
        lines += [f"{heading(group)}: median RGB PSNR of all 10 x 10 patches, dB, {study.tile.title}"]
        lines += [*_aligned([method_table(group, RGB)]), headline(group), *caveats(group)]
        for level in study.levels:
            found = {each.title: standing(group, level, each) for each in CRITERIA}
            lines += [f"{capital(level.text)}, {title}: {text}" for title, text in found.items() if text]
        lines += [f"{claim.claim}: {claim.finding}, {claim.scenes} ({claim.why})." for claim in claims(group)]
        if summary := losses(group):
            lines.append(f"Where we lose: {summary}")
        if len(study.tiles) > 1 and study.ours:
            tables = by_level(pattern_table, group, study.levels)
            lines += [f"Patterns under the same light, {methods()[study.ours].title}, dB", *_aligned(tables)]
        if tables := by_level(kept_table, group, study.levels):
            lines += [f"{KEPT}:", *_aligned(tables)]
        lines.append("")
    return "\n".join(map(one_line, lines)).rstrip()


def by_level(table: Callable[[T, Protocol], Table], figures: T, levels: Iterable[Protocol]) -> list[Table]:
    """The tables of each level that have rows."""
    return [found for level in levels if (found := table(figures, level)).rows]


def _of_method(name: str, texts: Sequence[str], best: Sequence[bool] = (), more: str = "") -> Row:
    return Row(methods()[name].title + more, texts, best, "ours" * methods()[name].ours)


def _part(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _levels(group: SetFigures) -> list[str]:
    return [capital(level.text) for level in group.study.levels]


def _aligned(tables: Iterable[Table]) -> Iterable[str]:
    """The lines of tables: the first column at its left edge, the others at their right one."""
    for table in tables:
        rows = [table.head, *([row.title, *row.texts] for row in table.rows)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for first, *others in rows:
            yield "  ".join([f"{first:{widths[0]}}", *(f"{text:>{width}}" for text, width in zip(others, widths[1:], strict=True))])
