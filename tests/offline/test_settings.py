from dataclasses import FrozenInstanceError, fields, replace
from math import inf, nan
from typing import Any

import pytest

from panchroma.offline.settings import PAPER
from panchroma.offline.stage import Switch
from panchroma.shared.errors import InputError

IMPOSSIBLE: dict[str, dict[str, list[Any]]] = {
    "defects": {"contrast": [-1.0], "deviations": [-1.0], "floor": [0.0]},
    "highlights": {"shoulder": [0.0, 1.0]},
    "luminance": {"iterations": [0], "decay": [0.0, 1.0], "threshold": [0.0, nan]},
    "denoising": {
        "strength": [-1.0, nan],
        "sizes": [(), (8, 6), (0,), (64,)],
        "threshold": [0.0],
    },
    "pooling": {
        "passes": [
            ((1.0, 0.0, 5),),
            ((-1.0, 0.1, 5),),
            ((1.0, 0.1, 0),),
            ((1.0, 0.1, 65),),
            ((1.0, 0.1),),
        ],
        "light": [0.0],
        "curvature_error": [-0.1],
    },
    "chromaticity": {"taps": [4, -1], "repetitions": [-1]},
    "affinity": {"scales": [(), (0.5, 0.0)], "tolerance": [0.0, 1.0], "iterations": [0]},
    "propagation": {"softness": [-0.1, inf], "likeness": [-1.0]},
    "refinement": {"strength": [-1.0], "floor": [0.0], "blur": [0.0], "repetitions": [-1]},
}


@pytest.mark.parametrize(
    ("part", "knob", "value"),
    [
        (part, knob, value)
        for part, knobs in IMPOSSIBLE.items()
        for knob, values in knobs.items()
        for value in values
    ],
)
def test_impossible_settings_are_refused_by_name(part: str, knob: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"settings: {part}\.{knob} is .*, expected"):
        replace(getattr(PAPER, part), **{knob: value})


def test_settings_are_frozen_values() -> None:
    assert replace(PAPER) == PAPER
    with pytest.raises(FrozenInstanceError):
        PAPER.luminance.iterations = 1  # type: ignore[misc]


def test_a_refusal_names_the_part_as_the_settings_do() -> None:
    """The name of a part in a refusal comes from its class."""
    parts = {field.name: type(getattr(PAPER, field.name)) for field in fields(PAPER)}
    assert all(
        kind is Switch or kind.__name__ == f"{name.capitalize()}Settings"
        for name, kind in parts.items()
    )
