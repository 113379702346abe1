"""Short trainings of both networks: they learn, go on where they stopped, and write what the render
runs. PyTorch is not in CI.
"""

import json
import shutil
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panchroma.offline.stages.block_network import LINES, PLANES, PROPOSALS, mixed
from panchroma.offline.stages.colour_network import BASIS, SURROUNDINGS
from panchroma.offline.stages.luminance_network import SIDE
from panchroma.shared import CfaPattern
from panchroma.shared.errors import InputError
from panchroma.shared.networks import load_network, network_for
from panchroma.shared.runtime import session
from panchroma.tools.batch.progress import StageProgress
from panchroma.tools.io.display import quantise
from panchroma.tools.simulation.load import load_scene

torch = pytest.importorskip(
    "torch", reason="training: PyTorch is not installed: pip install -e '.[training]'"
)

from panchroma.tools.training import blocks, run  # noqa: E402
from panchroma.tools.training.__main__ import main  # noqa: E402
from panchroma.tools.training.examples import DRAWN, PAGE  # noqa: E402
from panchroma.tools.training.graph import load_weights, save_graph  # noqa: E402
from panchroma.tools.training.luminance import examples, learn, save  # noqa: E402
from panchroma.tools.training.network import Network, units  # noqa: E402

pytestmark = pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning"
)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """Twenty-one small pictures."""
    from PIL import Image

    folder = tmp_path_factory.mktemp("photographs")
    codes = quantise(load_scene("builtin:420x280").rgb ** (1 / 2.2), 8).astype(np.uint8)
    for number in range(21):
        row, column = 4 * number, 9 * number
        window = codes[row : row + 120, column : column + 130]
        Image.fromarray(window).save(folder / f"{number:02d}.png")
    return tuple(str(path) for path in sorted(folder.iterdir()))


SILENT = StageProgress()


class Reports(StageProgress):
    """Keeps the remarks, the losses of a training; the one that begins with `last` interrupts
    it.
    """

    def __init__(self, last: str = "never") -> None:
        super().__init__()
        self.texts, self._last = list[str](), last

    def remark(self, text: str) -> None:
        self.texts.append(text)
        if text.startswith(self._last):
            raise KeyboardInterrupt


def small(photographs: tuple[str, ...], steps: int) -> run.Plan:
    return run.Plan(photographs, CfaPattern.bayer(4), steps, batch=2, variants=1, patch=6)


