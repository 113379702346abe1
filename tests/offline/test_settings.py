from dataclasses import FrozenInstanceError, replace
from typing import Any

import pytest

from offline.settings import (
    PAPER,
    AffinitySettings,
    ChromaticitySettings,
    DefectSettings,
    DenoisingSettings,
    HighlightSettings,
    LuminanceSettings,
    PoolingSettings,
    PropagationSettings,
    RefinementSettings,
)
from shared.errors import InputError


@pytest.mark.parametrize(
    ("part", "knob", "value"),
    [
        (DefectSettings(), "contrast", -1.0),
        (DefectSettings(), "deviations", -1.0),
        (DefectSettings(), "floor", 0.0),
        (HighlightSettings(), "shoulder", 0.0),
        (HighlightSettings(), "shoulder", 1.0),
        (LuminanceSettings(), "iterations", 0),
        (LuminanceSettings(), "decay", 0.0),
        (LuminanceSettings(), "decay", 1.0),
        (LuminanceSettings(), "threshold", 0.0),
        (LuminanceSettings(), "threshold", float("nan")),
        (DenoisingSettings(), "strength", -1.0),
        (DenoisingSettings(), "strength", float("nan")),
        (DenoisingSettings(), "sizes", ()),
        (DenoisingSettings(), "sizes", (8, 6)),
        (DenoisingSettings(), "sizes", (0,)),
        (DenoisingSettings(), "sizes", (64,)),
        (DenoisingSettings(), "threshold", 0.0),
        (DenoisingSettings(), "share", 1.1),
        (DenoisingSettings(), "share", -0.1),
        (DenoisingSettings(), "similarity", 0.0),
        (DenoisingSettings(), "radius", 0),
        (DenoisingSettings(), "radius", 17),
        (PoolingSettings(), "passes", ((1.0, 0.0, 5),)),
        (PoolingSettings(), "passes", ((-1.0, 0.1, 5),)),
        (PoolingSettings(), "passes", ((1.0, 0.1, 0),)),
        (PoolingSettings(), "passes", ((1.0, 0.1, 65),)),
        (PoolingSettings(), "passes", ((1.0, 0.1),)),
        (PoolingSettings(), "light", 0.0),
        (PoolingSettings(), "doubt", -0.1),
        (ChromaticitySettings(), "taps", 4),
        (ChromaticitySettings(), "taps", -1),
        (ChromaticitySettings(), "repetitions", -1),
        (ChromaticitySettings(), "trust", -1.0),
        (AffinitySettings(), "scales", ()),
        (AffinitySettings(), "scales", (0.5, 0.0)),
        (AffinitySettings(), "tolerance", 0.0),
        (AffinitySettings(), "tolerance", 1.0),
        (AffinitySettings(), "iterations", 0),
        (PropagationSettings(), "softness", -0.1),
        (PropagationSettings(), "softness", float("inf")),
        (RefinementSettings(), "strength", -1.0),
        (RefinementSettings(), "floor", 0.0),
        (RefinementSettings(), "blur", 0.0),
        (RefinementSettings(), "repetitions", -1),
    ],
)
def test_impossible_settings_are_refused_by_name(part: Any, knob: str, value: Any) -> None:
    with pytest.raises(InputError, match=rf"settings: \w+\.{knob} is .*, expected"):
        replace(part, **{knob: value})


def test_settings_are_frozen_values() -> None:
    assert replace(PAPER) == PAPER
    with pytest.raises(FrozenInstanceError):
        PAPER.luminance.iterations = 1  # type: ignore[misc]
