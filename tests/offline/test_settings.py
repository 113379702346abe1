from collections.abc import Sequence
from dataclasses import fields, replace
from math import inf, nan
from typing import Any

import numpy as np
import pytest

from panchroma.offline import BEST, render
from panchroma.offline.burst import merge_burst
from panchroma.offline.settings import PAPER
from panchroma.offline.stage import Switch
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.errors import InputError

NEGATIVE, ZERO, ENDS = (-1,), (0,), (0.0, 1.0)
IMPOSSIBLE: dict[str, Sequence[Any]] = {
    **dict.fromkeys(("defects.contrast", "defects.deviations", "denoising.strength"), NEGATIVE),
    **dict.fromkeys(("pooling.curvature_error", "refinement.strength"), NEGATIVE),
    **dict.fromkeys(("propagation.softness", "propagation.likeness"), NEGATIVE),
    "chromaticity.repetitions": NEGATIVE,
    **dict.fromkeys(("defects.floor", "luminance.threshold", "denoising.threshold"), ZERO),
    **dict.fromkeys(("luminance.iterations", "affinity.iterations"), ZERO),
    **dict.fromkeys(("pooling.light", "refinement.floor"), ZERO),
    **dict.fromkeys(("highlights.shoulder", "luminance.decay", "affinity.tolerance"), ENDS),
    "noise.estimate": [1],
    "luminance.relative": [1],
    "denoising.sizes": [(), (8, 6), (0,), (64,), [4, 12], (4.0, 12), "4"],
    "pooling.passes": [
        *(((sigma, 0.1, 5),) for sigma in (-1.0, 1e9, "1")),
        *(((1.0, weight, 5),) for weight in (0.0, nan)),
        *(((1.0, 0.1, radius),) for radius in (0, 65, 5.0)),
        ((1.0, 0.1),),
        [(1.0, 0.1, 5)],
    ],
    "affinity.scales": [(), (0.5, 0.0), (0.5, True), (inf,), (1e4,), 0.5],
    "refinement.blur": [0.0, 1e9],
    "refinement.repetitions": [-1, 10**9],
    "correction.used": [1, None, "yes"],
}


@pytest.mark.parametrize(
    ("setting", "value"),
    [(setting, value) for setting, values in IMPOSSIBLE.items() for value in values],
)
def test_impossible_settings_are_refused_by_name(setting: str, value: Any) -> None:
    stage, knob = setting.split(".")
    with pytest.raises(InputError, match=rf"settings: ({stage}|switch)\.{knob} is .*, exp"):
        replace(getattr(PAPER, stage), **{knob: value})


WRONG: list[Any] = [None, "1", True, inf, nan, -inf, [0.5], 1j, (0.5,), Switch]
NUMBERS = [
    (stage.name, knob.name)
    for stage in fields(PAPER)
    for knob in fields(getattr(PAPER, stage.name))
    if type(getattr(getattr(BEST, stage.name), knob.name)) in (int, float)
]


@pytest.mark.parametrize(("stage", "knob"), NUMBERS)
def test_what_is_no_number_is_refused_where_one_belongs(stage: str, knob: str) -> None:
    settings = getattr(BEST, stage)
    is_whole = type(getattr(settings, knob)) is int
    for value in [*WRONG, *([2.5, 3.0, np.float32(3)] if is_whole else [])]:
        with pytest.raises(InputError, match=rf"settings: {stage}\.{knob} is .*, expected a "):
            replace(settings, **{knob: value})
    value = getattr(settings, knob)
    kind = np.int64 if is_whole else np.float64
    assert replace(settings, **{knob: kind(value)}) == settings


@pytest.mark.parametrize("stage", [field.name for field in fields(PAPER)])
def test_settings_of_another_stage_are_refused(stage: str) -> None:
    other = PAPER.noise if stage != "noise" else PAPER.defects
    words = rf"settings: {stage} is .*, expected \w*(Settings|Sw)"
    for value in (None, True, other):
        with pytest.raises(InputError, match=words):
            replace(PAPER, **{stage: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("settings", [None, "paper", PAPER.luminance])
def test_a_render_with_something_else_than_settings_is_refused(settings: Any) -> None:
    mosaic = Mosaic(np.ones((24, 24), np.float32), CfaPattern.bayer(6), SensorCalibration())
    for work in (render, lambda *given: merge_burst([given[0]], given[1])):
        with pytest.raises(InputError, match=r"settings is .*, expected RenderSettings"):
            work(mosaic, settings)
