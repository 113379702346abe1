"""Which pattern is best, and when: the patterns of a study beside each other under the same light, in words."""

from tools.camera.protocols import Protocol

from .criteria import CRITERIA, HUE, RGB, TENTH_CHROMINANCE, WHOLE
from .figures import SetFigures
from .methods import BASELINES, methods
from .text_table import aligned
from .tiles import Tile

COMPARED = (RGB, TENTH_CHROMINANCE, WHOLE, HUE)  # criteria: how most of a picture looks, and its worst places


def gains(group: SetFigures, level: Protocol, baseline: str) -> dict[Tile, float]:
    """Lead of ours over one of BASELINES on the same shots, dB of median RGB, for each pattern that has both results."""
    if baseline not in group.study.methods:
        return {}
    ours, theirs = (group.by_pattern(level, RGB, name) for name in (None, baseline))
    return {tile: value - theirs[tile] for tile, value in ours.items() if tile in theirs}


def best_patterns(group: SetFigures) -> list[str]:
    """A text for each level: the best of several patterns by each of COMPARED, and what rendering gains over BASELINES."""
    found = []
    for level in group.study.levels:
        name, gained = level.text, _gained(group, level)
        winners = [(index, tile) for index in COMPARED if (tile := group.best_pattern(level, index)) is not None]
        if len(group.by_pattern(level, RGB)) > 1:
            parts = [_winner(group, level, index, tile) for index, tile in winners]
            found.append(f"Best pattern at {name}: {'; '.join(parts)}.{gained}")
        elif gained:
            found.append(f"At {name}:{gained}")
    return found


def pattern_table(group: SetFigures) -> list[str]:
    """Lines for a terminal: median RGB of our renderer by pattern and level; empty for a single pattern."""
    study = group.study
    if len(study.tiles) < 2 or study.ours is None:
        return []
    rows = [["", "W", "light", *(level.text for level in study.levels)]]
    columns = [group.by_pattern(level, RGB) for level in study.levels]
    for tile in study.tiles:
        if any(tile in column for column in columns):
            texts = [CRITERIA[RGB].text(column[tile]) if tile in column else "-" for column in columns]
            rows.append([tile.name, f"{100 * tile.panchromatic_share:.0f} %", f"{study.light(tile) or 0:.2f}x", *texts])
    return [f"Patterns under the same light, {methods()[study.ours].title}, median RGB PSNR, dB", *aligned(rows)]


def _winner(group: SetFigures, level: Protocol, index: int, tile: Tile) -> str:
    """The winner by a criterion, with its figure, and how much better it is than the study's own pattern."""
    criterion, values, own = CRITERIA[index], group.by_pattern(level, index), group.study.tile
    unit = criterion.unit.removesuffix(" of the pixels")
    text = f"{criterion.title} {tile.name} ({criterion.text(values[tile])}{unit}"
    return text + (f", {own.name} {criterion.text(values[own])})" if own in values and own != tile else ")")


def _gained(group: SetFigures, level: Protocol) -> str:
    """What rendering gains over each of BASELINES, in a sentence; "" if none was measured."""
    leads = {title: list(gains(group, level, name).values()) for name, title in BASELINES.items()}
    parts = [f"{_span(each)} over {title}" for title, each in leads.items() if each]
    return f" By median RGB, {group.study.ours} gains {', '.join(parts)}." if parts else ""


def _span(leads: list[float]) -> str:
    return f"{leads[0]:+.1f} dB" if len(leads) == 1 else f"{min(leads):+.1f} to {max(leads):+.1f} dB"
