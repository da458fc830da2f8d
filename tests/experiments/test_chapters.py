from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from experiments.chapter_figures import FIGURES, PLANAR_FIGURES
from experiments.chapter_summary import PartResult
from experiments.chapters import load_chapters
from experiments.cli import main
from experiments.draw_chapters import draw_numbered, figure_table, shown_trials
from experiments.medians import median_of
from harness.config.schema import Experiment
from harness.report.page import LARGEST_BYTES
from harness.scoring.chance import rate
from harness.store import load

ROOT = Path(__file__).parents[2]
THESIS = ROOT / "configs" / "thesis.yaml"
# The figures of the parts themselves have tests of their own.
METHODS = (
    "methods: [{name: gauss_sphere, figures: false}, "
    "{name: thesis, given: [shared_patches], figures: false}]"
)
SMALL = [
    "parts.precision.set.scan.profiles=4",
    "parts.precision.set.raw_depths_mm=[300, 500, 700, 900, 1100]",
    "parts.precision.set.turns_deg=[[0, 0], [20, 0]]",
    "parts.foam_2d.set={repeats: 2, scan: {profiles: 4}}",
    f"parts.foam.set={{repeats: 2, scan: {{profiles: 30}}, {METHODS}}}",
    f"parts.desk_virtual.set={{scan: {{profiles: 24}}, {METHODS}}}",
    f"parts.desk.set={{repeats: 2, scan: {{profiles: 30}}, {METHODS}}}",
]
# Five profiles make no patch.
BLIND = ["parts.desk.set={repeats: 1, scan: {profiles: 5}}"]


def options(out: Path, *more: str) -> list[str]:
    chosen = [argument for override in SMALL for argument in ("--set", override)]
    return [str(THESIS), "--out", str(out), *chosen, *more]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("chapters") / "thesis"
    assert main(options(folder)) == 0
    return folder


def table(out: Path, name: str) -> pd.DataFrame:
    return pd.read_csv(out / "tables" / f"{name}.csv", dtype={"Table": str, "table": str})


def test_every_row_of_every_table_is_in_the_summary(out: Path) -> None:
    summary = table(out, "summary")
    assert list(summary["Table"].unique()) == ["6.1", "6.2", "6.3", "6.4", "6.5"]
    assert (summary.groupby("Table").size() == 9).all()
    printed = summary[(summary["Table"] == "6.4") & summary["Parameter"].str.startswith("Rot")]
    # The large turn stands beside the axis that was turned, under the label that it is printed by.
    assert printed["Thesis, theoretical"].tolist() == [-25.44, 0.0, 0.0]
    assert printed["Parameter"].tolist() == [
        "Rotation X (deg), printed as Z", "Rotation Y (deg)", "Rotation Z (deg), printed as X",
    ]  # fmt: skip
    errors = summary[summary["Parameter"] == "Error, translation norm (mm)"]
    expected = [np.hypot(1.44, np.hypot(9.7, 7.5)), np.hypot(2.6, np.hypot(4.5, 0.1))]
    np.testing.assert_allclose(errors["Thesis, estimate"][:2], expected, atol=0.01)


def test_the_summary_says_what_the_rows_say(out: Path) -> None:
    rows = load(out / "desk")
    numbers = table(out, "summary_numbers").set_index(["table", "method", "parameter"])
    compared = table(out, "against_thesis").set_index(["Table", "Method"])
    for pair in ("6.4", "6.5"):
        of_pair = rows[(rows["pair"] == pair) & (rows["given"] == "")]
        for method, group in of_pair.groupby("method"):
            answered = group[group["status"] == "ok"]
            number = numbers.loc[(pair, method, "translation_error_mm")]
            assert number["trials"] == len(group) == 2
            assert number["answered"] == len(answered)
            if len(answered):
                middle = np.quantile(answered["translation_error_mm"], 0.5, method="higher")
                assert number["error_median"] == pytest.approx(middle)
            told = compared.loc[(pair, method)]
            assert told["Answered"].startswith(f"{len(answered)}/2 [")
            worst = group["translation_error_mm"].where(group["status"] == "ok", np.inf).max()
            smaller = "yes" if worst < told["Thesis's (mm)"] else "no"
            assert told["Translation smaller"] == smaller


