"""The checks of a frame: what each looks at, what it proves wrong, and what it advises."""

from collections.abc import Callable
from dataclasses import replace

from .layout_search import BIG_ENDIAN, BYTES, CLEARER, RAW14, Reading, best_reading, refined
from .level_check import Proof
from .look import Look
from .pattern_search import Found, find_pattern

Check = Callable[[Look], Proof | None]


def not_covered(look: Look) -> Proof | None:
    """The levels of a frame that is said to be dark: a sample that is too large, or light."""
    return look.levels_of(look.codes).lit()


def wrong_stride(look: Look) -> Proof | None:
    """Other distances at which rows repeat: one at which the pattern shows, and the declared one does not show it as well."""
    if not look.other_strides or (look.shown and look.aligned):
        return None
    reading = best_reading(look.data, look.layout, look.pattern, look.other_strides)
    clearer = CLEARER if look.aligned else 1 / CLEARER
    return _misread(look, reading) if reading and _is_clearer(reading.found, look, clearer) else None


def wrong_format(look: Look) -> Proof | None:
    """Other formats: one in which the pattern shows more clearly."""
    reading = look.reading if look.searched else None
    if reading is None or reading.format == look.layout.format or not _is_clearer(reading.found, look):
        return None
    return _misread(look, reading)


def swapped_bytes(look: Look) -> Proof | None:
    """Words with their bytes exchanged: they show the pattern more clearly, for the low byte alone may show it too, faintly."""
    if not look.shown or look.layout.format != "u16":
        return None
    swapped = find_pattern(look.codes.byteswap(), look.pattern)
    if swapped is None or not _is_clearer(swapped, look):
        return None
    return _misread(look, Reading(BIG_ENDIAN, look.layout.stride, 0, look.layout.width, swapped))


def wrong_levels(look: Look) -> Proof | None:
    """Levels that cannot be, in a frame that shows the pattern, or whose rows repeat nowhere."""
    return look.wrong_levels if look.shown or not look.aligned else None


