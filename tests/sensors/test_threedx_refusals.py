"""What is no .3dx file, or fits into none, is refused in one line that says where."""

from __future__ import annotations

import io
import struct
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from raw_profiles import assert_equal, decode, random_raw

from registration.scan import Scan
from sensors import threedx
from sensors.threedx import RawProfiles
from sensors.threedx_layout import ThreeDxError


def test_narrow_file_that_reads_as_a_wide_one_is_not_written():
    # 4 profiles of 256 pixels behind 26 bytes are as long as 1 of 1025 behind 30. Where a wide file
    # has its number of profiles this one has its content, and the pixels lie in the first point.
    y, z = np.zeros((2, 4, 256), np.int16)
    y[0, 0], z[0, 0] = 1025 % 256 * 256, 1025 // 256
    raw = RawProfiles(
        y, z, np.zeros((4, 256), np.uint8), np.zeros(4, np.uint8), content=1, narrow=True
    )
    with pytest.raises(ThreeDxError, match="read back as a wide one"):
        threedx.encode(raw)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("y_tenth_mm", 40000, r"y_tenth_mm\[1, 3\] is 40000; its field holds -32768 to 32767"),
        ("z_tenth_mm", -32769, r"z_tenth_mm\[1, 3\] is -32769"),
        ("intensity", 256, r"intensity\[1, 3\] is 256; its field holds 0 to 255"),
        ("direction", -1, r"direction\[1\] is -1; its field holds 0 to 255"),
        ("intensity", 0.5, "intensity has type float64; expected whole numbers"),
    ],
)
def test_numbers_that_do_not_fit_their_field_are_not_written(name, value, message):
    raw = random_raw(11)
    values = getattr(raw, name).astype(type(value))
    values[(1, 3)[: values.ndim]] = value
    with pytest.raises(ThreeDxError, match=message):
        threedx.encode(replace(raw, **{name: values}))
    # A wider type alone is no fault.
    wide = {n: getattr(raw, n).astype(np.int64) for n in ("y_tenth_mm", "intensity", "direction")}
    assert threedx.encode(replace(raw, **wide)) == threedx.encode(raw)


@pytest.mark.parametrize("narrow", [False, True])
def test_every_truncation_is_refused_where_the_file_ends(narrow):
    data = threedx.encode(random_raw(4, 2, 6, narrow))
    for size in range(len(data)):
        with pytest.raises(ThreeDxError, match=rf"^offset {size}: the file ends"):
            decode(data[:size])


@pytest.mark.parametrize("narrow", [False, True])
def test_overlong_file_is_refused_where_it_should_end(narrow):
    data = threedx.encode(random_raw(5, narrow=narrow))
    with pytest.raises(ThreeDxError, match=rf"^offset {len(data)}: .*the file has {len(data) + 1}"):
        decode(data + b"\0")


def changed(data: bytes, offset: int, with_bytes: bytes) -> bytes:
    return data[:offset] + with_bytes + data[offset + len(with_bytes) :]


@pytest.mark.parametrize(
    ("offset", "with_bytes", "message"),
    [
        (0, b"PNG", r"^offset 0: .*starts with \"SRI3DX\""),
        (25, b"\0\0", r"^offset 25: 0 profiles"),
        (25, b"\xff\xff", r"65535 profiles \(offset 25\) of 256 pixels \(offset 30\) end"),
        (30, b"\0\0", r"^offset 30: profile 0 has 0 pixels"),
        (30, b"\xff\xff", r"4 profiles \(offset 25\) of 65535 pixels \(offset 30\) end"),
        (30 + 1283, b"\x05\0", r"^offset 1313: profile 1 has 5 pixels; expected 256"),
    ],
)
def test_wrong_magic_and_absurd_counts_name_the_offset(offset, with_bytes, message):
    with pytest.raises(ThreeDxError, match=message):
        decode(changed(threedx.encode(random_raw(6)), offset, with_bytes))


@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("pixels", [255, 300, 0])
def test_profiles_of_differing_pixels_are_refused_with_the_reason(narrow, pixels):
    data = threedx.encode(random_raw(4, narrow=narrow))
    at = (26 if narrow else 30) + 2 * 1283
    odd = struct.pack("<HB", pixels, 0) + bytes(5 * pixels)
    message = rf"^offset {at}: profile 2 has {pixels} pixels; expected 256, .* which beams"
    with pytest.raises(ThreeDxError, match=message):
        decode(data[:at] + odd + data[at + 1283 :])


def test_announced_gigabytes_are_not_allocated():
    data = threedx.encode(random_raw(7))
    data = changed(changed(data, 25, b"\xff\xff"), 30, b"\xff\xff")
    tracemalloc.start()
    with pytest.raises(ThreeDxError, match="end at 21474"):
        decode(data)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 200_000


def test_file_that_shrinks_while_it_is_read_is_refused():
    class Shrinking(io.BytesIO):
        def read(self, size: int | None = -1, /) -> bytes:
            data = super().read(size)
            return data[:1000]

    data = threedx.encode(random_raw(10))
    with pytest.raises(ThreeDxError, match=rf"^offset 1030: .* it had {len(data)} bytes"):
        threedx.decode(Shrinking(data))


def test_file_error_names_the_file(tmp_path):
    path = tmp_path / "left.3dx"
    raw = random_raw(8)
    threedx.write(path, raw)
    assert_equal(threedx.read(path), raw)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ThreeDxError, match=r"left\.3dx: offset 5161: the file ends here"):
        threedx.read(path)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ((1, 2, 2), 5000.0, r"profile 1, pixel 2 has z = 5000 mm; .* -1887.1 to 4666.3 mm"),
        ((0, 3, 1), -4000.0, r"profile 0, pixel 3 has y = -4000 mm; .* -3315.6 to 3237.8 mm"),
        ((1, 0, 0), 7.0, r"profile 1, pixel 0 has x = 7.000 mm; .*5.000 mm"),
    ],
)
def test_scan_that_a_file_cannot_hold_is_refused(place, value, message):
    points = np.zeros((2, 4, 3))
    points[1, :, 0] = 5.0
    points[place] = value
    with pytest.raises(ThreeDxError, match=message):
        threedx.from_scan(Scan.from_points(points, 5.0))


def test_intensity_beyond_a_byte_is_refused():
    scan = Scan.from_points(np.zeros((1, 2, 3)), 5.0, intensity=[[0.0, 256.0]])
    with pytest.raises(ThreeDxError, match="pixel 1 has intensity 256; expected 0 to 255"):
        threedx.from_scan(scan)


@pytest.mark.parametrize(
    "fields",
    [{"version": 256}, {"winuser_version": (0, 0, 0, 65536)}, {"unit": -1}],
)
def test_header_number_beyond_its_field_is_refused(fields):
    raw = random_raw(9)
    with pytest.raises(ThreeDxError, match="does not fit"):
        threedx.encode(
            RawProfiles(raw.y_tenth_mm, raw.z_tenth_mm, raw.intensity, raw.direction, **fields)
        )
