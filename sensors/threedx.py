"""Files of the Jupiter's own software (*.3dx): read, write, and turn into scans and back.

Thesis, appendix A, little-endian and packed. A header of 30 bytes,

    "SRI3DX", u8 version, 5 u16 CPU version, 4 u16 WinUser version,
    u16 profiles, u16 unit, u8 content

then for each profile u16 pixels, u8 direction and that many (i16 Y', i16 Z', u8 intensity) in
0.1 mm, -32768 where nothing was measured. The thesis gives the WinUser version as "4*unsigned
short (8 bits)", which contradicts itself: headers of 26 bytes, with four u8 there, are read too.
The width is the one with which the profile table ends where the file ends (30 bytes if both do).
The thesis does not explain unit, content and direction; they are kept and not interpreted.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from registration.scan import BoolArray, FloatArray, Scan
from sensors.threedx_layout import (
    MAGIC,
    NARROW,
    PROFILE_HEAD,
    WIDE,
    Layout,
    ThreeDxError,
    find_layout,
    fitting,
)

NO_MEASUREMENT = -32768
OFFSET_Y_TENTH_MM = -389  # (3-2)
OFFSET_Z_TENTH_MM = 13896  # (3-3)
X_TOLERANCE_MM = 0.05  # half of what the file could resolve, had it an X

_ARRAYS = {"y_tenth_mm": "<i2", "z_tenth_mm": "<i2", "intensity": "u1", "direction": "u1"}

Shorts = NDArray[np.int16]
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class RawProfiles:
    """What a .3dx file holds, unconverted.

    y_tenth_mm, z_tenth_mm: (profiles, pixels) Y' and Z' of section 3.2.2 in 0.1 mm, NO_MEASUREMENT
        where nothing was measured.
    intensity: (profiles, pixels).
    direction: (profiles,).
    narrow: the WinUser version takes four bytes instead of four shorts.
    """

    y_tenth_mm: Shorts
    z_tenth_mm: Shorts
    intensity: Bytes
    direction: Bytes
    version: int = 1
    cpu_version: tuple[int, int, int, int, int] = (0, 0, 0, 0, 0)
    winuser_version: tuple[int, int, int, int] = (0, 0, 0, 0)
    unit: int = 1
    content: int = 0
    narrow: bool = False


def read(path: str | PathLike[str]) -> RawProfiles:
    """Read a .3dx file; raises ThreeDxError with path and offset, OSError where none opens.

    The size is checked against the header before the profiles are read.
    """
    with Path(path).open("rb") as stream:
        try:
            return decode(stream)
        except ThreeDxError as error:
            raise ThreeDxError(f"{path}: {error}") from None


def write(path: str | PathLike[str], raw: RawProfiles) -> None:
    """Write a .3dx file; raises ThreeDxError where a field does not fit the format."""
    Path(path).write_bytes(encode(raw))


def decode(stream: BinaryIO) -> RawProfiles:
    """Decode a seekable stream from its start to its end; raises ThreeDxError naming the offset.

    Every profile must have as many pixels as the first: a scan's index is the beam.
    """
    size = stream.seek(0, 2)
    stream.seek(0)
    layout, head = find_layout(stream, size)
    stream.seek(layout.header.size)
    data = stream.read(layout.end - layout.header.size)
    if layout.header.size + len(data) != layout.end:  # somebody is writing the file
        raise ThreeDxError(
            f"offset {layout.header.size + len(data)}: the file ended here while it was read; "
            f"it had {size} bytes"
        )
    table = np.frombuffer(data, layout.table_dtype())
    differing = np.flatnonzero(table["pixels"] != layout.pixels)
    if differing.size:
        k = int(differing[0])
        raise ThreeDxError(
            f"offset {layout.header.size + k * layout.profile_bytes}: profile {k} has "
            f"{table['pixels'][k]} pixels; expected {layout.pixels}, as in profile 0"
        )
    fields = layout.header.unpack(head[: layout.header.size])
    return RawProfiles(
        y_tenth_mm=table["pixel"]["y"].astype(np.int16),
        z_tenth_mm=table["pixel"]["z"].astype(np.int16),
        intensity=table["pixel"]["intensity"].copy(),
        direction=table["direction"].copy(),
        version=fields[1],
        cpu_version=fields[2:7],
        winuser_version=fields[7:11],
        unit=fields[12],
        content=fields[13],
        narrow=layout.header is NARROW,
    )


def encode(raw: RawProfiles) -> bytes:
    """Return the bytes of a .3dx file; raises ThreeDxError where a field does not fit."""
    shape = raw.y_tenth_mm.shape
    if len(shape) != 2 or 0 in shape or max(shape) > 0xFFFF:
        raise ThreeDxError(f"y_tenth_mm has shape {shape}; expected 1 to 65535 profiles and pixels")
    if raw.z_tenth_mm.shape != shape or raw.intensity.shape != shape:
        raise ThreeDxError(
            f"z_tenth_mm and intensity have shapes {raw.z_tenth_mm.shape} and "
            f"{raw.intensity.shape}; expected {shape}"
        )
    if raw.direction.shape != shape[:1]:
        raise ThreeDxError(f"direction has shape {raw.direction.shape}; expected {shape[:1]}")
    for name, field in _ARRAYS.items():
        _check_range(name, getattr(raw, name), np.iinfo(field))
    layout = Layout(NARROW if raw.narrow else WIDE, *shape)
    table = np.zeros(shape[0], layout.table_dtype())
    table["pixels"] = layout.pixels
    table["direction"] = raw.direction
    table["pixel"]["y"] = raw.y_tenth_mm
    table["pixel"]["z"] = raw.z_tenth_mm
    table["pixel"]["intensity"] = raw.intensity
    try:
        head = layout.header.pack(
            MAGIC,
            raw.version,
            *raw.cpu_version,
            *raw.winuser_version,
            shape[0],
            raw.unit,
            raw.content,
        )
    except struct.error as error:
        raise ThreeDxError(f"a number of the header does not fit its field: {error}") from None
    data = head + table.tobytes()
    if raw.narrow and fitting(data[: WIDE.size + PROFILE_HEAD.size], len(data), WIDE):
        raise ThreeDxError("this narrow header would be read back as a wide one; write a wide one")
    return data


def _check_range(name: str, values: NDArray[Any], field: np.iinfo[Any]) -> None:
    """Raise ThreeDxError where a number would not come back from its field as it went in."""
    if values.dtype.kind not in "iu":
        raise ThreeDxError(f"{name} has type {values.dtype}; expected whole numbers")
    if (beyond := (values < field.min) | (values > field.max)).any():
        where = np.argwhere(beyond)[0].tolist()
        found = f"{name}{where} is {values[tuple(where)]}"
        raise ThreeDxError(f"{found}; its field holds {field.min} to {field.max}")


def to_scan(raw: RawProfiles, step_mm: float, travel: ArrayLike = (1.0, 0.0, 0.0)) -> Scan:
    """Return the profiles as a scan in the sensor frame, by (3-2) and (3-3).

    step_mm, travel: distance between profiles (XSTEP) and the direction of the motion in the sensor
    frame, as of Scan; the file holds neither. The scan's intensity is 0 to 255. Raises ScanError
    for a bad step or direction.
    """
    y_raw, z_raw = raw.y_tenth_mm.astype(np.float64), raw.z_tenth_mm.astype(np.float64)
    points_mm = np.empty((*y_raw.shape, 3))
    points_mm[..., 0] = 0.0
    # Tenths are subtracted before the division, so that every value is the double nearest to it.
    points_mm[..., 1] = (OFFSET_Y_TENTH_MM - y_raw) / 10.0
    points_mm[..., 2] = (OFFSET_Z_TENTH_MM - z_raw) / 10.0
    points_mm[(y_raw == NO_MEASUREMENT) | (z_raw == NO_MEASUREMENT)] = np.nan
    scan = Scan.from_points(points_mm, step_mm, intensity=raw.intensity, travel=travel)
    placed_mm = points_mm + scan.origins_mm[:, None]
    placed_mm.setflags(write=False)
    return replace(scan, points_mm=placed_mm)


def from_scan(scan: Scan, like: RawProfiles | None = None) -> RawProfiles:
    """Return a scan as a file holds it, rounded to 0.1 mm, by (3-2) and (3-3).

    like: the file that the scan was read from; its versions, unit, content and directions, which a
    scan has no place for, are kept. Without intensity, 0 is written. Raises ThreeDxError where a
    point lies beyond the 16 bits, an intensity beyond 0 to 255, a profile not at its multiple of
    the step (a file has no X), or where like has another number of profiles.
    """
    valid = scan.valid
    profiles, pixels = valid.shape
    if like is not None and len(like.direction) != profiles:
        raise ThreeDxError(
            f"the file to be like has {len(like.direction)} profiles; the scan has {profiles}"
        )
    in_profiles_mm = scan.in_profiles_mm
    off_plane = valid & (np.abs(in_profiles_mm[..., 0]) > X_TOLERANCE_MM)
    if off_plane.any():
        k, i = np.argwhere(off_plane)[0]
        raise ThreeDxError(
            f"profile {k}, pixel {i} has x = {scan.points_mm[k, i, 0]:.3f} mm; a .3dx file holds "
            "no x, so every point must lie where the step and the motion put its profile, at "
            f"{scan.origins_mm[k, 0]:.3f} mm"
        )
    y_raw = _tenths(OFFSET_Y_TENTH_MM, in_profiles_mm[..., 1], valid, "y")
    z_raw = _tenths(OFFSET_Z_TENTH_MM, in_profiles_mm[..., 2], valid, "z")
    brightness = np.zeros((profiles, pixels), np.uint8)
    if scan.intensity is not None:
        level = np.rint(np.nan_to_num(scan.intensity, nan=0.0))
        if (beyond := (level < 0) | (level > 255)).any():
            k, i = np.argwhere(beyond)[0]
            raise ThreeDxError(
                f"profile {k}, pixel {i} has intensity {scan.intensity[k, i]:g}; expected 0 to 255"
            )
        brightness = level.astype(np.uint8)
    if like is not None:
        return replace(like, y_tenth_mm=y_raw, z_tenth_mm=z_raw, intensity=brightness)
    return RawProfiles(y_raw, z_raw, brightness, np.zeros(profiles, np.uint8))


def _tenths(offset: int, values_mm: FloatArray, valid: BoolArray, axis: str) -> Shorts:
    raw = offset - np.rint(np.where(valid, values_mm, 0.0) * 10.0)
    beyond = valid & (np.abs(raw) > 32767)
    if beyond.any():
        k, i = np.argwhere(beyond)[0]
        raise ThreeDxError(
            f"profile {k}, pixel {i} has {axis} = {values_mm[k, i]:g} mm; a .3dx file holds "
            f"{(offset - 32767) / 10:g} to {(offset + 32767) / 10:g} mm"
        )
    return np.where(valid, raw, NO_MEASUREMENT).astype(np.int16)
