from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from registration.scan import Scan
from sensors import threedx
from sensors.scan_files import ScanFileError, read_scan


@pytest.fixture
def scan() -> Scan:
    """Three profiles of ten points on tenths of a millimetre, one of them missing."""
    rng = np.random.default_rng(5)
    points_mm = np.round(rng.uniform(-50.0, 50.0, (3, 10, 3)), 1)
    points_mm[..., 2] += 600.0
    points_mm[..., 0] = 4.0 * np.arange(3)[:, None]
    points_mm[1, 4] = np.nan
    return Scan.from_points(points_mm, 4.0)


def test_both_kinds_of_file_give_the_scan_back(scan: Scan, tmp_path: Path) -> None:
    threedx.write(tmp_path / "a.3dx", threedx.from_scan(scan))
    np.savez(tmp_path / "a.npz", points_mm=scan.points_mm, step_mm=scan.step_mm)
    np.savez(tmp_path / "bare.NPZ", points_mm=scan.points_mm)
    (tmp_path / "bare.NPZ.npz").rename(tmp_path / "bare.NPZ")
    for name, step_mm in (("a.3dx", 4.0), ("a.npz", None), ("bare.NPZ", 4.0)):
        again = read_scan(tmp_path / name, step_mm)
        np.testing.assert_allclose(again.points_mm, scan.points_mm, atol=1e-9)
        assert again.step_mm == 4.0


def test_a_step_that_is_given_wins_over_the_one_in_the_file(scan: Scan, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points_mm=scan.points_mm, step_mm=4.0, apex_mm=[0.0, 0.0, -9.0])
    again = read_scan(tmp_path / "a.npz", 5.0)
    assert again.step_mm == 5.0
    assert again.apex_mm is not None
    assert again.apex_mm[2] == -9.0


@pytest.mark.parametrize(
    ("name", "arrays", "message"),
    [
        ("a.npz", {"points_mm": np.zeros((2, 3, 3))}, "holds no step_mm"),
        ("a.npz", {"points": np.zeros((2, 3, 3))}, "unknown array 'points'; known are points_mm"),
        ("a.npz", {"step_mm": 3.0}, "holds no points_mm"),
        ("a.npz", {"points_mm": np.zeros((2, 3)), "step_mm": 3.0}, "shape (2, 3)"),
        ("a.npz", {"points_mm": np.zeros((2, 3, 3)), "step_mm": [1, 2]}, "should be one number"),
        ("a.npz", {"points_mm": np.zeros((2, 3, 3)), "step_mm": "five"}, "should be one number"),
        ("a.npz", {"points_mm": np.zeros((2, 3, 3)), "step_mm": 5j}, "should be one number"),
        ("a.npz", {"points_mm": np.zeros((2, 3, 3)), "step_mm": -1.0}, "step_mm is -1.0"),
        ("a.npz", {"points_mm": np.array(["x", None])}, "no .npz file of plain arrays"),
        ("a.obj", {}, ".obj is not read; known are .3dx, .npz, .ply, .csv"),
        ("a", {}, "no ending is not read"),
    ],
)
def test_what_is_no_scan_is_told_in_a_line(
    name: str, arrays: dict[str, object], message: str, tmp_path: Path
) -> None:
    file = tmp_path / name
    with file.open("wb") as stream:
        np.savez(stream, **arrays)
    with pytest.raises(ScanFileError) as caught:
        read_scan(file, None)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ending", [".3dx", ".npz"])
def test_damaged_and_missing_files_are_told_in_a_line(
    ending: str, scan: Scan, tmp_path: Path
) -> None:
    good, bad = tmp_path / f"good{ending}", tmp_path / f"bad{ending}"
    if ending == ".3dx":
        threedx.write(good, threedx.from_scan(scan))
    else:
        np.savez(good, points_mm=scan.points_mm, step_mm=4.0)
    data = good.read_bytes()
    rng = np.random.default_rng(11)
    damaged = [b"", b"PK\x03\x04", data[:40], data[: len(data) // 2], rng.bytes(300)]
    for content in damaged:
        bad.write_bytes(content)
        with pytest.raises(ScanFileError, match="bad"):
            read_scan(bad, 4.0)
    bad.unlink()
    with pytest.raises(ScanFileError, match="No such file"):
        read_scan(bad, 4.0)


@pytest.mark.parametrize("damage", ["packed", "encrypted", "otherwise packed", "huge"])
def test_foreign_archives_are_told_in_a_line(damage: str, scan: Scan, tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    np.savez_compressed(file, points_mm=scan.points_mm, step_mm=4.0)
    data = bytearray(file.read_bytes())
    entry = data.index(b"PK\x01\x02")  # of the archive's list; the file itself begins at 0
    if damage == "packed":
        data[60:100] = b"\xff" * 40
    elif damage == "encrypted":
        data[6] |= 1
        data[entry + 8] |= 1
    elif damage == "otherwise packed":
        data[8] = data[entry + 10] = 97
    else:
        with zipfile.ZipFile(file, "w") as archive, archive.open("points_mm.npy", "w") as stream:
            header = {"descr": "<f8", "fortran_order": False, "shape": (10**7, 10**7, 3)}
            np.lib.format.write_array_header_1_0(stream, header)
        data = bytearray(file.read_bytes())
    file.write_bytes(data)
    with pytest.raises(ScanFileError, match=r"a\.npz: is no \.npz file of plain arrays"):
        read_scan(file, 4.0)


def test_a_threedx_file_needs_the_step(scan: Scan, tmp_path: Path) -> None:
    threedx.write(tmp_path / "a.3dx", threedx.from_scan(scan))
    with pytest.raises(ScanFileError, match="--step"):
        read_scan(tmp_path / "a.3dx", None)
