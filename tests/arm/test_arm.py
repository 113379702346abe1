import shutil

import pytest

from panchroma.shared.errors import InputError
from tests.arm import __main__ as arm
from tests.arm.probe import LAYOUTS, PATTERNS, graphs


@pytest.mark.skipif(shutil.which(arm.QEMU) is None, reason="qemu-aarch64 is not installed")
def test_an_arm_board_makes_the_same_bytes() -> None:
    try:
        _, compared, faults = arm.check("cortex-a72")
    except InputError as missing:  # no network
        pytest.skip(str(missing))
    assert faults == []
    assert compared == sum(
        len(graphs(pattern)) - 1 + 2 * len(LAYOUTS) for pattern in PATTERNS.values()
    )
