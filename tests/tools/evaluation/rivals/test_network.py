"""Networks: anybody's is fed as its description says, what is wrong is said with the file's
name.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import load, save

from panchroma.shared.errors import InputError
from panchroma.tools.evaluation.methods import choose
from panchroma.tools.evaluation.rivals.bilinear import demosaic_bilinear
from panchroma.tools.simulation.bayer import sample_bayer
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.protocols import BayerShot
from panchroma.tools.training.graph import Graph, Values

WHITE = np.array([0.5, 1.0, 0.8], np.float32)
# of GRBG: red, green, blue, green
QUADS = {"x": {"form": "quads", "sites": [1, 0, 2, 3], "noise": True}}


def network(
    folder: Path, weights: np.ndarray, blocks: int, name: str = "mine", **fields: Any
) -> str:
    """A convolution with these weights, its planes then put into blocks x blocks pixels each; and
    its description.
    """
    graph = Graph()
    graph.store("w", weights.astype(np.float32))
    values = graph.add("Conv", ["x", "w"], "c")
    graph.add("DepthToSpace", [values], "y", blocksize=blocks)
    inputs: Values = "x", [1, weights.shape[1], "h", "w"]
    graph.write(folder / "mine.onnx", inputs, ("y", [1, 3, "H", "W"]))
    path = (folder / "mine.onnx").rename(folder / f"{name}.onnx")  # whose content knows no name
    (folder / f"{name}.json").write_text(json.dumps(fields))
    return str(path)


def of_quads(folder: Path, red: list[float], name: str = "mine", **fields: Any) -> str:
    """Every pixel of a quad has its mean colour; red is that of the five planes weighted so."""
    weights = np.tile([red, [0, 0.5, 0, 0.5, 0], [0, 0, 1, 0, 0]], (4, 1))
    return network(folder, weights[..., None, None], 2, name, **fields)


@pytest.mark.parametrize(
    ("order", "shape"),
    [("RGGB", (61, 80)), ("GRBG", (330, 75)), ("GBRG", (61, 80)), ("BGGR", (330, 75))],
)
def test_sparse_planes_of_any_order_are_those_of_bilinear_interpolation(
    tmp_path: Path, order: str, shape: tuple[int, int]
) -> None:
    weights = np.zeros((3, 3, 3, 3))
    weights[[0, 2], [0, 2]] = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
    weights[1, 1] = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
    path = network(tmp_path, weights, 1, order=order, inputs={"x": {"form": "sparse"}})
    mosaic = sample_bayer(builtin_scene(340, 340).rgb[: shape[0], : shape[1]])
    picture = choose([path])[0].function(BayerShot(mosaic, 0.0, 0.0), WHITE)[2:-2, 2:-2]
    np.testing.assert_allclose(picture, demosaic_bilinear(mosaic)[2:-2, 2:-2], atol=1e-5)


def test_balance_code_and_bias_are_undone(tmp_path: Path) -> None:
    """Quads in the network's own order, coded, with a bias that the last plane's weight takes off
    again.
    """
    fed = {"x": {**QUADS["x"], "add": [-0.25, 0, 0, 0], "noise": True}}
    path = of_quads(tmp_path, [1, 0, 0, 0, 0], order="GRBG", gamma=2.2, offset=0.01, inputs=fed)
    rgb = np.broadcast_to(np.array([0.3, 0.5, 0.2], np.float32), (40, 44, 3))
    picture = choose([path])[0].function(BayerShot(sample_bayer(rgb), 0.0, 0.0), WHITE)
    np.testing.assert_allclose(picture[..., 1:], rgb[..., 1:], atol=1e-5)
    low, high = 0.01 ** (1 / 2.2), 1.01 ** (1 / 2.2)
    code = ((0.3 / 0.5 + 0.01) ** (1 / 2.2) - low) / (high - low) - 0.25
    red = 0.5 * ((code * (high - low) + low) ** 2.2 - 0.01)
    np.testing.assert_allclose(picture[..., 0], red, atol=1e-5)


@pytest.mark.parametrize(("shot", "read"), [(0.0, 0.02), (0.004, 0.0)])
def test_noise_is_that_of_balanced_samples(tmp_path: Path, shot: float, read: float) -> None:
    path = of_quads(tmp_path, [0, 0, 0, 0, 1], order="GRBG", inputs=QUADS)
    grey = np.full((40, 44), 0.25, np.float32)
    picture = choose([path])[0].function(BayerShot(grey, shot, read), np.ones(3, np.float32))
    np.testing.assert_allclose(picture[..., 0], (shot * 0.25 + read**2) ** 0.5, rtol=1e-4)


def test_a_network_for_unbalanced_samples_gets_them_as_they_are(tmp_path: Path) -> None:
    shot = BayerShot(sample_bayer(builtin_scene(60, 60).rgb), 0.0, 0.0)
    for balanced in (True, False):
        fields: Any = {"order": "GRBG", "balanced": balanced, "gamma": 2.2, "inputs": QUADS}
        (method,) = choose([of_quads(tmp_path, [1, 0, 0, 0, 0], **fields)])
        first, second = (method.function(shot, white) for white in (WHITE, np.ones_like(WHITE)))
        assert np.array_equal(first, second) != balanced


def test_a_name_has_characters_that_plots_can_show(tmp_path: Path) -> None:
    (method,) = choose([of_quads(tmp_path, [1, 0, 0, 0, 0], "a$<\udc80\n", inputs=QUADS)])
    assert method.name.startswith("a____-")


MOSAIC = '"inputs": {"x": {"form": "mosaic"}}'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f'{{{MOSAIC}, "ordr": "RGGB"}}', "there is no field 'ordr'; did you mean order?"),
        ('{"order": "RGGB"}', "expected an object with 'inputs'"),
        ('[{"inputs": {}}]', "expected an object with 'inputs'"),
        ('["inputs"]', "expected an object with 'inputs'"),
        ('{"inputs": ["x"]}', "expected an object with 'inputs'"),
        ('{"inputs": {}}', "expected an object with 'inputs'"),
        ('{"inputs": {"x": {"form": "mosaic", "sides": [1]}}}', "input 'x' is .*'sites'"),
        ('{"inputs": {"x": {"form": ["mosaic"]}}}', "input 'x' is .*'form'"),
        (f'{{{MOSAIC}, "order": ["RGGB"]}}', "'order' is .*expected one of"),
        (f'{{{MOSAIC}, "order": "RGB"}}', "'order' is 'RGB', expected one of"),
        (f'{{{MOSAIC}, "gamma": "2"}}', "'gamma' above 0"),
        (f'{{{MOSAIC}, "gamma": NaN}}', "'gamma' above 0"),
        (f'{{{MOSAIC}, "gamma": 1{"0" * 400}}}', "'gamma' above 0"),
        (f'{{{MOSAIC}, "offset": Infinity}}', "'offset' of 0 or more"),
        (f'{{{MOSAIC}, "margin": 7}}', "'margin' .even"),
        (f'{{{MOSAIC}, "margin": 64.0}}', "'margin' .even"),
        (f'{{{MOSAIC}, "balanced": "no"}}', "'balanced' .true or false"),
        ("{" * 99_999, "Expecting property name"),
        ('{"inputs": ' * 99_999, "expected an object with 'inputs'"),
    ],
)
def test_a_wrong_description_is_answered_with_its_field_and_no_part_of_the_program(
    tmp_path: Path, text: str, said: str
) -> None:
    path = of_quads(tmp_path, [1, 0, 0, 0, 0], inputs=QUADS)
    Path(path).with_suffix(".json").write_text(text)
    with pytest.raises(InputError, match=rf"mine\.json.*{said}") as caught:
        choose([path])
    words = str(caught.value).replace("an object with", "").split()
    assert {"__init__()", "argument", "NoneType", "object", "has"}.isdisjoint(words)


@pytest.mark.parametrize(
    "form",
    [
        {"form": "quads", "sites": [0, 1, 2, 9]},
        {"form": "quads", "sites": 4},
        {"form": "quads", "add": [0.0]},
        {"form": "quads", "noise": True, "crop": 999},
    ],
)
def test_an_input_that_cannot_be_made_is_one_line_with_the_name_of_the_file(
    tmp_path: Path, form: dict[str, Any]
) -> None:
    path = of_quads(tmp_path, [1, 0, 0, 0, 0], order="GRBG", inputs={"x": form})
    with pytest.raises(InputError, match=r"mine\.onnx: does not take what its JSON file says"):
        choose([path])[0].function(BayerShot(np.ones((40, 44), np.float32), 0.0, 0.0), WHITE)


def test_weights_in_another_file_are_part_of_what_a_network_is(tmp_path: Path) -> None:
    path = of_quads(tmp_path, [1, 0, 0, 0, 0], order="GRBG", inputs=QUADS)
    save(load(path), path, save_as_external_data=True, size_threshold=0, location="weights.bin")
    method, weights = choose([path])[0], tmp_path / "weights.bin"
    shot = BayerShot(np.ones((40, 44), np.float32), 0.0, 0.0)
    before = weights.read_bytes()
    weights.write_bytes(before[::-1])
    assert choose([path])[0].name != method.name
    with pytest.raises(InputError, match=r"mine\.onnx: has changed since"):
        method.function(shot, WHITE)
    weights.write_bytes(before)
    assert method.function(shot, WHITE).shape == (40, 44, 3)
    for name in ("weights.bin", "mine.json"):
        (tmp_path / name).rename(tmp_path / "away")
        with pytest.raises(InputError, match=rf"{name}: .*there is no such file"):
            choose([path])
        (tmp_path / "away").rename(tmp_path / name)
