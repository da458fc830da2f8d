"""Laws of the .3dx files: round trips, and one clear error for everything else."""

from __future__ import annotations

import io
import struct
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from registration.scan import Scan
from sensors import threedx
from sensors.threedx import RawProfiles
from sensors.threedx_layout import ThreeDxError


def decode(data: bytes) -> RawProfiles:
    return threedx.decode(io.BytesIO(data))


def random_raw(seed: int, profiles: int = 4, pixels: int = 256, narrow: bool = False):
    rng = np.random.default_rng(seed)
    y = rng.integers(-3000, 3000, (profiles, pixels)).astype(np.int16)
    z = rng.integers(2000, 12000, (profiles, pixels)).astype(np.int16)
    y[rng.random(y.shape) < 0.1] = threedx.NO_MEASUREMENT
    z[y == threedx.NO_MEASUREMENT] = threedx.NO_MEASUREMENT
    return RawProfiles(
        y,
        z,
        rng.integers(0, 256, y.shape).astype(np.uint8),
        rng.integers(0, 2, profiles).astype(np.uint8),
        version=3,
        cpu_version=(1, 2, 3, 4, 5),
        winuser_version=(6, 7, 8, 9),
        unit=10,
        content=7,
        narrow=narrow,
    )


def assert_equal(a: RawProfiles, b: RawProfiles) -> None:
    for name in ("y_tenth_mm", "z_tenth_mm", "intensity", "direction"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert getattr(a, name).dtype == getattr(b, name).dtype
    for name in ("version", "cpu_version", "winuser_version", "unit", "content", "narrow"):
        assert getattr(a, name) == getattr(b, name)


@st.composite
def raws(draw: st.DrawFn) -> RawProfiles:
    shape = (draw(st.integers(1, 5)), draw(st.integers(1, 9)))
    narrow = draw(st.booleans())
    word = st.integers(0, 0xFFFF)
    number = st.integers(0, 0xFF) if narrow else word
    return RawProfiles(
        draw(hnp.arrays(np.int16, shape)),
        draw(hnp.arrays(np.int16, shape)),
        draw(hnp.arrays(np.uint8, shape)),
        draw(hnp.arrays(np.uint8, shape[:1])),
        draw(st.integers(0, 0xFF)),
        draw(st.tuples(*[word] * 5)),
        draw(st.tuples(*[number] * 4)),
        draw(word),
        draw(st.integers(0, 0xFF)),
        narrow,
    )


@given(raws())
@settings(max_examples=150, deadline=None)
def test_what_is_encoded_is_decoded(raw):
    try:
        data = threedx.encode(raw)
    except ThreeDxError:
        assume(not raw.narrow)  # a narrow file may, once in millions, read as a wide one
        raise
    assert_equal(decode(data), raw)


@given(raws(), st.floats(0.1, 50.0))
@settings(max_examples=100, deadline=None)
def test_quantised_scan_survives_exactly(raw, step_mm):
    scan = threedx.to_scan(raw, step_mm)
    again = threedx.to_scan(decode(threedx.encode(threedx.from_scan(scan))), step_mm)
    np.testing.assert_array_equal(again.points_mm, scan.points_mm)
    np.testing.assert_array_equal(again.intensity, scan.intensity)
    assert again.step_mm == scan.step_mm


@given(st.binary(max_size=300) | st.binary(max_size=300).map(lambda tail: b"SRI3DX" + tail))
@settings(max_examples=300, deadline=None)
def test_arbitrary_bytes_are_read_whole_or_refused(data):
    refusal = ""
    try:
        raw = decode(data)
    except ThreeDxError as error:
        refusal = str(error)
    if refusal:
        assert refusal.startswith("offset ")
        assert "\n" not in refusal
    else:
        assert threedx.encode(raw) == data


@given(st.integers(0, 2**32 - 1), st.booleans(), st.data())
@settings(max_examples=200, deadline=None)
def test_damaged_files_are_read_whole_or_refused(seed, narrow, data):
    good = bytearray(threedx.encode(random_raw(seed, 3, 5, narrow)))
    for _ in range(data.draw(st.integers(1, 4))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    try:
        raw = decode(bytes(good))
    except ThreeDxError:
        return
    assert threedx.encode(raw) == bytes(good)


@pytest.mark.parametrize("narrow", [False, True])
def test_layout_is_that_of_appendix_a(narrow):
    raw = random_raw(1, profiles=2, pixels=3, narrow=narrow)
    expected = b"SRI3DX" + struct.pack("<B5H", 3, 1, 2, 3, 4, 5)
    expected += struct.pack("<4B" if narrow else "<4H", 6, 7, 8, 9) + struct.pack("<HHB", 2, 10, 7)
    for k in range(2):
        expected += struct.pack("<HB", 3, raw.direction[k])
        for i in range(3):
            expected += struct.pack(
                "<hhB", raw.y_tenth_mm[k, i], raw.z_tenth_mm[k, i], raw.intensity[k, i]
            )
    assert threedx.encode(raw) == expected
    assert_equal(decode(expected), raw)


def test_frames_are_those_of_chapter_3():
    raw = RawProfiles(
        np.array([[0, -389, threedx.NO_MEASUREMENT, 5]], np.int16),
        np.array([[11000, 2000, 2000, threedx.NO_MEASUREMENT]], np.int16),
        np.array([[10, 20, 30, 40]], np.uint8),
        np.zeros(1, np.uint8),
    )
    scan = threedx.to_scan(raw, 5.0)
    assert scan.points_mm[0, :2].tolist() == [[0.0, -38.9, 289.6], [0.0, 0.0, 1189.6]]
    assert scan.valid.tolist() == [[True, True, False, False]]
    assert scan.intensity is not None
    assert scan.intensity[0].tolist() == [10, 20, 30, 40]
    np.testing.assert_array_equal(
        threedx.to_scan(random_raw(2), 3.0).points_mm[2, :, 0],
        np.where(random_raw(2).y_tenth_mm[2] == threedx.NO_MEASUREMENT, np.nan, 6.0),
    )


def test_unquantised_scan_comes_back_within_half_a_tenth():
    rng = np.random.default_rng(3)
    points = rng.uniform((0, -280, 170), (0, 280, 1175), (6, 40, 3))
    points[..., 0] = 5.0 * np.arange(6)[:, None]
    points[2, 7] = np.nan
    scan = Scan.from_points(points, 5.0)
    again = threedx.to_scan(threedx.from_scan(scan), 5.0)
    np.testing.assert_allclose(again.points_mm, scan.points_mm, atol=0.05 + 1e-9)


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


def test_what_a_scan_has_no_place_for_is_taken_from_the_file_it_came_from():
    raw = random_raw(5)
    assert_equal(threedx.from_scan(threedx.to_scan(raw, 3.0), like=raw), raw)
    slanting = threedx.to_scan(raw, 3.0, [0.9, 0.1, -0.4])
    assert_equal(threedx.from_scan(slanting, like=raw), raw)
    with pytest.raises(ThreeDxError, match="has 3 profiles; the scan has 4"):
        threedx.from_scan(slanting, like=random_raw(5, profiles=3))


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
