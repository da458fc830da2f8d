from __future__ import annotations

import html
from pathlib import Path

import pandas as pd
import pytest

from experiments.cli import main
from harness.report.records import provided
from harness.session import open_session
from harness.store import load
from harness.tables.notes import with_notes

NOTED = ["a note", "and <another>"]


def test_notes_are_kept_exported_replayed_and_shown(
    small_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    request = [str(small_file), "--out", str(out), "--set", "repeats=1"]
    request += ["--set", "methods=[{name: 'own_methods:note', label: own, figures: false}]"]
    assert main([*request, "--workers", "1"]) == 0
    rows = load(out)
    assert set(rows["notes"]) == {"\n".join(NOTED)}

    for name in ("rows.csv", "rows.parquet"):
        assert main([*request, "--export", str(tmp_path / name)]) == 0
    assert set(pd.read_csv(tmp_path / "rows.csv")["notes"]) == {"\n".join(NOTED)}
    assert set(pd.read_parquet(tmp_path / "rows.parquet")["notes"]) == {"\n".join(NOTED)}

    identity = rows["id"][0]
    capsys.readouterr()
    main([*request, "--trial", identity])
    replayed = capsys.readouterr().out
    assert all(f"note       {note}" in replayed for note in NOTED)

    page = (out / "report.html").read_text(encoding="utf-8")
    assert f"Note: {html.escape('; '.join(NOTED))}." in page
    assert "Notes" in pd.read_csv(out / "tables" / "failures.csv")

    # What the page shows in 3D is made again where its notes are not those of the row.
    trials = {trial.id: trial for trial in open_session(small_file, out, request[4::2]).trials}

    def refuse() -> None:
        raise AssertionError("something is replayed")

    assert provided([identity], trials, rows, out / "pairs", refuse)[identity]["notes"] == NOTED
    with pytest.raises(AssertionError, match="replayed"):
        provided([identity], trials, rows.assign(notes="b"), out / "pairs", refuse)


def test_a_table_has_notes_only_where_there_are_some() -> None:
    rows, frame = pd.DataFrame({"notes": ["", "a\nb"]}), pd.DataFrame({"Trial": ["x", "y"]})
    assert list(with_notes(frame, rows)["Notes"]) == ["", "a; b"]
    assert list(with_notes(frame, rows.assign(notes="")).columns) == ["Trial"]
