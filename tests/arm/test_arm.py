import shutil

import pytest

from panchroma.shared.errors import InputError
from tests.arm import __main__ as arm
from tests.arm.probe import LAYOUTS, PATTERNS, graphs


@pytest.mark.skipif(
    shutil.which(arm.QEMU) is None,
    reason="ARM boards: qemu-aarch64 is not installed: apt-get install qemu-user",
)
def test_an_arm_board_makes_the_same_bytes() -> None:
    try:
        _, compared, faults = arm.check("cortex-a72")
    except arm.UnreachableError as error:
        pytest.skip(
            f"ARM boards: the package index is out of reach ({error}): connect to a network"
        )
    assert faults == []
    assert compared == sum(
        len(graphs(pattern)) - 1 + 2 * len(LAYOUTS) for pattern in PATTERNS.values()
    )


def test_only_a_download_that_is_out_of_reach_is_no_fault() -> None:
    for said, kind in (
        ("Temporary failure resolving 'deb.debian.org'", arm.UnreachableError),
        (
            "Failed to establish a new connection: [Errno 101] Network is unreachable",
            arm.UnreachableError,
        ),
        ("ERROR: No matching distribution found for onnxruntime>=99", InputError),
        ("dpkg-deb: error: not a Debian format archive", InputError),
    ):
        with pytest.raises(InputError) as raised:
            arm._run(["sh", "-c", 'echo "$0" >&2; exit 1', said])
        assert raised.type is kind, said
