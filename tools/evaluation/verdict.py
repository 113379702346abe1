"""What an evaluation found, in words."""

from .figures import Figures, Loss, title
from .methods import methods

_LOSSES = 3  # that are named, of each level
_EVEN = 0.05  # dB


def plain_text(figures: Figures) -> str:
    """The verdict for a terminal: a table of pooled medians per set, then its sentences."""
    lines = []
    study = figures.study
    for group in figures.groups:
        levels = [study.protocol.describe(level) for level in study.levels]
        widths = [max(len(text), 8) for text in levels]
        lines += [f"{heading(figures, group)}: median RGB PSNR of all 10 x 10 patches, dB, K = {study.period}"]
        lines += [" " * 30 + "  ".join(f"{text:>{width}}" for text, width in zip(levels, widths, strict=True))]
        for name in study.methods:
            cells = [figures.pooled(group, level, name) for level in study.levels]
            if any(cells):
                texts = [f"{cell.quality.median[0]:.1f}" if cell else "-" for cell in cells]
                columns = (f"{text:>{width}}" for text, width in zip(texts, widths, strict=True))
                lines.append(f"{title(name):30}" + "  ".join(columns))
        lines += [headline(figures, group), *comparisons(figures, group)]
        lines += [f"{claim.text}: {claim.finding} ({claim.why})." for claim in figures.claims(group)]
        if lost := losses(figures, group):
            lines.append(f"Where we lose: {lost}")
        if best := periods(figures, group):
            lines.append(best)
        lines.append("")
    return "\n".join(lines).rstrip()


def heading(figures: Figures, group: str) -> str:
    """A set and how many scenes it has."""
    count = sum(scene.group == group for scene in figures.study.scenes)
    return f"{group[0].upper()}{group[1:]} ({count} scene{'s' * (count != 1)})"


def headline(figures: Figures, group: str) -> str:
    """The verdict on a set in one sentence: at which levels we are ahead of every rival."""
    margins = [(level, margin[1]) for level in figures.study.levels if (margin := figures.margin(group, level)) is not None]
    if not margins:
        return "There is nothing to compare: measure a method of ours and a rival."
    kinds = (
        ("better than every Bayer rival", [level for level, ahead in margins if ahead >= _EVEN]),
        ("even with the best", [level for level, ahead in margins if abs(ahead) < _EVEN]),
        ("worse than the best", [level for level, ahead in margins if ahead <= -_EVEN]),
    )
    parts = [
        f"{text} at {_listed([figures.study.protocol.describe(level) for level in levels])}" for text, levels in kinds if levels
    ]
    return capital("; ".join(parts)) + " (median RGB PSNR)."


def comparisons(figures: Figures, group: str) -> list[str]:
    """Against the best rival at each level, one sentence each."""
    said = []
    for level in figures.study.levels:
        margin = figures.margin(group, level)
        if margin is None or figures.ours is None:
            continue
        rival, ahead = margin
        won, of = figures.wins(group, level)
        place = capital(figures.study.protocol.describe(level))
        scenes = f"ahead of every rival on {won} of {of} scenes" if of > 1 else ""
        if abs(ahead) < _EVEN:
            said.append(f"{place}: even with {methods()[rival].short}; {scenes}".rstrip("; ") + ".")
        else:
            word = "better" if ahead > 0 else "worse"
            text = f"{figures.ours} is {abs(ahead):.1f} dB {word} than the best rival, {methods()[rival].short}"
            said.append(f"{place}: {text}; {scenes}".rstrip("; ") + ".")
    return said


def losses(figures: Figures, group: str) -> str:
    """Where the best rival of a scene is ahead of us: level by level, for what is lost without noise is lost for another reason."""
    found = figures.losses(group)
    if not found:
        return "On no scene at any level." if figures.ours and figures.rivals else ""
    parts = []
    for level in figures.study.levels:
        here = [loss for loss in found if loss.level == level]
        worst = ", ".join(_loss(loss) for loss in here[:_LOSSES])
        more = f", and {len(here) - _LOSSES} more" if len(here) > _LOSSES else ""
        parts += [f"{figures.study.protocol.describe(level)}: {worst}{more}"] if here else []
    return "; ".join(parts) + "."


def periods(figures: Figures, group: str) -> str:
    """Which period wins at which level, in a sentence; nothing when there is only one."""
    study = figures.study
    found = [(level, best) for level in study.levels if (best := figures.best_period(group, level)) is not None]
    if len(study.periods) < 2 or not found:
        return ""
    parts = [f"{study.protocol.describe(level)} K = {period} ({ahead:+.1f} dB)" for level, (period, ahead) in found]
    return f"Best K of {figures.ours}, and its margin over K = {study.period}: {', '.join(parts)}."


def capital(text: str) -> str:
    """With a capital first letter."""
    return text[:1].upper() + text[1:]


def _listed(texts: list[str]) -> str:
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def _loss(loss: Loss) -> str:
    return f"{loss.scene} -{loss.margin:.1f} dB ({loss.rival})"
