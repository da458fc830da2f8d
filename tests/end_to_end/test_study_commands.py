"""Every shipped study by the command itself, with one pair of views."""

from __future__ import annotations

import html
from pathlib import Path

import pandas as pd
import pytest

from experiments.cli import main
from harness.config.reading import read_mapping
from harness.store import load

ROOT = Path(__file__).parents[2]
STUDIES = [f for f in sorted((ROOT / "configs").glob("*.yaml")) if "study" in read_mapping(f)]


@pytest.mark.parametrize("file", STUDIES, ids=lambda file: file.stem)
def test_every_study_runs_and_concludes(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = read_mapping(file)
    # One pair, drawn at once, and the longest scans left out; the rest is as it is shipped.
    family = data["families"]["desk"] | {"pairs": 1}
    sets = {"families": {"desk": family}, "overlap": [0.3, 1.0]}
    sweep = data.get("sweep")
    if sweep is not None:
        over = {key: _short(values) for key, values in sweep["over"].items()}
        few = {"samples": 2} if "samples" in sweep else {}
        sets["sweep"] = sweep | {"over": over} | few
    options = [argument for k, v in sets.items() for argument in ("--set", f"{k}={v}")]
    assert main([str(file), "--out", str(tmp_path), *options]) == 0
    shown = capsys.readouterr().out
    rows = load(tmp_path, arrays=False)
    assert not (rows["status"] == "error").any()
    kind = data["study"]["kind"]
    if "sweep" in data:
        assert rows["sweep.point"].nunique() > 3
    assert len(pd.read_csv(tmp_path / "tables" / f"study_{kind}.csv")) > 0
    text = (tmp_path / "tables" / f"study_{kind}.md").read_text(encoding="utf-8")
    conclusion = text.partition("\n\n")[0].splitlines()[-2:]
    assert len(conclusion) == 2
    assert all(len(line) > 40 for line in conclusion)
    assert conclusion[0].split()[0] in shown
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    answer = html.unescape(page.partition('class="answer">')[2].partition("</p>")[0])
    assert answer == " ".join(conclusion)
    pictures = list((tmp_path / "figures").glob("study_*.png"))
    assert pictures
    assert all(picture.stat().st_size > 5000 for picture in pictures)


def _short(values: object) -> object:
    """The values of a key without those that are not needed to try it."""
    if isinstance(values, list):
        return values[:2]
    if isinstance(values, dict) and "named" in values:
        few = ("5", "10", "none", "all", "all but bulge", "only bulge", "twice bulge", "only mixed")
        return {"named": {k: v for k, v in values["named"].items() if k in few}}
    return values
