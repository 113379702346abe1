"""The presets of the renderer, each once."""

from offline import BEST, PAPER, RenderSettings


def presets() -> dict[str, RenderSettings]:
    """By name; `best` only where it differs from `paper`."""
    return {"paper": PAPER} if BEST == PAPER else {"paper": PAPER, "best": BEST}
