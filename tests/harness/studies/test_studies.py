"""What studies conclude, from rows that are made up, so that the right answer is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from shipped_configs import CONFIGS

from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import load_experiment
from harness.figures.page import page_style
from harness.studies.study import Findings, draw_study, find
from harness.trials.points import sweep_points

STUDIES = sorted(f.stem for f in CONFIGS.glob("*.yaml") if "\nstudy:" in f.read_text("utf-8"))


def experiment(name: str, **changes: Any) -> RandomPairsExperiment:
    found = load_experiment(CONFIGS / f"{name}.yaml")
    assert isinstance(found, RandomPairsExperiment)
    return found.model_copy(update=changes)


def rows_of(name: str, pairs: int, works: Any, **changes: Any) -> pd.DataFrame:
    """Rows as store.load would give them; works(method, shown, number) says which are right."""
    study = experiment(name, **changes)
    points = list(sweep_points(study.sweep)) if study.sweep else [None]
    records = []
    for point in points:
        for number in range(pairs):
            for method in study.methods:
                label = method.label or method.name
                shown = point.shown if point else {}
                right = bool(works(label, shown, number))
                record = {
                    "pair": f"{list(study.families)[number % 3]} {number}",
                    "method": label, "given": "", "repeat": number,
                    "status": "ok" if right else "failed",
                    "rotation_error_deg": 0.1 if right else np.nan,
                    "translation_error_mm": 1.0 + 0.01 * number if right else np.nan,
                    "overlap_target": 0.1 + 0.7 * number / pairs,
                    "overlap_source": 0.9,
                    "ms_registration": 10.0 + len(label),
                }  # fmt: skip
                if point:
                    record |= {"sweep.point": point.number, "sweep.varied": point.varied}
                    base = dict.fromkeys(study.sweep.over, 1.0) if study.sweep else {}
                    base |= {"scan": '{"profiles": 60}'} if "scan" in base else {}
                    record |= {f"sweep.{k}": v for k, v in (base | shown).items()}
                record["id"] = f"{label} {number} {sorted(shown.items())}"
                records.append(record)
    return pd.DataFrame(records)


def concluded(name: str, pairs: int, works: Any, **changes: Any) -> Findings:
    return find(experiment(name, **changes), rows_of(name, pairs, works, **changes))


def conclusion(found: Findings) -> list[str]:
    """The two lines under the first table, which the terminal and the page show."""
    return found.tables[0].note.strip().splitlines()


def test_the_studies_are_shipped() -> None:
    assert STUDIES == [
        "leaderboard", "noise", "overlap", "sensitivity", "sensitivity_sobol", "step_profiles",
    ]  # fmt: skip


KEYS = {"WARP": "methods.thesis.params.segments.warp_mm",
        "OverlapTh": "methods.thesis.params.merge.overlap_th"}  # fmt: skip


@pytest.mark.parametrize("name", list(KEYS))
def test_indices_name_the_parameter_that_decides(name: str) -> None:
    key = KEYS[name]
    middle = {"WARP": 4.0, "OverlapTh": 0.2}[name]
    sweep = experiment("sensitivity_sobol").sweep
    assert sweep is not None
    small = sweep.model_copy(update={"samples": 32})
    found = concluded("sensitivity_sobol", 3, lambda _, s, n: s[key] > middle, sweep=small)
    assert f"depends most on {name} (total index" in conclusion(found)[0]


def test_an_incomplete_design_is_told_in_the_place_of_its_indices() -> None:
    sweep = experiment("sensitivity_sobol").sweep
    assert sweep is not None
    small = sweep.model_copy(update={"samples": 32})
    rows = rows_of("sensitivity_sobol", 3, lambda _, s, n: n > 0, sweep=small)
    unfinished = find(experiment("sensitivity_sobol", sweep=small), rows.iloc[:-1])
    told = "No indices yet: 255 of 256 points of the design are complete."
    assert conclusion(unfinished) == [told, "Run the rest first."]
    (line,) = unfinished.tables[0].text()
    assert line == ["255", "256"]
    assert not unfinished.figures


@pytest.mark.parametrize("name", list(KEYS))
def test_curves_name_the_parameter_that_decides(name: str) -> None:
    key = KEYS[name]
    found = concluded("sensitivity", 12, lambda _, s, n: key not in s or (s[key] < 0.6 and n > 0))
    first, second = conclusion(found)
    assert f"hangs most on {name}" in first
    if name == "WARP":
        assert second.endswith("worse: WARP 1, 1.42, 2, 2.83, 5.66, 8, 11.3, 16.")
    else:
        assert second.endswith("worse: OverlapTh 0.8.")


def test_the_grid_frames_the_best_step() -> None:
    step = "sweep.scan.step_mm".removeprefix("sweep.")
    for best in (2.5, 10.0):
        found = concluded("step_profiles", 12, lambda _, s, n, b=best: s[step] == b or n < 1)
        assert f"60 profiles {best:g} mm" in conclusion(found)[0]
        assert "[" not in conclusion(found)[0].partition(": ")[2]


def test_overlap_says_from_where_on_it_is_enough() -> None:
    def works(method: str, _: Any, number: int) -> bool:
        return method == "gauss_sphere" or number >= 60

    found = concluded("overlap", 120, works)
    assert "gauss_sphere 100% and 100%, 90% or more from 10% on" in conclusion(found)[0]
    assert "thesis 0% and 100%, 90% or more from 50% on" in conclusion(found)[0]
    assert "gauss_sphere rises" in conclusion(found)[1]
    turned = concluded("overlap", 120, lambda m, s, n: works(m, s, 119 - n))
    assert "thesis 100% and 0%, nowhere 90%" in conclusion(turned)[0]


@pytest.mark.parametrize("effect", ["bulge", "ghosts"])
def test_effects_name_the_one_that_harms(effect: str) -> None:
    def works(_: str, shown: dict[str, Any], number: int) -> bool:
        name = shown["sensor.params.noise"]
        return name in ("none", f"all but {effect}") or (
            name.startswith("only ") and (name != f"only {effect}")
        )

    first, second = conclusion(concluded("noise", 12, works))
    assert f"thesis (30.0 mm with all, 1.1 with none): {effect} (-28.9)" in first
    assert f"thesis {effect} (+28.9), twice as large" in second


@pytest.mark.parametrize("best", ["thesis", "gauss_sphere"])
def test_the_ranking_names_the_best(best: str) -> None:
    methods = experiment("leaderboard").methods[1:3]
    methods = (methods[0].model_copy(update={"label": "gauss_sphere"}), methods[1])
    found = concluded("leaderboard", 30, lambda m, s, n: m == best or n < 3, methods=methods)
    assert f"Most often right: {best}, 100% of 30 pairs" in conclusion(found)[0]
    assert conclusion(found)[0].endswith("none.")
    assert f"{best} is the most exact" in conclusion(found)[1]


def test_a_ranking_without_any_registration_is_drawn(tmp_path: Path) -> None:
    rows = rows_of("leaderboard", 6, lambda _m, _s, _n: False).assign(ms_registration=np.nan)
    found = find(experiment("leaderboard"), rows)
    assert found.tables[0].frame["Median time (ms)"].isna().all()
    assert draw_study(found, tmp_path)


@pytest.mark.parametrize("name", STUDIES)
def test_figures_are_not_blank(name: str, tmp_path: Path) -> None:
    from PIL import Image

    sweep = experiment(name).sweep
    changes = {}
    if sweep is not None and sweep.samples:
        changes = {"sweep": sweep.model_copy(update={"samples": 4})}
    found = concluded(name, 12, lambda m, s, n: (len(str(s)) + n) % 3 > 0, **changes)
    assert all(conclusion(found))
    assert all(line in found.tables[0].legend for line in conclusion(found))
    files = draw_study(found, tmp_path)
    assert len(files) == len(found.figures)
    for file in files:
        colours = Image.open(file).convert("RGB").getcolors(100_000)
        assert colours is not None
        assert len(colours) > 20


def test_what_chance_may_have_made_is_told_so() -> None:
    """Of parameters, steps and methods that do equally well, none is named as if it were best."""
    warp, cliff = (
        "methods.thesis.params.segments.warp_mm",
        "methods.thesis.params.segments.cliff_mm",
    )

    def works(_method: str, shown: Any, number: int) -> bool:
        return number > (9 if shown.get(warp) == 1 or shown.get(cliff) == 40 else 3)

    found = concluded("sensitivity", 12, works)
    assert "not told apart: CLIFF), least on" in conclusion(found)[0]
    found = concluded("step_profiles", 12, lambda _m, _s, number: number > 5)
    assert "gauss_sphere: 15 profiles any of them" in conclusion(found)[0]
    assert "gains 0 trials and loses 0, not beyond chance" in conclusion(found)[1]
    found = concluded("noise", 12, lambda _m, _s, number: number > 5)
    assert "one effect alone: gauss_sphere none, twice as large none" in conclusion(found)[1]
    found = concluded("leaderboard", 12, lambda _m, _s, _n: True)
    assert "mm; not told apart: " in conclusion(found)[1]


def test_a_figure_has_its_conclusion_at_its_foot() -> None:
    found = concluded("overlap", 60, lambda m, s, n: n % 4 > 0)
    with page_style():
        texts = [text.get_text() for text in found.figures["overlap"]().texts]
    words = " ".join(conclusion(found))
    assert words in [" ".join(text.split()) for text in texts]
