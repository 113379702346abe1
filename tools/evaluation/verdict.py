"""The verdict of an evaluation in words."""

from tools.host.console import one_line

from .figures import EVEN, HUE, TENTH, WHOLE, Figures
from .methods import methods

_LOSSES = 3  # named at each level


def plain_text(figures: Figures) -> str:
    """The verdict for a terminal: for each set a table of pooled medians, then sentences."""
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
                lines.append(f"{methods()[name].title:30}" + "  ".join(columns))
        lines += [headline(figures, group), *comparisons(figures, group), *worst_places(figures, group)]
        lines += [f"{claim.text}: {claim.finding} ({claim.why})." for claim in figures.claims(group)]
        if lost := losses(figures, group):
            lines.append(f"Where we lose: {lost}")
        if best := periods(figures, group):
            lines.append(best)
        lines.append("")
    return "\n".join(map(one_line, lines)).rstrip()


def heading(figures: Figures, group: str) -> str:
    """Name of a set with its number of scenes."""
    count = len(figures.scene_names(group))
    return f"{group[0].upper()}{group[1:]} ({count} scene{'s' * (count != 1)})"


def headline(figures: Figures, group: str) -> str:
    """The verdict on a set in one sentence: the levels at which we beat every rival."""
    margins = [(level, margin[1]) for level in figures.study.levels if (margin := figures.margin(group, level)) is not None]
    if not margins:
        return "There is nothing to compare: measure a method of ours and a rival."
    kinds = (
        ("better than every Bayer rival", [level for level, lead in margins if lead >= EVEN]),
        ("even with the best", [level for level, lead in margins if abs(lead) < EVEN]),
        ("worse than the best", [level for level, lead in margins if lead <= -EVEN]),
    )
    parts = [
        f"{text} at {_listed([figures.study.protocol.describe(level) for level in levels])}" for text, levels in kinds if levels
    ]
    return capital("; ".join(parts)) + " (median RGB PSNR)."


def comparisons(figures: Figures, group: str) -> list[str]:
    """One sentence for each level: the comparison with the best rival."""
    sentences = []
    for level in figures.study.levels:
        margin = figures.margin(group, level)
        if margin is None:
            continue
        rival, lead = methods()[margin[0]].short, margin[1]
        won, count = figures.wins(group, level)
        text = f"{capital(figures.study.protocol.describe(level))}: "
        if abs(lead) < EVEN:
            text += f"even with {rival}"
        else:
            text += f"{figures.ours} is {abs(lead):.1f} dB {'better' if lead > 0 else 'worse'} than the best rival, {rival}"
        sentences.append(text + (f"; ahead of every rival on {won} of {count} scenes." if count > 1 else "."))
    return sentences


def worst_places(figures: Figures, group: str) -> list[str]:
    """One sentence for each level: the worst tenth of the patches, whole images and wrong hues, each beside its best rival."""
    sentences = []
    for level in figures.study.levels:
        own = figures.ours and figures.pooled(group, level, figures.ours)
        leads = [figures.margin(group, level, criterion) for criterion in (TENTH, WHOLE, HUE)]
        if not own or None in leads:
            continue
        tenth, whole, hue = ((lead, methods()[name].short) for name, lead in filter(None, leads))
        share, described = own.values[HUE], capital(figures.study.protocol.describe(level))
        sentences.append(
            f"{described}, worst places beside the best rivals: {tenth[0]:+.1f} dB in the worst tenth of the patches "
            f"({tenth[1]}), {whole[0]:+.1f} dB in whole images ({whole[1]}); wrong hue in {share:.1f} % of the pixels, "
            f"{share + hue[0]:.1f} % with the best rival ({hue[1]})."
        )
    return sentences


def losses(figures: Figures, group: str) -> str:
    """Scenes on which the best rival beats us, by level, because losses without noise have other causes than losses in noise."""
    found = figures.losses(group)
    if not found:
        return "On no scene at any level." if figures.ours and figures.rivals else ""
    parts = []
    for level in figures.study.levels:
        here = [loss for loss in found if loss.level == level]
        worst = ", ".join(f"{loss.scene} -{loss.margin:.1f} dB ({loss.rival})" for loss in here[:_LOSSES])
        more = f", and {len(here) - _LOSSES} more" if len(here) > _LOSSES else ""
        parts += [f"{figures.study.protocol.describe(level)}: {worst}{more}"] if here else []
    return "; ".join(parts) + "."


def periods(figures: Figures, group: str) -> str:
    """The best period at each level, in a sentence; empty when only one was measured."""
    study = figures.study
    found = [(level, best) for level in study.levels if (best := figures.best_period(group, level)) is not None]
    if len(study.periods) < 2 or not found:
        return ""
    parts = [f"{study.protocol.describe(level)} K = {period} ({lead:+.1f} dB)" for level, (period, lead) in found]
    return f"Best K of {figures.ours}, and its margin over K = {study.period}: {', '.join(parts)}."


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def _listed(texts: list[str]) -> str:
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)
