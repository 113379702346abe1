"""Timings as lines for people."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tools.host.memory import format_bytes

from .files import FileTiming
from .preview import PreviewTiming
from .rounds import Timing

_NAME = 34


def environment_lines(facts: dict[str, Any]) -> list[str]:
    """The machine and the libraries, from `environment`."""
    packages = ", ".join(f"{name} {known}" for name, known in facts["packages"].items() if known)
    load = "" if facts["load"] is None else f", load {facts['load']:.1f}"
    return [
        f"{facts['processor']}, {facts['cores']} cores, {facts['threads']} threads used{load}; {facts['system']}",
        f"Panchroma {facts['panchroma']}, Python {facts['python']}, {packages}",
    ]


def speed_lines(ours: dict[str, Timing], stages: dict[str, dict[str, Timing]], rivals: dict[str, Timing | None]) -> list[str]:
    """Megapixels per second, and for each rival how many times as fast each preset is.

    ours: timings by name.
    stages: timings of the stages of each preset.
    rivals: timings by name; None for a rival that is not installed.
    """
    presets = list(stages)
    heading = f"{'MP/s':<{_NAME}}{'least':>9}{'median':>9}{'most':>9}"
    lines = [heading + "".join(f"{f'{name} is':>13}" for name in presets)]
    for name, timing in ours.items():
        lines.append(_speed(name, timing))
        lines += [_speed(f"  {stage}", each) for stage, each in stages.get(name, {}).items()]
    for name, rival in rivals.items():
        if rival is None:
            lines.append(f"{name:<{_NAME}} not installed: pip install -e '.[evaluation]'")
            continue
        ratios = (f"{ours[preset].times_as_fast_as(rival):.2f} x" for preset in presets)
        lines.append(_speed(name, rival) + "".join(f"{ratio:>13}" for ratio in ratios))
    return lines


def _speed(name: str, timing: Timing) -> str:
    return f"{name:<{_NAME}}" + "".join(f"{speed:>9.{2 if speed < 100 else 0}f}" for speed in timing.speed)


def preview_lines(timings: Iterable[PreviewTiming]) -> list[str]:
    """Speed, milliseconds and memory of the preview, a line per scale."""
    titles = ("preview", "MP", "MP/s", "median ms", "99 % ms", "import ms", "first ms", "memory", "after")
    rows = [
        (
            f"1 : {each.scale}",
            f"{each.pixels / 1e6:.1f}",
            f"{each.pixels / 1e6 / each.middle:.0f}",
            *(f"{1e3 * seconds:.0f}" for seconds in (each.middle, each.slowest, each.imported, each.first)),
            f"+{format_bytes(each.grown)}",
            f"{each.leaked / 2**20:+.1f} MB",
        )
        for each in timings
    ]
    return _columns(titles, rows)


def scaling_lines(timings: Mapping[str, Sequence[FileTiming]]) -> list[str]:
    """Seconds per megapixel, and the peak memory of the whole process, by preset."""
    titles = ("preset", "MP", "render s/MP", "file to file s/MP", "seconds", "peak memory")
    rows = [
        (
            preset,
            f"{each.pixels / 1e6:.1f}",
            *(f"{seconds / each.pixels * 1e6:.3f}" for seconds in (each.rendering, each.whole)),
            f"{each.whole:.1f}",
            format_bytes(each.peak),
        )
        for preset, found in timings.items()
        for each in found
    ]
    return _columns(titles, rows)


def _columns(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) + 2 for column in zip(titles, *rows, strict=True)]
    return ["".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True)) for row in (titles, *rows)]
