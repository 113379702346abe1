import shutil

import pytest

from panchroma.shared.errors import InputError
from tests.arm import __main__ as arm
from tests.arm.probe import LAYOUTS, PATTERNS, graphs

NEEDS_QEMU = "ARM boards: qemu-aarch64 is not installed: apt-get install qemu-user"


@pytest.mark.skipif(shutil.which(arm.QEMU) is None, reason=NEEDS_QEMU)
def test_an_arm_board_makes_the_same_bytes() -> None:
    try:
        _, compared, faults = arm.check("cortex-a72")
    except arm.UnreachableError as error:
        remedy = "connect to a network"
        pytest.skip(f"ARM boards: the package index is out of reach ({error}): {remedy}")
    assert faults == []
    graphs_of = [len(graphs(pattern)) for pattern in PATTERNS.values()]
    assert compared == sum(count - 1 + 2 * len(LAYOUTS) for count in graphs_of)


@pytest.mark.parametrize(
    ("said", "kind"),
    [
        ("Temporary failure resolving 'deb.debian.org'", arm.UnreachableError),
        ("connection: [Errno 101] Network is unreachable", arm.UnreachableError),
        ("ERROR: No matching distribution found for onnxruntime>=99", InputError),
        ("dpkg-deb: error: not a Debian format archive", InputError),
    ],
)
def test_only_a_download_that_is_out_of_reach_is_no_fault(
    said: str, kind: type[InputError]
) -> None:
    with pytest.raises(InputError) as raised:
        arm._run("sh", "-c", 'echo "$0" >&2; exit 1', said)
    assert raised.type is kind
