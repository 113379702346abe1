"""What a result depends on: what it reaches counts, and nothing else."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tools.evaluation import code_digest as sources
from tools.evaluation.code_digest import digest
from tools.evaluation.methods import methods

TREE = {
    "tools/__init__.py": "",
    "tools/entry.py": '''
"""Of the module."""
from shared import Lens as Glass
from . import table
from .steps import blur

def look(scene):
    """Of the function."""
    from .late import polish
    return polish(blur(scene, Glass(2.0).bend()) * table.GAIN)

def unrelated():
    return 1
''',
    "tools/steps.py": """
from shared.kinds import Kind
_WIDTH = 3
_LENGTH = 4

def blur(scene, by, kind: "Kind" = None):
    return _inner(scene) * _WIDTH

def _inner(scene):
    return scene

def sharpen(scene):
    return _inner(scene) * _LENGTH
""",
    "tools/table.py": "GAIN = 2\nLOSS = 3\n",
    "tools/late.py": "def polish(scene):\n    return scene\n",
    "shared/__init__.py": "from .lens import Lens\nfrom .other import Other\n",
    "shared/other.py": "class Other:\n    pass\n",
    "shared/kinds.py": "class Kind:\n    size = 1\n",
    "shared/lens.py": '''
class Optic:
    def __init__(self, power):
        self.power = power

class Lens(Optic):
    """Of the class."""
    def bend(self):
        """Of the method."""
        return self._half()

    def _half(self):
        return self.power / 2

    def describe(self):
        return "a lens"
''',
}
Change = Callable[[str, str, str], None]


@pytest.fixture
def change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Change]:
    """(file, before, after): in a small tree of sources that stands for ours."""
    monkeypatch.setattr(sources, "_ROOT", tmp_path)

    def forget() -> None:
        for each in (sources.digest, sources._source, sources._path):
            each.cache_clear()

    def edit(name: str, before: str, after: str) -> None:
        text = (tmp_path / name).read_text()
        assert before in text
        (tmp_path / name).write_text(text.replace(before, after, 1))
        forget()

    for name, text in TREE.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    forget()
    yield edit
    monkeypatch.undo()
    forget()


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("tools/entry.py", "scene, Glass", "-scene, Glass"),  # itself
        ("tools/steps.py", "return scene\n", "return -scene\n"),  # what a called function calls
        ("tools/steps.py", "_WIDTH = 3", "_WIDTH = 5"),  # a constant
        ("tools/table.py", "GAIN = 2", "GAIN = 5"),  # by the module's name
        ("tools/late.py", "return scene", "return -scene"),  # imported in a function
        ("shared/lens.py", "self.power = power", "self.power = -power"),  # a base class, through a package, under another name
        ("shared/lens.py", "self.power / 2", "self.power / 3"),  # a method that a used method uses
        ("shared/kinds.py", "size = 1", "size = 2"),  # by a quoted annotation alone
        ("shared/__init__.py", "from .lens import Lens", "from .other import Other as Lens"),
    ],
)
def test_what_is_reached_counts(change: Change, name: str, before: str, after: str) -> None:
    old = digest("tools.entry:look")
    change(name, before, after)
    assert digest("tools.entry:look") != old
    change(name, after, before)
    assert digest("tools.entry:look") == old


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("tools/entry.py", "return 1", "return 2"),
        ("tools/entry.py", '"""Of the module."""', "# another remark"),
        ("tools/entry.py", '"""Of the function."""\n', '"""Said otherwise."""\n\n    # and at length\n'),
        ("tools/steps.py", "_LENGTH = 4", "_LENGTH = 5"),
        ("tools/steps.py", "def sharpen(scene):", "def sharpen(scene, more=1):"),
        ("tools/table.py", "LOSS = 3", "LOSS = 4"),
        ("shared/other.py", "pass", "size = 1"),
        ("shared/lens.py", '"""Of the class."""', '"""Said otherwise."""'),
        ("shared/lens.py", '"""Of the method."""', '"""Said otherwise."""'),
        ("shared/lens.py", '"a lens"', '"some glass"'),  # a method that nothing reached calls
    ],
)
def test_what_is_not_reached_does_not_count(change: Change, name: str, before: str, after: str) -> None:
    old = digest("tools.entry:look")
    change(name, before, after)
    assert digest("tools.entry:look") == old


def test_a_method_can_be_an_entry(change: Change) -> None:
    old = digest("shared.lens:Lens.describe")
    change("shared/lens.py", "self.power / 2", "self.power / 3")
    assert digest("shared.lens:Lens.describe") == old
    change("shared/lens.py", '"a lens"', '"some glass"')
    assert digest("shared.lens:Lens.describe") != old


def test_nothing_is_not_a_source() -> None:
    with pytest.raises(ValueError, match=r"tools\.evaluation\.metrics:nothing"):
        digest("tools.evaluation.metrics:nothing")


ALGORITHM = {
    "paper": "offline.kernels.averaging:_weigh",
    "preview": "device.border:ExtendedFrame",
    "bilinear": "tools.evaluation.rivals.bilinear:_GREEN",
    "dlmmse": "tools.evaluation.rivals.dlmmse:_moving_mean",
    "ahd": "tools.evaluation.rivals.integers:Levels",
    "ea": "tools.evaluation.rivals.integers:Levels",
    "bm3d+menon": "tools.evaluation.rivals.denoising:_even_out",
}
SHARED_BY_ALL = (
    "tools.evaluation.metrics:patch_psnr",
    "tools.evaluation.ssim:_blur",
    "tools.evaluation.protocol:_camera",
    "shared.sensor:typical_noise",
)


@pytest.mark.parametrize("name", ALGORITHM)
def test_a_result_depends_on_its_algorithm_its_noise_and_its_measure(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []

    def spy(*entries: str) -> str:
        seen.extend(entries)
        return ""

    monkeypatch.setattr("tools.evaluation.methods.digest", spy)
    methods()[name].identity()
    reached = {f"{module}:{each}" for module, each in sources._Walk(tuple(seen)).reached}
    assert {ALGORITHM[name], *SHARED_BY_ALL} <= reached
    modules = {each.partition(":")[0] for each in reached}
    assert not modules & {
        "tools.evaluation.page.page",
        "tools.evaluation.figures",
        "shared.dng.file",
        "tools.commands.render",
        "tools.scenes.load",
    }
    if name != "paper":
        assert not any(module.startswith("offline") for module in modules)