def too_tall(look: Look) -> Proof | None:
    """The lower part of a frame: if the pattern is at another row there, the next frame begins in this one."""
    codes, pattern = look.codes, look.pattern
    if look.found and not look.shown:
        return None
    if not look.shown and not look.is_declared(find_pattern(codes[: len(codes) // 2], pattern)):
        return None
    for part in (2, 4):
        top = len(codes) * (part - 1) // part
        found = find_pattern(codes[top:], pattern)
        if found and found.sure and found.period == pattern.period:
            rows = {(row + top) % found.period for row, _ in found.places}
            if pattern.block_origin[0] not in rows:
                return _too_tall(look)
    return None


def wrong_place(look: Look) -> Proof | None:
    """The period of the colour sites, and where they are: elsewhere than described."""
    found, layout, pattern = look.found, look.layout, look.pattern
    if found is None or look.shown:
        return None
    if look.confirmed:
        return _too_tall(look)
    if found.period == 2:
        return Proof(
            "its colours repeat every 2 pixels",
            "an ordinary Bayer sensor, whose raw files other programs develop, or one with scattered colours, which `pattern` "
            "describes",
        )
    if pattern.is_scattered and look.likely_place:
        found = replace(found, block_origin=look.likely_place)
    reading = refined(look.data, layout, pattern, Reading(layout.format, layout.stride, 0, layout.width, found))
    if reading.stride != layout.stride:
        return _misread(look, reading)
    where = f"its colour sites repeat every {found.period} pixels, from row and column {found.block_origin} on"
    return Proof(where, " ".join(_place(look, found)))


def wrong_layout(look: Look) -> Proof | None:
    """Other formats of a frame that does not show the pattern, though its rows line up."""
    reading = look.reading if look.aligned and not look.found else None
    if reading is None:
        return None
    if look.confirmed and (reading.format, reading.skipped) == (look.layout.format, 0):
        return _too_tall(look)
    return _misread(look, reading)


def unexplained_levels(look: Look) -> Proof | None:
    """Levels that cannot be, in a frame that no other layout explains."""
    return None if look.found else look.wrong_levels


def no_filters(look: Look) -> Proof | None:
    """The samples at the places of the colour filters, in light: as bright as their neighbours."""
    if look.found or not look.aligned or not look.levels.show_no_filters(look.pattern):
        return None
    seen = "the samples at the places of the colour filters are as bright as their neighbours"
    return Proof(seen, "a sensor without colour filters, or another `pattern`, `period` or `origin`")


def padded_rows(look: Look) -> Proof | None:
    """The columns at the end: samples that are the same in all rows are padding."""
    padding = look.layout.width - look.width
    if not look.shown or not padding:
        return None
    seen = f"its rows have {padding} samples at the end that are the same in all of them"
    return Proof(seen, f"`width={look.width}` `stride={look.layout.stride}`")


def wrong_colours(look: Look) -> Proof | None:
    """The colours of the sites: the sites of a channel read the same, so that greens tell the diagonal, and others their places."""
    if not look.shown:
        return None
    if look.pattern.is_scattered:
        place = look.likely_place
        if place is None or place == look.pattern.block_origin:
            return None
        return Proof("its colours are at other sites of the tile", f"`origin={place[0]} {place[1]}`")
    if look.greens is not False:
        return None
    letters = "".join(look.pattern.channels[channel] for *_, channel in look.pattern.sites)
    others = "GRBG or GBRG" if letters in ("RGGB", "BGGR") else "RGGB or BGGR"
    return Proof("the two greens of a block lie on the other diagonal", f"`pattern` with blocks {others}")


CHECKS: tuple[Check, ...] = (
    # How bytes are read before what they say: in a wrong format levels and place are wrong too, and their remedies lead astray.
    wrong_stride,
    wrong_format,
    swapped_bytes,
    wrong_levels,
    too_tall,
    wrong_place,
    wrong_layout,
    unexplained_levels,
    no_filters,
    padded_rows,
    wrong_colours,
)
"""The checks of a frame that has seen light, in the order in which they are made: the first proof is the one that is told."""

_UNSUPPORTED = {
    BIG_ENDIAN: ("its samples are words with the high byte first", "a source with little-endian words (swap the bytes)"),
    BYTES: (
        "its samples are single bytes",
        "8 bits or a lossy compression; ask the camera for unpacked frames: rpicam-raw --mode W:H:12:U",
    ),
    RAW14: (f"its samples are packed as {RAW14}", "a mode of the camera with 10, 12 or 16 bits"),
}
"""Format that is recognised, but not read -> what is seen, and the remedy."""


def _is_clearer(other: Found, look: Look, times: float = CLEARER) -> bool:
    """Whether another reading explains more than `times` as much as what was found in the declared one, if anything was."""
    return look.found is None or other.explained > times * look.found.explained


def _too_tall(look: Look) -> Proof:
    return Proof(f"a frame ends and the next begins at another row than after {look.layout.height}", "another `height`")


def _misread(look: Look, reading: Reading) -> Proof:
    """What to say of a frame in which the pattern appears in another reading."""
    layout = look.layout
    reading = refined(look.data, layout, look.pattern, reading)
    seen, options = [], []
    if reading.stride != layout.stride:
        seen.append(f"its rows repeat every {reading.stride} bytes, not {layout.stride}")
    if reading.format in _UNSUPPORTED:
        what, remedy = _UNSUPPORTED[reading.format]
        return Proof(", and ".join([*seen, what]), remedy)
    if reading.format != layout.format:
        seen.append(f"its samples are packed as {reading.format}, not as {layout.format}")
        options.append(f"`pixel_format={reading.format}`")
    if reading.stride != layout.stride:
        options.append(f"`stride={reading.stride}`")
    if reading.width < layout.width:
        options.append(f"`width={reading.width}` or less")
    if reading.skipped:
        bytes_ = f"{reading.skipped} bytes (or whole groups of samples more)"
        seen.append(f"its samples begin {bytes_} after the beginning of the frame")
        options.append("a stream without a header")
    elif not look.is_declared(reading.found):
        options += _place(look, reading.found)
    return Proof(", and ".join(seen or ["its samples lie elsewhere"]), " ".join(options))


def _place(look: Look, found: Found) -> list[str]:
    """The options that describe where the pattern was found."""
    pattern = look.pattern
    same = found.period == pattern.period
    shift = [origin - block if same else 0 for origin, block in zip(pattern.origin, pattern.block_origin, strict=True)]
    row, column = ((place + moved) % found.period for place, moved in zip(found.block_origin, shift, strict=True))
    return [*([] if same else [f"`period={found.period}`"]), f"`origin={row} {column}`"]
