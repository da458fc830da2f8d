"""Where the parts of a .3dx file lie, found by its size before anything is read by a count."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

MAGIC = b"SRI3DX"
JUPITER_PIXELS = (256, 512)
WIDE = struct.Struct("<6sB5H4HHHB")
NARROW = struct.Struct("<6sB5H4BHHB")
PROFILE_HEAD = struct.Struct("<HB")
PIXEL = np.dtype([("y", "<i2"), ("z", "<i2"), ("intensity", "u1")])


class ThreeDxError(ValueError):
    """The bytes are no .3dx file, or a scan cannot be stored as one; the message says where."""


@dataclass(frozen=True)
class Layout:
    """A header of one width, and as many profiles as it announces, all of as many pixels."""

    header: struct.Struct
    profiles: int
    pixels: int

    @property
    def profile_bytes(self) -> int:
        """Length of a profile."""
        return PROFILE_HEAD.size + self.pixels * PIXEL.itemsize

    @property
    def end(self) -> int:
        """Length of the file."""
        return self.header.size + self.profiles * self.profile_bytes

    def table_dtype(self) -> np.dtype[np.void]:
        """What every profile holds."""
        return np.dtype([("pixels", "<u2"), ("direction", "u1"), ("pixel", PIXEL, (self.pixels,))])


def find_layout(stream: BinaryIO, size: int) -> tuple[Layout, bytes]:
    """Find the header's width by the size of the file; return it with the first bytes."""
    head = stream.read(WIDE.size + PROFILE_HEAD.size)
    if head[: len(MAGIC)] != MAGIC[: len(head)]:
        raise ThreeDxError(f'offset 0: {head[: len(MAGIC)]!r}; a .3dx file starts with "SRI3DX"')
    least = NARROW.size + PROFILE_HEAD.size + PIXEL.itemsize
    if size < least:
        raise ThreeDxError(
            f"offset {size}: the file ends after {size} bytes; the shortest has {least}"
        )
    for header in (WIDE, NARROW):
        if layout := fitting(head, size, header):
            return layout, head
    for header in (WIDE, NARROW):
        if told := _differing(stream, size, _announced(head, header)):
            raise ThreeDxError(told)
    raise ThreeDxError(_misfit(head, size))


def _differing(stream: BinaryIO, size: int, announced: Layout | None) -> str | None:
    """What to say where the file ends with its profiles, but they differ in their pixels.

    The format allows that. It does not say which beams a shorter profile lacks, and the index of
    a scan is the beam, so such a file is no scan: no place for what is missing would be right.
    """
    if announced is None or announced.pixels == 0:
        return None
    at, first = announced.header.size, None
    for k in range(announced.profiles):
        if at + PROFILE_HEAD.size > size:
            return None
        stream.seek(at)
        pixels, _ = PROFILE_HEAD.unpack(stream.read(PROFILE_HEAD.size).ljust(PROFILE_HEAD.size))
        if first is None and pixels != announced.pixels:
            first = (
                f"offset {at}: profile {k} has {pixels} pixels; expected {announced.pixels}, as in "
                "profile 0, as nothing in the file says which beams the others would be"
            )
        at += PROFILE_HEAD.size + pixels * PIXEL.itemsize
    return first if at == size else None


def _announced(head: bytes, header: struct.Struct) -> Layout | None:
    if len(head) < header.size + PROFILE_HEAD.size:
        return None
    return Layout(
        header, header.unpack_from(head)[11], PROFILE_HEAD.unpack_from(head, header.size)[0]
    )


def fitting(head: bytes, size: int, header: struct.Struct) -> Layout | None:
    """The layout that a header of this width announces, if the file ends where that does."""
    layout = _announced(head, header)
    return layout if layout and layout.profiles and layout.pixels and layout.end == size else None


def _misfit(head: bytes, size: int) -> str:
    """Say what is wrong, by the wide reading unless only the narrow one has a Jupiter's pixels."""
    readings = [r for h in (WIDE, NARROW) if (r := _announced(head, h))]
    best = next((r for r in readings if r.pixels in JUPITER_PIXELS), readings[0])
    at_profiles, at_pixels = best.header.size - 5, best.header.size
    if not best.profiles:
        return f"offset {at_profiles}: 0 profiles; expected 1 to 65535"
    if not best.pixels:
        return f"offset {at_pixels}: profile 0 has 0 pixels; expected 1 to 65535"
    announced = (
        f"{best.profiles} profiles (offset {at_profiles}) of {best.pixels} pixels "
        f"(offset {at_pixels}) end at {best.end}"
    )
    if size < best.end:
        return f"offset {size}: the file ends here, but the announced {announced}"
    return f"offset {best.end}: the announced {announced}, but the file has {size} bytes"
