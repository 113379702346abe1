"""The paper's two claims about the camera, each tested on a set as a whole and on each of its scenes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from tools.camera.protocols import Protocol

from .criteria import CHROMINANCE, EVEN, LUMINANCE, RGB
from .figures import SetFigures
from .measures import TITLES

FEW = 6  # scenes: by a sign test at 5 %, being ahead on all of fewer may be chance (2 / 2^5 = 0.06, 2 / 2^6 = 0.03)
_PLANES = RGB, LUMINANCE, CHROMINANCE


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
    """The two claims of section 4, tested with the paper's own method and its own rival where both were measured."""
    rival = next((name for name in ("dlmmse", "menon", *group.study.rivals) if name in group.study.rivals), None)
    own = "paper" if "paper" in group.study.methods else group.study.ours
    if rival is None or own is None:
        return []
    levels, names = group.study.levels, f"{own} minus {rival}"

    def leads(scene: str | None) -> list[list[float]]:
        """By level, those that are measured: the lead by each of _PLANES."""
        found = [[group.lead(level, rival, plane, scene, own) for plane in _PLANES] for level in levels]
        return [each for lead in found if len(each := [value for value in lead if value is not None]) == len(_PLANES)]

    pooled, of_scenes = leads(None), [leads(scene) for scene in group.names]
    if len(pooled) < len(levels):
        return []
    found = []
    if levels[0].clear:
        found.append(_noise_free(levels[0], pooled[0], [scene[0][0] for scene in of_scenes], names))
    if len(pooled) > 1:
        found.append(_growing(levels, pooled, [scene[-1][0] - scene[0][0] for scene in of_scenes], names))
    return found


def ahead(margins: Sequence[float]) -> str:
    """On how many scenes margins (dB) are more than none, and their range, in words."""
    count, least, most = sum(lead >= EVEN for lead in margins), min(margins), max(margins)
    text = f"ahead on {count} of {len(margins)} scene{'s' * (len(margins) != 1)}, by "
    span = f"{least:.1f} to {most:.1f} dB" if least >= EVEN else f"{least:+.1f} to {most:+.1f} dB"
    return text + (f"{least:+.1f} dB" if len(margins) == 1 else span)


def _noise_free(level: Protocol, lead: Sequence[float], of_scenes: Sequence[float], names: str) -> Claim:
    rgb, luminance, chrominance = lead
    light = f"At {level.text}" if level.noisy else "Noise-free"
    return Claim(
        f"{light}, better than Bayer, mainly in luminance",
        _finding(rgb, of_scenes, luminance > max(chrominance, 0)),
        ahead(of_scenes) + _few(of_scenes),
        f"{names}: {rgb:+.1f} dB RGB, {luminance:+.1f} dB luminance, {chrominance:+.1f} dB chrominance",
    )


def _growing(levels: Sequence[Protocol], pooled: Sequence[Sequence[float]], of_scenes: Sequence[float], names: str) -> Claim:
    by_plane = list(zip(*pooled, strict=True))
    parts = [f"{name} " + ", ".join(f"{lead:+.1f}" for lead in each) for name, each in zip(TITLES, by_plane, strict=True)]
    rgb = by_plane[0]
    return Claim(
        "The more noise, the larger the lead",
        _finding(rgb[-1] - rgb[0], of_scenes, _rising(rgb)),
        ahead(of_scenes).replace("ahead", "the lead grows", 1) + _few(of_scenes),
        f"{names}, dB, at {', '.join(level.text for level in levels)}: {'; '.join(parts)}",
    )


def _finding(pooled: float, of_scenes: Sequence[float], whole: bool) -> str:
    """pooled, of_scenes: what has to be positive, dB; whole: whether the rest of the claim holds too."""
    if pooled < EVEN:
        return "refuted"
    return "shown" if whole and min(of_scenes) >= EVEN else "shown in part"


def _few(of_scenes: Sequence[float]) -> str:
    return f" (fewer than {FEW} scenes: this may be chance)" if len(of_scenes) < FEW else ""


def _rising(values: Iterable[float]) -> bool:
    """Whether each value is above the one before, or less than EVEN below."""
    return all(after > before - EVEN for before, after in pairwise(values))