def test_the_calibration_of_the_run_is_used_and_every_part_is_told(out: Path) -> None:
    rows = load(out / "foam", specs=True)
    calibrated = rows[rows["method"] == "gauss_sphere calibrated"]
    assert len(calibrated) == 2
    spec = json.loads(calibrated["spec"].iloc[0])
    assert spec["method"]["params"]["calibration"] == str(out / "precision" / "calibration.json")
    assert set(table(out, "stages")["Part"]) == {"foam", "desk_virtual", "desk"}
    assert set(table(out, "compaction")["Part"]) == {"foam", "desk_virtual", "desk"}
    assert len(table(out, "seconds")) == 2 + 3 + 2 * 2 + 2 * 3
    assert table(out, "section_6.2")["Thesis, theoretical"].tolist()[1:] == [-58.4, -458.2, 383.2]
    left_out = table(out, "section_6.2_left_out")
    assert left_out["Pairs"].sum() == 4
    assert (left_out["Left out of the mean"] <= left_out["Pairs"]).all()
    assert (out / "tables" / "sensor_card.md").exists()


def test_every_figure_of_the_thesis_is_drawn_or_told_why_not(out: Path) -> None:
    ranges = {4: [(4, 9)], 5: [(2, 2), (7, 9)], 6: [(2, 9), (12, 30)]}
    expected = [
        f"{chapter}.{n}" for chapter, parts in ranges.items()
        for low, high in parts for n in range(low, high + 1)
    ]  # fmt: skip
    listed = pd.read_csv(out / "tables" / "figures.csv", dtype=str)
    assert listed["Figure"].tolist() == expected
    assert sorted(f.number for f in (*FIGURES, *PLANAR_FIGURES)) == sorted(expected)
    drawn = listed[~listed["File"].str.startswith("none: ")]
    assert len(drawn) >= len(listed) - 4  # in views of 30 profiles not every pair is answered
    files = {path.name for path in (out / "figures").glob("*.png")}
    assert files == set(drawn["File"])
    for name in files:
        with Image.open(out / "figures" / name) as image:
            page = np.asarray(image.convert("L"))
        assert (page < 250).mean() > 0.01, name
        assert page.shape[1] == 1080


def test_the_first_repeat_that_was_answered_is_drawn(out: Path) -> None:
    runs = {run.name: run for run in load_chapters(THESIS, None)[1]}
    session = runs["desk"].session()
    trials = [t for t in session.trials if t.label == "thesis" and not t.spec.given]
    by_repeat = {(t.pair, t.spec.repeat): t.id for t in trials}
    ok = {by_repeat["6.4", 1], by_repeat["6.4", 2], by_repeat["6.5", 2], by_repeat["6.5", 3]}
    rows = pd.DataFrame({"id": list(by_repeat.values())})
    rows["status"] = ["ok" if identity in ok else "failed" for identity in rows["id"]]
    assert isinstance(session.experiment, Experiment)
    part = PartResult("desk", (), session.experiment, session.trials, rows)
    assert [(t.pair, t.spec.repeat) for t in shown_trials(part)] == [("6.4", 2), ("6.5", 2)]
    rows["status"] = "failed"
    assert {t.spec.repeat for t in shown_trials(part)} == {0}


def test_a_figure_without_evidence_is_listed_with_the_reason(tmp_path: Path) -> None:
    session = {run.name: run for run in load_chapters(THESIS, None, BLIND)[1]}["desk"].session()
    assert isinstance(session.experiment, Experiment)
    rows = pd.DataFrame({"id": [], "status": []})
    part = PartResult("desk", (), session.experiment, session.trials, rows)
    numbers = ["5.8", "6.24", "6.30"]
    drawings = {d.number: d for d in draw_numbered(shown_trials(part), numbers, tmp_path)}
    assert drawings["6.24"].file == "figure_6.24.png"
    assert drawings["5.8"].file == drawings["6.30"].file == ""
    assert "no pair was answered" in drawings["6.30"].problem
    assert [path.name for path in tmp_path.iterdir()] == ["figure_6.24.png"]
    assert figure_table(list(drawings.values())).frame["File"].str.startswith("none: ").sum() == 2


