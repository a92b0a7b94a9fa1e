"""Damage of many kinds to the bytes of a file, drawn at random."""

import contextlib
import struct
import zlib

import numpy as np

_NUMBERS = (0, 1, 2, 7, 8, 127, 128, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63, -1)
_WORDS = (b"", b"nan", b"1e999", b"-inf", b"\x1b[2J", b'"', b"\0", b"\r", b"\xff", b"[" * 50, b"=")


def damaged(rng: np.random.Generator, seeds: list[bytes]) -> bytes:
    """Return one of the files with up to eight places damaged.

    Parameters
    ----------
    rng : Generator
    seeds : list of bytes
    """
    content = bytearray(seeds[rng.integers(len(seeds))])
    if content[126:128] == b"IM" and content[128] == 15 and rng.random() < 0.7:
        return _inside_mat(rng, bytes(content))
    _damage(rng, content, seeds)
    return bytes(content)


def _damage(rng: np.random.Generator, content: bytearray, seeds: list[bytes]) -> None:
    for _ in range(int(rng.choice([1, 1, 1, 2, 3, 8]))):
        kinds = (_flip, _set, _number, _number, _copy, _remove, _insert, _cut)
        kinds[rng.integers(len(kinds))](rng, content)
    if rng.random() < 0.02:
        other = seeds[rng.integers(len(seeds))]
        content[_place(rng, content) :] = other[rng.integers(len(other)) :]


def _inside_mat(rng: np.random.Generator, content: bytes) -> bytes:
    """Damage what a compressed MAT file holds, and compress it again."""
    parts, place = [content[:128]], 128
    while place + 8 <= len(content):
        kind, size = struct.unpack_from("<II", content, place)
        body = content[place + 8 : place + 8 + size]
        with contextlib.suppress(zlib.error):
            body = zlib.decompress(body)
            if rng.random() < 0.5:
                changed = bytearray(body)
                _damage(rng, changed, [body])
                body = bytes(changed)
            body = zlib.compress(body)
        parts.append(struct.pack("<II", kind, len(body)) + body)
        place += 8 + size
    return b"".join(parts)


def _place(rng: np.random.Generator, content: bytearray) -> int:
    return int(rng.integers(max(len(content), 1)))


def _flip(rng: np.random.Generator, content: bytearray) -> None:
    if content:
        content[_place(rng, content)] ^= 1 << int(rng.integers(8))


def _set(rng: np.random.Generator, content: bytearray) -> None:
    if content:
        content[_place(rng, content)] = int(rng.integers(256))


def _number(rng: np.random.Generator, content: bytearray) -> None:
    """Write a whole number of 1 to 8 bytes, in either order, where one may stand."""
    size = int(rng.choice([1, 2, 4, 8]))
    value = _NUMBERS[rng.integers(len(_NUMBERS))] + int(rng.integers(-1, 2))
    order = "little" if rng.random() < 0.8 else "big"
    place = _place(rng, content) // size * size
    content[place : place + size] = (value % 256**size).to_bytes(size, order)


def _copy(rng: np.random.Generator, content: bytearray) -> None:
    source, target = _place(rng, content), _place(rng, content)
    size = int(rng.integers(1, 65))
    content[target : target + size] = content[source : source + size]


def _remove(rng: np.random.Generator, content: bytearray) -> None:
    place = _place(rng, content)
    del content[place : place + int(rng.integers(1, 65))]


def _insert(rng: np.random.Generator, content: bytearray) -> None:
    place = _place(rng, content)
    content[place:place] = _WORDS[rng.integers(len(_WORDS))] or rng.bytes(int(rng.integers(1, 65)))


def _cut(rng: np.random.Generator, content: bytearray) -> None:
    if rng.random() < 0.2:
        del content[_place(rng, content) :]
