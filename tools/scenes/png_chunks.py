"""The chunks of a PNG that make up its picture (PNG, third edition, 11.2 and 11.3), without those that decoders expand unasked."""

from pathlib import Path

from shared.errors import InputError

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PICTURE = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
_BESIDE = (b"gAMA", b"sRGB", b"iCCP", b"eXIf")  # one of each
_MOST_BESIDE = 4 << 20  # bytes
_MOST_CHUNKS, _LEAST_CHUNK = 4096, 1024  # more chunks than this have that many bytes on average; encoders write 8 KiB
_FRAME = 12  # length, name and check sum of a chunk


def picture_chunks(path: Path, most: int) -> bytes:
    """Return the PNG without texts, animation and unknown chunks; a chunk that is cut short is kept as it is.

    path: the file, which begins like a PNG.
    most: bytes that may be kept.
    Raises InputError when the picture is longer, or in more pieces than any encoder makes.
    """
    kept, length, seen, chunks = [SIGNATURE], 0, set(), 0
    with path.open("rb") as file:
        file.seek(len(SIGNATURE))
        while len(start := file.read(8)) == 8 and (name := start[4:]).isalpha():
            size = int.from_bytes(start[:4], "big") + _FRAME - len(start)
            chunks += 1
            if chunks > _MOST_CHUNKS + file.tell() // _LEAST_CHUNK:
                raise InputError(f"{chunks} chunks in {file.tell()} bytes: the file is damaged, or made to waste time")
            if name in _PICTURE or (name in _BESIDE and name not in seen and size <= _MOST_BESIDE):
                seen.add(name)
                length += _FRAME + size
                if length > most:
                    raise InputError(f"more than {most} bytes of samples: the file is damaged, or made to fill the memory")
                kept += start, file.read(size)
            else:
                file.seek(size, 1)
            if name == b"IEND":
                break
    return b"".join(kept)
