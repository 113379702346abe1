"""Which shots belong to a part of the work."""

import hashlib
import os
from dataclasses import dataclass

from shared.errors import InputError


@dataclass(frozen=True)
class Shard:
    """Part `index` of `count`, 1 to count. A picture's path below the output folder alone decides which part it belongs to.

    So machines agree without communication, and a new file does not change the part of any other.
    """

    index: int
    count: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """The part that a text such as "3/8" names. Raises InputError."""
        index, _, count = text.partition("/")
        if index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count):
            return cls(int(index), int(count))
        raise InputError(f"`shard` is {text!r}, expected a part and their number, such as 3/8; parts are counted from 1")

    def has(self, output: str) -> bool:
        """Whether the picture with this path belongs to the part."""
        digest = hashlib.sha256(os.fsencode(output)).digest()
        return int.from_bytes(digest[:8], "big") % self.count == self.index - 1
