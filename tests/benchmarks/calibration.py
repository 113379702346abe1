"""Measure the accuracy of calibration on photographs: python -m tests.benchmarks.calibration

Gamma and colour of those test photographs that show a chart, without dark or flat frames.
`tests.benchmarks.coverage` draws cameras at random.
"""

from panchroma.shared import InputError
from panchroma.tools.calibration.conclude import conclude
from panchroma.tools.calibration.measure import Measurements, measure_chart
from tests.tools.calibration.known_camera import REFERENCE, shot_of

CHARTS = (
    "chart/g2_full.crw", "raw/indoor1.dng", "raw/outdoor2.dng", "raw/outdoor4.dng",
    "chart/g2_cut_off.crw", "chart/s40_cut_off.crw", "chart/table_srgb.jpg",
)  # fmt: skip
COLOUR = ("mean_dE2000", "leave_one_out_dE2000", "light_unevenness")


def photograph(name: str) -> None:
    """Print gamma and colour from a shot simulated from a photograph."""
    mosaic = shot_of(name, 6)
    try:
        measured = measure_chart(name, mosaic, Measurements(REFERENCE))
    except InputError as error:
        print(f"{name}: refused: {error}")
        return
    outcome = conclude(Measurements(REFERENCE, mosaic, shots=[measured]))
    gamma, facts = measured.fit, outcome.facts
    off = ", ".join(f"{100 * (value - 1):+.2f}" for value in gamma.gamma)
    line = f"{name}: gamma off by {off} % (± {100 * gamma.worst:.1f})"
    line += "".join(f"; {name} {facts['colour'][name]}" for name in COLOUR if "colour" in facts)
    print(line + (f"; {outcome.refusal}" if outcome.refusal else ""), flush=True)


if __name__ == "__main__":
    for name in CHARTS:
        photograph(name)
