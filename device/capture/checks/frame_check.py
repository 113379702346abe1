"""Whether frames are what their description says: the first that shows its filter pattern proves it, or proves it wrong.

All later ones are compared with that: see `SlipCheck`.

Raw frames have no header. In a wrong layout, or with a wrong pattern, they would be saved as pictures that look like noise or have
false colours. The samples themselves tell: rows resemble the next ones, colour sites are darker than their neighbours at one
period and one place only, the two greens of a block are equal, and no picture is darker than black.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from shared.errors import InputError

from ..frames import RawFrame, Sensor
from .proofs import Look, proofs
from .slip_check import SlipCheck, SlippedError

_NEXT = "; the next frames are looked at"
_UNPROVEN = "the frame does not show whether size, format and pattern are right ({reason})" + _NEXT
_GREENS = f"the frame does not show whether the greens are on the right diagonal (it has little colour){_NEXT}"
_COLOURS = f"the frame does not show whether each colour is where `pattern` says (it has little colour){_NEXT}"
_TWICE = 2  # convincing frames; the second shows that the first has as many rows as described


def checked(
    frames: Iterable[RawFrame],
    sensor: Sensor,
    note: Callable[[str], None],
    *,
    covered: bool = False,
    refused: Callable[[InputError], None] | None = None,
) -> Iterator[RawFrame]:
    """Pass frames on, and look at them: until some have confirmed the description of their sensor, and whether they still do.

    note: called with each sentence on what a frame leaves open, once.
    covered: whether the lens is covered. Then all that is checked is that no sample is too large or lit: the rest takes light.
    refused: called for a file that is not like those before it, which is left out: the next one begins anew. None = raise.
    Raises InputError, before the frame is passed on, at the first that proves the description wrong; it names the likely right one.
    Raises SlippedError when a stream has lost or gained bytes since.
    """
    check, slips = _Check(sensor, covered=covered), SlipCheck(sensor)
    told: set[str] = set()
    for frame in frames:
        try:
            is_checked = check.is_sure and slips.look(frame, covered=covered)
            remarks = check.look(frame)
        except SlippedError as error:
            reason = SlippedError(frame.named(error))
            if refused is None or not frame.source:
                raise reason from None
            refused(reason)
            continue
        except InputError as error:
            raise InputError(frame.named(error)) from None
        for remark in remarks:
            if remark not in told:
                note(remark)
                told.add(remark)
        yield replace(frame, is_checked=is_checked)


class _Check:
    """What the frames so far have confirmed. For the arguments see `checked`."""

    def __init__(self, sensor: Sensor, *, covered: bool) -> None:
        self._sensor, self._covered = sensor, covered
        self._seen = self._confirmed = 0
        self._colours = self._bits = False

    @property
    def is_sure(self) -> bool:
        """Whether frames so far have shown what all others have to be like; dark ones are compared with the first."""
        return self._confirmed >= _TWICE or (self._covered and self._seen > 0)

    def look(self, frame: RawFrame) -> list[str]:
        """What the frame leaves open, a sentence each.

        Frames are looked at until two have shown the pattern, and then the less often, the more have left something open.
        Raises InputError, with the likely right value, if the frame proves something wrong.
        """
        self._seen += 1
        rarely, shown = self._seen & (self._seen - 1) == 0, self._confirmed >= _TWICE
        if (shown and self._colours and self._bits) or ((self._covered or shown) and not rarely):
            return []
        look = Look(frame, self._sensor, confirmed=self._confirmed > 0, thorough=rarely)
        if not self._covered and not look.found and look.levels.are_dark():
            return [_UNPROVEN.format(reason="it is dark")]
        found = iter([look.levels_of(look.codes).lit()]) if self._covered else proofs(look)
        if proof := next(filter(None, found), None):
            told = f"the frame is not as described: {proof.seen}; likely {proof.likely}"
            raise InputError(f"{told}. If the description is right, add `unchecked`")
        if self._covered or not look.shown:
            return [] if self._covered else [_UNPROVEN.format(reason=look.levels.hiding())]
        self._confirmed += 1
        self._colours |= look.coloured is not None
        unsettled = look.levels.unsettled()
        self._bits |= not unsettled
        left = [] if self._colours else [_COLOURS if look.pattern.is_scattered else _GREENS]
        return left if self._bits else [*left, f"{unsettled}{_NEXT}"]