def test_a_run_that_was_cut_off_goes_on_with_its_parts(
    out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def written() -> dict[str, bytes]:
        files = [path for kind in ("tables", "figures") for path in (out / kind).iterdir()]
        files += [out / "foam_2d" / "profiles.csv", out / "precision" / "calibration.json"]
        return {path.name: path.read_bytes() for path in files if path.stem != "seconds"}

    before = written()
    shutil.rmtree(out / "tables")
    (out / "foam_2d" / "times.csv").write_text("pair,method\n", encoding="utf-8")
    (out / "desk" / "trials.sqlite").unlink()
    assert main(options(out)) == 0
    told = capsys.readouterr().out
    assert told.count(": 0 trials to compute") == 2  # foam and desk_virtual
    assert written() == before


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("parts.desk.config=desq.yaml", "parts.desk: configs/desq.yaml: no such file"),
        ("parts.desk.set.repeats=0", "parts.desk: configs/desk.yaml: repeats: should be greater"),
        ("parts.desk.methods=[thesis, gaus]", "methods.1: configs/desk.yaml has no method 'gaus'"),
        ("parts.desk.calibrated_by=foam", "calibrated_by: 'foam' is no earlier part"),
        ("parts.foam_2d.calibrated_by=precision", "belongs to a part that registers whole"),
        ("parts.more={config: random_pairs.yaml}", "is of kind 'random_pairs'"),
        ("parts.tables={config: desk.yaml}", "to be a folder beside tables"),
        ("parts.desk.sett={}", "parts.desk.sett: unknown key; did you mean 'set'"),
    ],
)
def test_one_wrong_part_is_one_line_and_nothing_is_written(
    change: str,
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(ROOT)
    where = tmp_path / "out"
    assert main(["configs/thesis.yaml", "--out", str(where), "--set", change]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert told in error
    assert not where.exists()


def test_options_that_say_nothing_to_a_run_of_parts_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = str(tmp_path / "out")
    for more, told in (
        (["--show-scene", "desk"], "several scenes"),
        (["--trial", "ffffffffffff"], "is no trial of a part"),
        (["--report-only"], "run it first"),
    ):
        assert main([str(THESIS), "--out", where, *more]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert told in error


def test_a_trial_of_a_part_is_replayed(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    row = load(out / "desk").iloc[0]
    assert main(options(out, "--trial", row["id"])) == 0
    assert row["id"] in capsys.readouterr().out


def test_the_seed_is_that_of_every_part() -> None:
    experiment, runs = load_chapters(THESIS, None, seed=3)
    assert experiment.seed == 3
    assert {run.seed for run in runs} == {3}
    assert runs[2].session().experiment.seed == 3


def test_a_median_s_interval_is_of_order_statistics() -> None:
    values = np.arange(1.0, 51.0)
    # Binomial(50, 1/2): ranks 18 and 33 bound the median with at least 95 %.
    assert median_of(values) == (26.0, 18.0, 33.0)
    some = median_of(np.append(values[:30], np.full(20, np.inf)))
    assert some[0] == 26.0
    assert np.isinf(some[2])
    assert np.isnan(median_of(np.array([1.0, 2.0]))[1])
    assert median_of(np.zeros(0)).text(".2f") == "none"
    assert rate(50, 50) == "50/50 [93%, 100%]"


def test_all_parts_are_on_one_page(out: Path) -> None:
    page = (out / "report.html").read_text(encoding="utf-8")
    assert len(page) < LARGEST_BYTES
    ids = re.findall(r'<[a-z]+ [^>]*?\bid="([^"]+)"', page)
    assert len(set(ids)) == len(ids)
    assert {"all-parts", "precision", "foam_2d", "foam", "desk_virtual", "desk"} <= set(ids)
    assert page.index("Part by part") < page.index('<section id="pair"')
    assert re.search(r"Over \d parts, gauss_sphere registered \d+ of \d+ trials", page)
    for file in (out / "figures").glob("*.png"):
        assert file.name in page
