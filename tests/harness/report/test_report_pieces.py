"""The pieces of the page: packed arrays, distances, stages at fault, escaped text, its size."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from experiments.cli import main
from harness.report.faults import stage_at_fault
from harness.report.markup import SHOWN_ROWS, embedded_json, escaped, table_markup
from harness.report.nearness import REACH_MM, surface_distance
from harness.report.offered import OF_A_KIND, WORST, offered, worst_first
from harness.report.packing import compressed, packed
from harness.report.page import Part, Shown, page_markup
from harness.report.pictures import load_pictures
from harness.report.run_page import LISTED, listed_trials
from harness.report.studies import MOST_POINTS, study
from harness.tables.table import Table
from registration import Scan, register
from registration.result import STAGES

HOSTILE = '</script><script>alert("x")</script><img src=x onerror=alert(1)> & \'"'


def unpacked(value: dict[str, Any]) -> np.ndarray:
    """What data.js makes of a packed array."""
    whole = np.frombuffer(base64.b64decode(value["int16"]), dtype="<i2").reshape(value["shape"])
    return np.where(whole == -32768, np.nan, whole * value["step"])


@settings(max_examples=50, deadline=None)
@given(
    arrays(
        np.float64,
        st.tuples(st.integers(0, 5), st.integers(1, 4)),
        elements=st.one_of(st.just(np.nan), st.floats(-1e6, 1e6)),
    ),
    st.sampled_from([1e-4, 0.1, 1.0]),
)
def test_packed_arrays_come_back_to_within_half_a_step(values: np.ndarray, step: float) -> None:
    value = packed(values, step)
    assert value["step"] >= step
    np.testing.assert_allclose(unpacked(value), values, atol=0.5001 * value["step"], rtol=0)


def test_equal_data_is_equal_bytes() -> None:
    value = {"points": packed(np.arange(12.0).reshape(4, 3), 0.1)}
    assert compressed(value) == compressed(json.loads(json.dumps(value)))
    assert json.loads(gzip.decompress(compressed(value))) == value


@given(away=st.floats(-4.0, 4.0), tilt=st.floats(-0.8, 0.8))
@settings(max_examples=20, deadline=None)
def test_the_distance_to_a_plane_is_that_along_its_normal(away: float, tilt: float) -> None:
    across, along = np.meshgrid(np.arange(-30.0, 30.0, 3.0), np.arange(-30.0, 30.0, 2.0))
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    plane = np.stack([across.ravel(), along.ravel(), np.zeros(across.size)], axis=1) @ turn.T
    points = plane[::7] + away * turn[:, 2]
    np.testing.assert_allclose(surface_distance(points, plane), abs(away), atol=1e-9)
    beyond = plane[:3] + (REACH_MM + 1.0) * turn[:, 2]
    assert np.isnan(surface_distance(beyond, plane)).all()
    assert np.isnan(surface_distance(points, plane[:2])).all()


def corner(n: int = 30) -> Scan:
    """A floor and a wall, without noise."""
    x, y = np.meshgrid(5.0 * np.arange(n), np.linspace(-150, 150, 64), indexing="ij")
    return Scan.from_points(np.stack([x, y, 700 - np.abs(y)], axis=2), 5.0)


def flat_points() -> np.ndarray:
    """One wall, which leaves shifts along it open."""
    x, y = np.meshgrid(5.0 * np.arange(30), np.linspace(-150, 150, 64), indexing="ij")
    return np.stack([x, y, np.full_like(x, 700.0)], axis=2)


@pytest.mark.parametrize(
    ("scan", "method", "stage"),
    [
        (np.full((20, 64, 3), np.nan), "thesis", "scan"),
        (np.full((20, 64, 3), np.nan), "gauss_sphere", "scan"),
        (flat_points()[:2], "gauss_sphere", "patches"),
        (flat_points()[:1], "thesis", "patches"),
        (flat_points(), "gauss_sphere", "scene: it leaves a motion open"),
        (flat_points(), "thesis", "rotation"),
        (flat_points()[:1], "planar", "scan"),
    ],
)
def test_methods_say_at_which_stage_they_stopped(scan: np.ndarray, method: str, stage: str) -> None:
    result = register(Scan.from_points(scan, 5.0), corner(), method)
    assert result.status != "ok"
    assert result.stage in STAGES
    assert stage_at_fault(result.status, result.stage, {}) == stage, result.reason


def test_a_wrong_answer_is_the_fault_of_the_stage_whose_truth_mends_it() -> None:
    assert stage_at_fault("ok", "", {"rotation": True, "patches": False}) == "rotation"
    assert stage_at_fault("ok", "", {"rotation": False, "segments": True}) == "line segments"
    assert stage_at_fault("ok", "", {"rotation": False}) == "more than one stage"
    assert stage_at_fault("ok", "", {}) == ""
    assert stage_at_fault("error", "", {}) == "program"
    assert stage_at_fault("failed", "a stage of one's own", {}) == "a stage of one's own"


def test_a_large_sweep_shows_what_can_be_read() -> None:
    points = 40 * MOST_POINTS
    frame = pd.DataFrame(
        {
            "id": [f"{i:016x}" for i in range(points)],
            "pair": "a",
            "method": "thesis",
            "given": "",
            "repeat": np.arange(points),
            "status": "ok",
            "rotation_error_deg": 0.1,
            "translation_error_mm": np.arange(points) % 60.0,
            "ms_registration": np.nan,
            "sweep.point": np.arange(points),
            "sweep.varied": "",
            "sweep.scan.step_mm": np.linspace(1.0, 9.0, points),
        }
    )
    found = study(frame, "sobol")
    assert found["of"] == points
    assert found["shown"] == len(found["points"]) <= MOST_POINTS
    asked = {identity for point in found["points"] for identity in point["ids"]}
    listed = listed_trials(frame, ["run-experiment", "x.yaml"], asked)
    assert LISTED <= len(listed) <= LISTED + len(asked)
    assert asked <= {trial["id"] for trial in listed}
    assert listed[0]["mm"] == 59.0
    whole = listed_trials(frame[:100], ["run-experiment", "x.yaml"])
    assert len(whole) == 100
    part = Part(name="x", title="x", study=found)
    page = page_markup("x", [part], Shown(trials=listed, total=points))
    assert len(page) < 5_000_000


def test_the_table_of_failures_is_where_the_page_says(tmp_path: Path) -> None:
    """The page of a long sweep names a file of all failures: it has to be there."""
    config = tmp_path / "plates.yaml"
    config.write_text(
        "title: Plates\nscene: {name: separated_planes}\nsensor: {name: jupiter}\n"
        "scan: {profiles: 1, step_mm: 5.0}\n"
        "views:\n  left: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: -8}\n"
        "  right: {aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: 8}\n"
        "pairs:\n  a: {source: left, target: right}\n"
        "methods:\n  - {name: thesis, figures: false}\n",
        encoding="utf-8",
    )
    out = tmp_path / "out"
    main([str(config), "--out", str(out), "--workers", "1"])
    failed = pd.read_csv(out / "tables" / "failures_by_stage.csv")
    assert list(failed["Stage at fault"]) == ["patches"]


def rows(outcomes: list[tuple[str, str, float]]) -> pd.DataFrame:
    """Rows of method, status and translation error in mm."""
    return pd.DataFrame(
        [
            {
                "id": f"{place:016x}", "pair": "p", "method": method, "given": "",
                "repeat": place, "status": status, "reason": "",
                "rotation_error_deg": np.nan if np.isnan(off) else 0.1,
                "translation_error_mm": off,
            }
            for place, (method, status, off) in enumerate(outcomes)
        ]
    )  # fmt: skip


def test_the_worst_come_first_and_no_kind_of_failure_takes_all_places() -> None:
    found = rows(
        [("a", "ok", 1.0), ("a", "failed", np.nan), ("a", "ok", 80.0), ("a", "ambiguous", 3.0),
         ("a", "ok", 200.0), ("b", "failed", np.nan), ("b", "error", np.nan)]
    )  # fmt: skip
    assert [int(i, 16) for i in worst_first(found)["id"]] == [4, 2, 6, 3, 1, 5]
    chosen = [int(i, 16) for i in offered(found, {"a"})]
    assert chosen == [4, 5, 2, 0]  # one of each kind, then the next; repeat 0 of "a" is drawn
    assert [int(i, 16) for i in offered(found, set(), "a")] == [4, 5, 2]  # "a" is there already
    good = rows([("b", "failed", np.nan), ("a", "ok", 1.0)])
    assert [int(i, 16) for i in offered(good, set(), "a")] == [0, 1]
    many = rows([("a", "failed", np.nan)] * 30 + [("b", "failed", np.nan)] * 30)
    assert len(offered(many, set())) == min(WORST, 2 * OF_A_KIND)
    assert offered(rows([("a", "ok", 1.0), ("a", "ok", 2.0)]), set()) == [f"{0:016x}"]


class Elements(HTMLParser):
    """Collects elements, and handlers of events among their attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.handlers: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append(tag)
        self.handlers += [name for name, _ in attrs if name.startswith("on") and name != "onsubmit"]


