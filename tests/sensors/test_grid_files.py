"""Organised .csv and .ply files: what is written comes back, what is wrong is told, and where."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.scan_files import ScanFileError, read_scan

HEADER = "profile,pixel,x_mm,y_mm,z_mm\n"
PLY = "ply\nformat ascii 1.0\n{info}element vertex {n}\n{properties}end_header\n{rows}"
XYZ = "property float x\nproperty float y\nproperty float z\n"
INDEXED = "property int profile\nproperty int pixel\n"


def points(rng: np.random.Generator, rows: int = 4, columns: int = 6) -> np.ndarray:
    """Organised points, some of them missing, the last one there."""
    found = np.round(rng.uniform(-500, 500, (rows, columns, 3)), 3)
    found[rng.random((rows, columns)) < 0.3] = np.nan
    found[-1, -1] = [1.0, 2.0, 3.0]
    return found


def csv_text(grid: np.ndarray) -> str:
    lines = [
        f"{p},{u},{','.join(repr(float(v)) for v in grid[p, u])}\n"
        for p, u in np.argwhere(np.isfinite(grid[..., 2]))
    ]
    return HEADER + "".join(reversed(lines))  # the order of the rows says nothing


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), rows=st.integers(1, 5), columns=st.integers(1, 5))
def test_csv_gives_the_points_back(
    seed: int, rows: int, columns: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    grid = points(np.random.default_rng(seed), rows, columns)
    file = tmp_path_factory.mktemp("csv") / "scan.csv"
    file.write_text(csv_text(grid), encoding="utf-8")
    np.testing.assert_array_equal(read_scan(file, 5.0).points_mm, grid)


def test_ply_gives_the_points_back_by_rows_and_by_indices(tmp_path: Path) -> None:
    grid = points(np.random.default_rng(3))
    whole = "".join(" ".join(f"{v:g}" for v in point) + "\n" for point in grid.reshape(-1, 3))
    info = "obj_info num_cols 6\nobj_info num_rows 4\n"
    text = PLY.format(info=info, n=24, properties=XYZ, rows=whole)
    (tmp_path / "rows.ply").write_text(text, encoding="ascii")
    there = np.argwhere(np.isfinite(grid[..., 2]))
    rows = "".join(f"{' '.join(f'{v:g}' for v in grid[p, u])} {p} {u}\n" for p, u in there)
    properties = XYZ + "property int profile\nproperty int pixel\n"
    text = PLY.format(info="", n=len(there), properties=properties, rows=rows)
    (tmp_path / "indices.ply").write_text(text, encoding="ascii")
    for name in ("rows.ply", "indices.ply"):
        np.testing.assert_allclose(read_scan(tmp_path / name, 5.0).points_mm, grid, rtol=1e-5)


def test_csv_may_hold_intensity(tmp_path: Path) -> None:
    file = tmp_path / "scan.csv"
    file.write_text(HEADER[:-1] + ",intensity\n0,1,1,2,3,77\n", encoding="utf-8")
    scan = read_scan(file, 5.0)
    assert scan.intensity is not None
    assert scan.intensity[0, 1] == 77
    assert np.isnan(scan.intensity[0, 0])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "profile,pixel,x_mm,y_mm\n0,0,1,2\n", "line 1: has no column 'z_mm'"),
        ("a.csv", HEADER + "0,0,1,2,3\n0,1,1,two,3\n", "line 3: y_mm is 'two', no finite number"),
        ("a.csv", HEADER + "\n0,0,1,2,3\n\n0,1,1,two,3\n", "line 5: y_mm is 'two'"),
        ("a.csv", HEADER + "0,0,1,2,3\n\n  \n0,0,1,2,4\n\n", "line 5: profile 0, pixel 0 was"),
        ("a.csv", HEADER + "0,0,1,2,inf\n", "line 2: z_mm is 'inf'"),
        ("a.csv", HEADER + "0,0,1,2,3\n0,1.5,1,2,3\n", "line 3: pixel is 1.5; expected a whole"),
        ("a.csv", HEADER + "-1,0,1,2,3\n", "line 2: profile is -1"),
        ("a.csv", HEADER + "0,0,1,2,3\n0,0,1,2,4\n", "line 3: profile 0, pixel 0 was there before"),
        ("a.csv", HEADER, "holds no point"),
        ("a.csv", "", "no table of comma-separated values"),
        ("a.csv", HEADER + "0,0,1,2,3\n0,1,1,2,3,4,5\n", "line 3"),
        ("a.csv", HEADER + "0,0,1,2,3,9\n0,1,1,2,3,9\n", "line 2: has more values than line 1"),
        ("a.csv", HEADER + "0,0,1,2,3\n9999,9999,1,2,3\n", "2 points on 10000 profiles of 10000"),
        ("a.ply", "solid cube\n", "first line is not `ply`"),
        ("a.ply", "ply\nformat ascii 1.0\n", "no end_header"),
        ("a.ply", PLY.format(info="", n=1, properties=XYZ, rows="1 2 3\n"), "not organised"),
        ("a.ply", PLY.format(info="obj_info num_rows 2\nobj_info num_cols 2\n", n=1,
                             properties=XYZ, rows="1 2 3\n"), "are 4 points; it has 1"),
        ("a.ply", PLY.format(info="obj_info num_rows x\n", n=1, properties=XYZ, rows="1 2 3\n"),
         "line 3: num_rows is 'x'"),
        ("a.ply", PLY.format(info="", n=5, properties="", rows=""), "no .ply file with vertices"),
        ("a.ply", PLY.format(info="", n=3, properties=XYZ + INDEXED, rows="1 2 3 0 0\n1 2 3 0\n"),
         "no .ply file with vertices"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(
    name: str, text: str, message: str, tmp_path: Path
) -> None:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScanFileError) as caught:
        read_scan(file, 5.0)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


def test_neither_holds_the_step(tmp_path: Path) -> None:
    file = tmp_path / "scan.csv"
    file.write_text(HEADER + "0,0,1,2,3\n", encoding="utf-8")
    with pytest.raises(ScanFileError, match="--step"):
        read_scan(file, None)


@settings(max_examples=60, deadline=None)
@given(content=st.binary(max_size=200), ending=st.sampled_from([".csv", ".ply"]))
def test_no_bytes_make_anything_but_a_scan_or_a_line(
    content: bytes, ending: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    file = tmp_path_factory.mktemp("bytes") / f"a{ending}"
    prefix = b"ply\nformat ascii 1.0\nelement vertex 2\n" if ending == ".ply" else HEADER.encode()
    for data in (content, prefix + content):
        file.write_bytes(data)
        with contextlib.suppress(ScanFileError):
            assert read_scan(file, 5.0).points_mm.ndim == 3
