"""How a run is divided."""

import pytest

from shared.errors import InputError
from tools.rendering.shard import Shard


def test_every_picture_is_in_one_shard_and_they_are_alike_in_size() -> None:
    shards = [Shard.parse(f"{index}/7") for index in range(1, 8)]
    names = [f"sub/IMG_{number:04}.tif" for number in range(1000)]
    assert all(sum(shard.has(name) for shard in shards) == 1 for name in names)
    # 143 each on average, with a standard deviation of 11.
    assert all(100 < sum(shard.has(name) for name in names) < 190 for shard in shards)


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "1/0", "-1/3", "a/b", "1/3/5", "", "1.0/2"])
def test_a_shard_that_is_none(text: str) -> None:
    with pytest.raises(InputError, match="`shard` is"):
        Shard.parse(text)
