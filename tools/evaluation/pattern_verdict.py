"""Which pattern is best, and when: the patterns of a study beside each other under the same light, in words."""

from .criteria import CRITERIA, HUE, RGB, TENTH_CHROMINANCE, WHOLE
from .figures import Figures
from .methods import DENOISED_PLANES, PLANES, SHARPENED_PLANES, methods
from .tiles import Tile

COMPARED = (RGB, TENTH_CHROMINANCE, WHOLE, HUE)  # criteria: how most of a picture looks, and its worst places
BASELINES = {
    PLANES: "interpolated planes",
    SHARPENED_PLANES: "these sharpened by W",
    DENOISED_PLANES: "interpolated planes after BM3D",
}


def gains(figures: Figures, group: str, level: float, baseline: str) -> dict[Tile, float]:
    """Lead of ours over one of BASELINES on the same shots, dB of median RGB, for each pattern that has both results."""
    if baseline not in figures.study.methods:
        return {}
    ours, theirs = (figures.by_pattern(group, level, RGB, name) for name in (None, baseline))
    return {tile: value - theirs[tile] for tile, value in ours.items() if tile in theirs}


def best_patterns(figures: Figures, group: str) -> list[str]:
    """A text for each level: the best of several patterns by each of COMPARED, and what rendering gains over BASELINES."""
    found = []
    for level in figures.study.levels:
        name, gained = figures.study.protocol.describe(level), _gained(figures, group, level)
        winners = [(index, tile) for index in COMPARED if (tile := figures.best_pattern(group, level, index)) is not None]
        if len(figures.by_pattern(group, level, RGB)) > 1:
            parts = [_winner(figures, group, level, index, tile) for index, tile in winners]
            found.append(f"Best pattern at {name}: {'; '.join(parts)}.{gained}")
        elif gained:
            found.append(f"At {name}:{gained}")
    return found


def pattern_table(figures: Figures, group: str) -> list[str]:
    """Lines for a terminal: median RGB of our renderer by pattern and level; empty for a single pattern."""
    study = figures.study
    if len(study.tiles) < 2 or figures.ours is None:
        return []
    levels = [study.protocol.describe(level) for level in study.levels]
    widths = [max(len(text), 8) for text in levels]
    head = "  ".join(f"{text:>{width}}" for text, width in zip(levels, widths, strict=True))
    lines = [f"Patterns under the same light, {methods()[figures.ours].title}, median RGB PSNR, dB", f"{'':30}   W  light  {head}"]
    columns = [figures.by_pattern(group, level, RGB) for level in study.levels]
    for tile in study.tiles:
        if not any(tile in column for column in columns):
            continue
        texts = [CRITERIA[RGB].text(column[tile]) if tile in column else "-" for column in columns]
        figures_ = "  ".join(f"{text:>{width}}" for text, width in zip(texts, widths, strict=True))
        lines.append(f"{tile.name:28}{100 * tile.panchromatic_share:4.0f} %  {study.light(tile) or 0:4.2f}x  {figures_}")
    return lines


def _winner(figures: Figures, group: str, level: float, index: int, tile: Tile) -> str:
    """The winner by a criterion, with its figure, and how much better it is than the study's own pattern."""
    criterion, values, own = CRITERIA[index], figures.by_pattern(group, level, index), figures.study.tile
    unit = criterion.unit.removesuffix(" of the pixels")
    text = f"{criterion.title} {tile.name} ({criterion.text(values[tile])}{unit}"
    return text + (f", {own.name} {criterion.text(values[own])})" if own in values and own != tile else ")")


def _gained(figures: Figures, group: str, level: float) -> str:
    """What rendering gains over each of BASELINES, in a sentence; "" if none was measured."""
    leads = {title: list(gains(figures, group, level, name).values()) for name, title in BASELINES.items()}
    parts = [f"{_span(each)} over {title}" for title, each in leads.items() if each]
    return f" By median RGB, {figures.ours} gains {', '.join(parts)}." if parts else ""


def _span(leads: list[float]) -> str:
    return f"{leads[0]:+.1f} dB" if len(leads) == 1 else f"{min(leads):+.1f} to {max(leads):+.1f} dB"