def parsed(page: str) -> Elements:
    elements = Elements()
    elements.feed(page)
    return elements


def hostile_page(text: str) -> str:
    frame = pd.DataFrame({text: [text, "plain"], "Number (mm)": [1.5, np.nan]})
    table = Table("t", text, text, frame, {"Number (mm)": ".2f"}, note=text)
    part = Part("part", text, text, text, table, [table], failures="", config=text, facts=text,
                command=f"run-experiment {text}")  # fmt: skip
    return page_markup(text, [part], Shown())


def test_markup_in_any_text_stays_text() -> None:
    hostile, harmless = parsed(hostile_page(HOSTILE)), parsed(hostile_page("harmless"))
    assert hostile.found == harmless.found
    assert hostile.handlers == []
    data = embedded_json({"name": HOSTILE}, "x")
    assert parsed(data).found == ["script"]
    assert json.loads(re.sub(r"^<[^>]*>|</script>$", "", data)) == {"name": HOSTILE}


def test_the_page_asks_for_nothing_from_outside() -> None:
    page = hostile_page("plain")
    assert "default-src 'none'" in page.replace("&#x27;", "'")
    assert not re.findall(r"(?:src|href)=\"(?!#|data:)", page)
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_a_long_table_is_cut_and_says_so() -> None:
    frame = pd.DataFrame({"n": range(SHOWN_ROWS + 5)})
    shown = table_markup(Table("many", "Many", "", frame, {"n": "d"}), "many")
    assert shown.count("<tr>") == SHOWN_ROWS + 1
    assert f"{SHOWN_ROWS} of {SHOWN_ROWS + 5} rows" in shown
    assert escaped("<") in escaped("<b>")