@pytest.fixture(scope="module")
def examples_made(photographs: tuple[str, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the examples of `small`."""
    folder = tmp_path_factory.mktemp("examples")
    run.train(small(photographs, 1), folder, 1, SILENT)
    for name in ("plan.json", "checkpoint.pt"):
        (folder / "rggb-k4" / name).unlink()
    return folder


@pytest.fixture
def folder(examples_made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(examples_made, tmp_path / "trained"))


def test_it_learns_and_writes_what_the_render_runs(
    photographs: tuple[str, ...], folder: Path
) -> None:
    path = run.train(small(photographs, 240), folder, 1, reports := Reports())
    assert reports.texts[-1].startswith("step 240: left 0.")
    assert load_network(path).get_inputs()
    assert json.loads((folder / "rggb-k4" / "plan.json").read_text())["steps"] == 240


def test_an_interrupted_training_ends_with_the_same_weights_and_no_other_goes_on_there(
    photographs: tuple[str, ...], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "_REPORT", 2)
    plan, folders = small(photographs, 6), (folder, shutil.copytree(folder, tmp_path / "second"))
    expected = run.train(plan, folders[0], 1, SILENT).read_bytes()
    with pytest.raises(KeyboardInterrupt):
        run.train(plan, folders[1], 1, Reports("step 4"))
    assert run.train(plan, folders[1], 1, reports := Reports()).read_bytes() == expected
    assert [report.split(":")[0] for report in reports.texts] == ["step 6"]
    with pytest.raises(InputError, match="holds another training"):
        run.train(small(photographs, 7), folder, 1, SILENT)


ORDER = [0, 2, 1, 3]  # the greens change places


@pytest.mark.parametrize(
    ("tile", "transposed", "exchanged"),
    [
        ("K=6", ORDER, True),
        ("K=5", ORDER, False),
        ("kodak", [], True),
        ("RGWW/BWWW/WWWW/WWWW", [], False),
        ("GRWW/WGWW/WWWW/WWWW", [0, 2, 1], False),
    ],
)
def test_what_is_learned_from_is_turned_as_a_whole(
    tile: str, transposed: list[int], exchanged: bool
) -> None:
    """As if the picture had been turned."""
    plan = run.Plan((), CfaPattern.of_letters(tile), 1)
    assert (plan.transposed, plan.exchanged) == (transposed, exchanged)
    period, sites = plan.pattern.period, len(plan.pattern.sites)
    random = np.random.default_rng(0)
    shapes = (3, 12 * period, 14 * period), (3, 12 * period, 14 * period), (sites, 12, 14)
    parts = [random.uniform(0.2, 1, shape).astype(np.float32) for shape in (*shapes, (1, 12, 14))]
    for aside, over in product((False, bool(transposed)), (False, exchanged)):
        other = [part.copy() for part in parts]
        if aside:
            other = [part.transpose(0, 2, 1) for part in other]
            other[2] = other[2][transposed]
        if over:
            other = [part[:, ::-1, ::-1] for part in other]
            other[:3] = [part[::-1] for part in other[:3]]
        example = [torch.from_numpy(planes).float() for planes in run.prepare(plan.pattern, parts)]
        found = run.turn_window(example, run.turned(plan, transposed=aside, exchanged=over))
        expected = run.prepare(plan.pattern, [np.ascontiguousarray(part) for part in other])
        for mine, its in zip(found, expected, strict=True):
            assert mine.numpy() == pytest.approx(its.astype(np.float32), abs=4e-3)


def test_training_begins_with_the_weights_for_the_same_places() -> None:
    """Beside a block of two, a superpixel of five has one pixel before it, one of six has two."""
    six, five = CfaPattern.bayer(6), CfaPattern.bayer(5)
    whole, part = run.weights_for(six, six), run.weights_for(five, six)
    assert part["enter.weight"].shape[1] == 3 * 25 + 9
    assert part["leave.bias"].shape == (2 * 25 + 4,)
    for name, planes, tail in (("enter.weight", 3, 9), ("leave.weight", 2, 4)):
        axis = int(name == "enter.weight")
        known, chosen = (np.moveaxis(weights[name], axis, 0) for weights in (whole, part))
        expected = known[: planes * 36].reshape(planes, 6, 6, -1)[:, 1:, 1:]
        assert np.array_equal(chosen[: planes * 25].reshape(planes, 5, 5, -1), expected)
        assert np.array_equal(chosen[planes * 25 :], known[planes * 36 :][:tail])
    bayer, three = CfaPattern.bayer(4), CfaPattern.with_block(("WB", "GR"), 4)
    of_bayer, of_three = (run.weights_for(other, bayer)["enter.weight"] for other in (bayer, three))
    assert np.array_equal(of_three, np.delete(of_bayer, 50, axis=1))
    with pytest.raises(InputError, match=r"no network for RGWWWWW/.* to begin with"):
        run.weights_for(six, CfaPattern.bayer(7))


def test_sites_of_a_colour_begin_with_those_of_another_pattern_in_turn() -> None:
    kaizu, bayer = CfaPattern.of_letters("kaizu"), CfaPattern.bayer(6)
    of_sites, known = (
        run.weights_for(each, bayer)["enter.weight"][:, 3 * 36 :] for each in (kaizu, bayer)
    )
    letters = "".join("".join(row) for row in kaizu.letters_from()).replace("W", "")
    greens = iter([1, 2] * 3)
    numbers = [{"R": 0, "B": 3}[letter] if letter != "G" else next(greens) for letter in letters]
    assert np.array_equal(of_sites[:, :18], known[:, numbers])
    assert np.array_equal(of_sites[:, 18:], known[:, 4 : 4 + SURROUNDINGS])


def random_network(period: int, sites: int) -> Network:
    torch.manual_seed(1)
    network = Network(period, sites)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.03)
    return network


def batch(pattern: CfaPattern) -> list[Any]:
    """A batch of one picture, whose contrast drowns in the noise on the right."""
    random, (down, across) = np.random.default_rng(0), (24, 21)
    shape, sites = (down * pattern.period, across * pattern.period), len(pattern.sites)
    light, tints = random.uniform(0.1, 1, shape), random.uniform(0, 1, (3, *shape))
    picture = (light * tints).astype(np.float32)
    error = random.normal(0, 0.05, (sites, down, across)).astype(np.float32)
    variance = np.tile(np.linspace(0, 0.4, across, dtype=np.float32), (1, down, 1))
    prepared = run.prepare(pattern, [picture, picture, error, variance])
    return [torch.from_numpy(planes[None]).float() for planes in prepared]


@pytest.mark.parametrize("tile", ["K=4", "K=5", "kodak", "RGWW/BWWW/WWWW/WWWW"])
def test_the_file_computes_what_the_network_does(tmp_path: Path, tile: str) -> None:
    """Rounded to 8 bits, it is off by 1 to 3 %.

    Where a superpixel is the same in another orientation, the file answers by the mean of what the
    network finds in both: transposed, or after half a turn with red and blue in exchange, or after
    both.
    """
    plan = run.Plan((), CfaPattern.of_letters(tile), 1)
    sites, period = len(plan.pattern.sites), plan.pattern.period
    network, path = random_network(period, sites), tmp_path / "one.onnx"
    planes = batch(plan.pattern)
    weights = {name: weight.numpy() for name, weight in network.state_dict().items()}
    inputs, exchange = planes[0], torch.tensor(BASIS[:, ::-1] @ BASIS.T)
    turn = run.turned(plan, transposed=bool(plan.transposed), exchanged=plan.exchanged)
    with torch.no_grad():
        alone = network(inputs)
        turned = network(run.turn_window([plane[0] for plane in planes], turn)[0][None])
    turned, light = turned.split([2 * period**2, sites], dim=1)
    planes = torch.nn.functional.pixel_shuffle(turned, period)
    if plan.exchanged:
        planes = torch.einsum("nchw,ck->nkhw", planes.flip(2, 3), exchange)
        light = light.flip(1, 2, 3)
    if plan.transposed:
        planes, light = planes.mT, light[:, plan.transposed].mT
    planes = torch.nn.functional.pixel_unshuffle(planes, period)
    planes = torch.cat([planes, light], dim=1)
    both = (alone + planes) / 2 if plan.transposed or plan.exchanged else alone
    steps = units(network, [batch(plan.pattern)])
    save_graph(weights, steps, path, turn)
    (output,) = load_network(path).run(None, {"features": inputs.numpy()})
    assert output.shape == both.shape
    assert np.linalg.norm(output - both.numpy()) < 0.03 * np.linalg.norm(both.numpy())
    kept = load_weights(path)
    assert kept.keys() == weights.keys()
    for name in weights.keys() - {"enter.weight"}:
        assert np.abs(kept[name] - weights[name]).max() < 1e-3


def test_weights_can_be_rounded_again_without_learning(
    photographs: tuple[str, ...], folder: Path
) -> None:
    start = CfaPattern.bayer(4)
    plan, shipped = replace(small(photographs, 0), start=start), network_for(start)
    paths = run.train(plan, folder, 1, SILENT), shipped
    kept, known = map(load_weights, paths)
    for name, values in known.items():  # it may know nothing of luminance
        assert np.array_equal(kept[name][: len(values)], values)


def test_too_small_and_too_few_pictures_are_refused(
    photographs: tuple[str, ...],
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    plan = run.Plan(photographs, CfaPattern.bayer(4), 1, variants=1, patch=200)
    with pytest.raises(InputError, match="too small to learn from"):
        run.train(plan, folder, 1, SILENT)
    for options, answer in (
        ([], "0 photographs found; at least 20 are needed"),
        (["--pattern", "RGBW/WWWW/WWWW/WWWW"], "has no square block of red, green and blue"),
        (["--pattern", "RGGB"], "pattern: the tile has no panchromatic pixel (W)"),
    ):
        arguments = ["training", str(folder), "-o", str(tmp_path / "out")]
        monkeypatch.setattr(sys, "argv", [*arguments, *options])
        with pytest.raises(SystemExit, match="2"):
            main()
        assert answer in capsys.readouterr().err


@pytest.mark.parametrize("sites", [3, 4])
def test_what_corrects_filled_luminance_is_learned_and_written(sites: int, tmp_path: Path) -> None:
    sources, reports = [DRAWN] * 11, list[str]()  # the last one is kept back
    parts = [examples(source, number, sites) for number, source in enumerate(sources)]
    network = learn(parts, sources, 100, reports.append)
    assert 0.5 < float(reports[-1].split()[3]) < 0.99
    save(network, tmp_path / "luminance.onnx")
    inputs = np.random.default_rng(0).normal(size=(5, SIDE**2 + 1)).astype(np.float32)
    (output,) = session(tmp_path / "luminance.onnx").run(None, {"seen": inputs})
    assert output.shape == (5, sites)
    assert output == pytest.approx(network(torch.from_numpy(inputs)).detach().numpy(), abs=1e-4)


@pytest.fixture(scope="module")
def blocks_made(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Files of examples for the network of blocks: drawings, and pages of print."""
    folder = tmp_path_factory.mktemp("blocks")
    paths = [folder / f"{number}.npz" for number in range(4)]
    for number, path in enumerate(paths):
        np.savez(path, *blocks.example((DRAWN, PAGE)[number % 2], (0, number)))
    return paths


def test_the_same_seed_gives_the_same_blocks(blocks_made: list[Path]) -> None:
    again = blocks.example(DRAWN, (0, 0))
    with np.load(blocks_made[0]) as arrays:
        assert all(map(np.array_equal, again, arrays.values()))
    planes, colour = again
    assert planes.shape == (PLANES, *colour.shape[1:])
    own = (planes[-3 * PROPOSALS :][:3].astype(np.float64) + 1) / 3
    colour = colour[:3]
    light = colour.sum(axis=0)
    bright = light > 0.5
    assert np.median(np.abs(own * light - colour)[:, bright]) < 0.1  # they show the same place


def test_blocks_with_red_and_blue_in_exchange_are_those_of_the_scene() -> None:
    """Every plane of red is that of blue then, and twice in exchange is what it was."""
    order = np.array(blocks._EXCHANGED)
    assert np.array_equal(order[order], np.arange(PLANES))
    assert np.count_nonzero(order != np.arange(PLANES)) == 2 * (4 + len(LINES) + PROPOSALS)


def test_the_network_of_blocks_learns_goes_on_and_is_written(
    blocks_made: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sides, reports = (blocks_made, blocks_made), Reports()
    with pytest.raises(InputError, match="too small to learn from"):
        blocks.learn(blocks.first_network(), ([], blocks_made), 6, tmp_path, SILENT)
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        folder.mkdir()
    network = blocks.learn(blocks.first_network(), sides, 6, one, reports)
    monkeypatch.setattr(blocks, "_REPORT", 3)
    with pytest.raises(KeyboardInterrupt):
        blocks.learn(blocks.first_network(), sides, 6, other, Reports("step 3"))
    again = blocks.learn(blocks.first_network(), sides, 6, other, SILENT)
    assert len(reports.texts) == 1
    for mine, its in zip(network.parameters(), again.parameters(), strict=True):
        assert mine.detach().numpy() == pytest.approx(its.detach().numpy(), abs=1e-6)
    with np.load(blocks_made[0]) as arrays:
        inputs = next(iter(arrays.values()))[None, :, :24, :24].astype(np.float32)
    inputs = np.pad(inputs, [(0, 0), (0, 0), (64, 64), (64, 64)], "edge")
    with torch.no_grad():
        for layer in network.parameters():
            layer.add_(0.02 * torch.randn(layer.shape))
        found = network(torch.from_numpy(inputs))
    blocks.save(network, tmp_path / "blocks.onnx", blocks_made)
    (answer,) = session(tmp_path / "blocks.onnx").run(None, {"planes": inputs})
    lines = torch.cat(blocks.lines(torch.from_numpy(inputs), found), 1).numpy()
    for mine, its in ((answer, found.numpy()), (mixed(inputs[0], answer[0]), lines[0])):
        missed = (mine - its)[..., 64:-64, 64:-64]  # what lies beyond is zero in the file
        assert np.linalg.norm(missed) < 0.1 * np.linalg.norm(its[..., 64:-64, 64:-64])
    begun = blocks.first_network(tmp_path / "blocks.onnx")
    for mine, its in zip(network.parameters(), begun.parameters(), strict=True):
        assert mine.detach().numpy() == pytest.approx(its.detach().numpy(), rel=1e-3, abs=1e-6)
    for path in (Path(__file__), network_for(CfaPattern.bayer(6)), tmp_path / "none.onnx"):
        with pytest.raises(InputError, match=f"{path.name}: no network of blocks"):
            blocks.first_network(path)
