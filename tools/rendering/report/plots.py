"""The plots of the report: where the frames lie."""

from collections.abc import Sequence
from math import degrees

from tools.pictures.plot import Plot, round_step, ticks

from ..burst_files import BurstFile

_SIZE, _MARGINS = (420, 420), (58, 16, 16, 48)
_TURNS = (420, 240)


def shift_plot(frames: Sequence[BurstFile], reference: int) -> str:
    """Return a plot of where the scene lies in each frame, compared with the reference, in the order of the frames."""
    places = _places(frames)
    reach = 1.15 * max(0.5, *(abs(figure) for _, *place in places for figure in place[:2]))
    plot = Plot((-reach, reach), (reach, -reach), _SIZE, _MARGINS)
    steps = ticks((-reach, reach), round_step(2 * reach, 8))
    plot.columns(steps)
    plot.rows(steps)
    plot.name_axes("pixels to the right", "pixels down")
    plot.line([(right, down) for _, right, down, _ in places], "path")
    for index, right, down, _ in places:
        text = f"frame {index + 1}: {right:+.2f} pixels to the right, {down:+.2f} down"
        style = "fill:var(--mark)" if index == reference else "" if not frames[index].reason else "fill:var(--bad)"
        plot.dot(right, down, 6 if index == reference else 4.5, text, style)
        x, y = plot.at(right, down)
        plot.text(x + 8, y - 7, str(index + 1), "start")
    return plot.drawn("Shift of each frame")


def turn_plot(frames: Sequence[BurstFile]) -> str:
    """Return a plot of the rotation of each frame."""
    places = _places(frames)
    reach = 1.2 * max(0.02, *(abs(angle) for *_, angle in places))
    plot = Plot((0.4, len(frames) + 0.6), (-reach, reach), _TURNS, _MARGINS)
    plot.columns(ticks((1, len(frames)), max(1, round_step(max(len(frames) - 1, 1), 12))))
    plot.rows(ticks((-reach, reach), round_step(2 * reach, 4)))
    plot.name_axes("frame", "degrees")
    for index, *_, angle in places:
        style = "fill:var(--bad)" if frames[index].reason else "fill:var(--mark)"
        plot.bar(index + 1, angle, 0.6, f"frame {index + 1}: {angle:+.3f} degrees", style)
    return plot.drawn("Rotation of each frame")


def _places(frames: Sequence[BurstFile]) -> list[tuple[int, float, float, float]]:
    """(index, right, down, degrees) of the frames whose motion is known."""
    motions = [(index, frame.judged.motion) for index, frame in enumerate(frames) if frame.judged is not None]
    return [(index, motion.shift[1], motion.shift[0], degrees(motion.angle)) for index, motion in motions if motion is not None]