def test_pictures_are_made_smaller_until_they_fit(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (300, 400, 3), dtype=np.uint8)
    files = [tmp_path / f"6.4_thesis_1_{i}.png" for i in range(3)]
    for file in files:
        Image.fromarray(noise).save(file)
    size: Callable[[int], int] = lambda budget: sum(  # noqa: E731
        len(picture.data) for picture in load_pictures(files, budget)
    )
    whole = sum(file.stat().st_size for file in files)
    assert size(whole) == whole
    assert size(whole // 2) < whole // 2
    assert size(whole // 20) < size(whole // 2)


class Anchors(HTMLParser):
    """Collects the ids of a page and what its links point at."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value is not None:
                self.ids.append(value)
            if name == "href" and value is not None:
                self.links.append(value)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("answered", [True, False])
def test_ids_are_unique_and_every_link_leads_somewhere(count: int, answered: bool) -> None:
    table = Table("t", "Title", "Caption.", pd.DataFrame({"n": [1]}), {"n": "d"})
    parts = [
        Part(f"part{k}", f"Part {k}", sentence="It works." if answered else "", tables=[table],
             sensor=[replace(table, name="card")], failures="<p>None.</p>")
        for k in range(count)
    ]  # fmt: skip
    anchors = Anchors()
    anchors.feed(page_markup("Title", parts, Shown()))
    assert len(set(anchors.ids)) == len(anchors.ids)
    assert anchors.links
    assert {link.removeprefix("#") for link in anchors.links} <= set(anchors.ids)
