"""What studies conclude, from rows that are made up, so that the right answer is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.config import choices
from harness.config.errors import ConfigError
from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import load_experiment, validated
from harness.config.study_schema import Study
from harness.config.sweep_schema import Sweep
from harness.execution import full_spec
from harness.figures.page import page_style
from harness.recent import Recent
from harness.studies.indices import sobol_indices
from harness.studies.numbers import beyond_chance, gained_lost, outcomes
from harness.studies.study import Findings, draw_study, find
from harness.trials.points import point_count, sweep_points
from harness.trials.random_pairs import build_random_trials
from registration.peers import MissingPeerError

CONFIGS = Path(__file__).parents[3] / "configs"
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


def test_the_studies_are_shipped() -> None:
    assert STUDIES == [
        "leaderboard", "noise", "overlap", "sensitivity", "sensitivity_sobol", "step_profiles",
    ]  # fmt: skip


def test_failures_count_with_errors_at_the_cut() -> None:
    rows = pd.DataFrame(
        {
            "given": [""] * 4,
            "status": ["ok", "failed", "ok", "ambiguous"],
            "rotation_error_deg": [0.5, np.nan, 90.0, 0.1],
            "translation_error_mm": [2.0, np.nan, 10.0, 0.1],
        }
    )
    known = outcomes(rows)
    assert known["right"].tolist() == [True, False, False, False]
    assert known["rotation_cut_deg"].tolist() == [0.5, 5.0, 5.0, 5.0]
    assert known["translation_cut_mm"].tolist() == [2.0, 30.0, 10.0, 30.0]


@given(st.lists(st.floats(0.0, 1.0), max_size=12))
def test_holm_holds_as_its_definition_says(p_values: list[float]) -> None:
    held = beyond_chance(p_values)
    ordered = sorted(p_values)
    n = len(p_values)
    most = next((k for k in range(n) if ordered[k] > 0.05 / (n - k)), n)
    assert held.sum() == most
    assert sorted(np.asarray(p_values)[held]) == ordered[:most]


def test_gains_and_losses_are_of_pairs() -> None:
    ours = pd.DataFrame({"pair": list("abcd"), "repeat": 0, "right": [True, True, True, False]})
    theirs = pd.DataFrame({"pair": list("dcba"), "repeat": 0, "right": [True, False, False, True]})
    gained, lost, p = gained_lost(ours, theirs)
    assert (gained, lost) == (2, 1)
    assert p == 1.0


@pytest.mark.parametrize("reversed_", [False, True])
def test_indices_of_ishigami(reversed_: bool) -> None:
    bounds = {"distribution": "uniform", "from": -np.pi, "to": np.pi}
    keys = ["x1", "x2", "x3"]
    data = {"design": "saltelli", "samples": 1024, "over": dict.fromkeys(keys, bounds)}
    sweep: Sweep = validated(Sweep, data, "file")
    x1, x2, x3 = np.array([list(p.values.values()) for p in sweep_points(sweep)]).T
    if reversed_:
        x1, x3 = x3, x1
    a, b = 7.0, 0.1
    outputs = np.sin(x1) + a * np.sin(x2) ** 2 + b * x3**4 * np.sin(x1)
    found = sobol_indices(sweep, outputs)
    np.testing.assert_array_equal(found, sobol_indices(sweep, outputs))
    # T. Ishigami and T. Homma, 1990: the variance and its parts are known.
    interplay = 8.0 * b**2 * np.pi**8 / 225.0
    alone = np.array([0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2, a**2 / 8.0, 0.0])
    total = alone + np.array([interplay, 0.0, interplay])
    order = slice(None, None, -1) if reversed_ else slice(None)
    variance = alone.sum() + interplay
    np.testing.assert_allclose(found.first[order], alone / variance, atol=0.06)
    np.testing.assert_allclose(found.total[order], total / variance, atol=0.06)
    inside = np.abs(found.total[order] - total / variance) <= 1.5 * found.total_half[order]
    assert inside.all()
    assert (found.first_half < 0.2).all()


def test_an_output_without_variance_has_no_indices() -> None:
    over = {"x1": {"distribution": "uniform", "from": 0, "to": 1}}
    sweep: Sweep = validated(Sweep, {"design": "saltelli", "samples": 4, "over": over}, "file")
    assert np.isnan(sobol_indices(sweep, np.ones(point_count(sweep))).total).all()


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
    assert f"depends most on {name} (total index" in found.conclusion[0]
    rows = rows_of("sensitivity_sobol", 3, lambda _, s, n: n > 0, sweep=small)
    unfinished = find(experiment("sensitivity_sobol", sweep=small), rows.iloc[:-1])
    assert "255 of 256 points" in unfinished.conclusion[0]
    assert not unfinished.tables


@pytest.mark.parametrize("name", list(KEYS))
def test_curves_name_the_parameter_that_decides(name: str) -> None:
    key = KEYS[name]
    found = concluded("sensitivity", 12, lambda _, s, n: key not in s or (s[key] < 0.6 and n > 0))
    first, second = found.conclusion
    assert f"hangs most on {name}" in first
    if name == "WARP":
        assert second.endswith("worse: WARP 1, 1.42, 2, 2.83, 5.66, 8, 11.3, 16.")
    else:
        assert second.endswith("worse: OverlapTh 0.8.")


def test_the_grid_frames_the_best_step() -> None:
    step = "sweep.scan.step_mm".removeprefix("sweep.")
    for best in (2.5, 10.0):
        found = concluded("step_profiles", 12, lambda _, s, n, b=best: s[step] == b or n < 1)
        assert f"60 profiles {best:g} mm" in found.conclusion[0]
        assert "[" not in found.conclusion[0].partition(": ")[2]


def test_overlap_says_from_where_on_it_is_enough() -> None:
    def works(method: str, _: Any, number: int) -> bool:
        return method == "gauss_sphere" or number >= 60

    found = concluded("overlap", 120, works)
    assert "gauss_sphere 100% and 100%, 90% or more from 10% on" in found.conclusion[0]
    assert "thesis 0% and 100%, 90% or more from 50% on" in found.conclusion[0]
    assert "gauss_sphere rises" in found.conclusion[1]
    turned = concluded("overlap", 120, lambda m, s, n: works(m, s, 119 - n))
    assert "thesis 100% and 0%, nowhere 90%" in turned.conclusion[0]


@pytest.mark.parametrize("effect", ["bulge", "ghosts"])
def test_effects_name_the_one_that_harms(effect: str) -> None:
    def works(_: str, shown: dict[str, Any], number: int) -> bool:
        name = shown["sensor.params.noise"]
        return name in ("none", f"all but {effect}") or (
            name.startswith("only ") and (name != f"only {effect}")
        )

    first, second = concluded("noise", 12, works).conclusion
    assert f"thesis (30.0 mm with all, 1.1 with none): {effect} (-28.9)" in first
    assert f"thesis {effect} (+28.9), twice as large" in second


@pytest.mark.parametrize("best", ["thesis", "gauss_sphere"])
def test_the_ranking_names_the_best(best: str) -> None:
    methods = experiment("leaderboard").methods[1:3]
    methods = (methods[0].model_copy(update={"label": "gauss_sphere"}), methods[1])
    found = concluded("leaderboard", 30, lambda m, s, n: m == best or n < 3, methods=methods)
    assert f"Most often right: {best}, 100% of 30 pairs" in found.conclusion[0]
    assert found.conclusion[0].endswith("none.")
    assert f"{best} is the most exact" in found.conclusion[1]


@pytest.mark.parametrize("name", STUDIES)
def test_figures_are_not_blank(name: str, tmp_path: Path) -> None:
    from PIL import Image

    sweep = experiment(name).sweep
    changes = {}
    if sweep is not None and sweep.samples:
        changes = {"sweep": sweep.model_copy(update={"samples": 4})}
    found = concluded(name, 12, lambda m, s, n: (len(str(s)) + n) % 3 > 0, **changes)
    assert all(found.conclusion)
    assert all(line in found.tables[0].legend for line in found.conclusion)
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
    assert "not told apart: CLIFF), least on" in found.conclusion[0]
    found = concluded("step_profiles", 12, lambda _m, _s, number: number > 5)
    assert "gauss_sphere: 15 profiles any of them" in found.conclusion[0]
    assert "gains 0 trials and loses 0, not beyond chance" in found.conclusion[1]
    found = concluded("noise", 12, lambda _m, _s, number: number > 5)
    assert "one effect alone: gauss_sphere none, twice as large none" in found.conclusion[1]
    found = concluded("leaderboard", 12, lambda _m, _s, _n: True)
    assert "mm; not told apart: " in found.conclusion[1]


def test_a_figure_has_its_conclusion_at_its_foot() -> None:
    found = concluded("overlap", 60, lambda m, s, n: n % 4 > 0)
    with page_style():
        texts = [text.get_text() for text in found.figures["overlap"]().texts]
    words = " ".join(found.conclusion)
    assert words in [" ".join(text.split()) for text in texts]


@pytest.mark.parametrize(
    ("kind", "names", "sweep", "message"),
    [
        ("curves", {}, None, "needs a sweep of design one_at_a_time, there is none"),
        ("indices", {}, {"over": {"a": [1]}}, "needs a sweep of design saltelli, not product"),
        ("overlap", {}, {"over": {"a": [1]}}, "has no sweep; take `sweep` out"),
        ("ranking", {"a": "b"}, None, "`names` says nothing"),
        ("effects", {}, {"over": {"a": [1], "b": [1]}}, "sweeps one key, not 2"),
        ("effects", {"b": "B"}, {"over": {"a": [1]}}, "`names` has b, which is not swept"),
        ("grid", {}, {"over": {"a": [1]}}, "sweeps scan.profiles and scan.step_mm"),
        (
            "grid",
            {},
            {"over": {"scan.profiles": [8], "scan.step_mm": {"named": {"a": 1}}}},
            "needs numbers of scan.step_mm, not names",
        ),
        (
            "curves",
            {},
            {"design": "one_at_a_time", "over": {"a": [1, "b"]}},
            "needs numbers, or names that are, of a, not 'b'",
        ),
        (
            "curves",
            {},
            {"design": "one_at_a_time", "over": {"a": {"named": {"5": 1, "b": 2}}}},
            "needs numbers, or names that are, of a, not 'b'",
        ),
        ("effects", {}, {"over": {"a": {"named": {"only x": 1}}}}, "'all' among them"),
        ("effects", {}, {"over": {"a": {"named": {"all": 1, "no x": 2}}}}, "'twice X', not 'no x'"),
        ("effects", {}, {"over": {"a": [1, 2]}}, "needs values of a named 'none', 'all'"),
    ],
)
def test_a_study_needs_its_sweep(
    kind: str, names: dict[str, str], sweep: dict[str, Any] | None, message: str
) -> None:
    study: Study = validated(Study, {"kind": kind, "names": names}, "file")
    made = None if sweep is None else validated(Sweep, sweep, "file")
    with pytest.raises(ValueError, match=message):
        study.check(made)


def test_keys_that_go_along() -> None:
    data = {"over": {"a": [1, 2]}, "along": {"b": ["c"]}}
    with pytest.raises(ConfigError, match="`along` names b, which is not swept"):
        validated(Sweep, data, "file")
    with pytest.raises(ConfigError, match="a is swept twice"):
        validated(Sweep, data | {"along": {"a": ["a"]}}, "file")


def test_the_pairs_stay_those_that_were_drawn_for() -> None:
    study = experiment("step_profiles")
    views = set()
    for profiles in (15, 30):
        scan = study.scan.model_copy(update={"profiles": profiles, "step_mm": 300.0 / profiles})
        changed = study.model_copy(update={"scan": scan, "sweep": None, "study": None})
        trial = build_random_trials(changed, CONFIGS / "step_profiles.yaml")[0]
        spec = full_spec(trial)
        assert (spec.profiles, spec.step_mm) == (profiles, 300.0 / profiles)
        views.add((spec.target, spec.source))
    assert len(views) == 1


def test_optional_methods_are_left_out_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str, _: Any) -> None:
        raise MissingPeerError(f"{name} is not installed")

    monkeypatch.setattr(choices, "check_installed", missing)
    methods = experiment("leaderboard").methods
    kept, reasons = choices.installed_methods(methods, CONFIGS / "leaderboard.yaml")
    assert {method.name for method in kept} == {"gauss_sphere", "thesis"}
    assert len(kept) + len(reasons) == len(methods)
    assert "RANSAC is left out: open3d_ransac is not installed" in reasons
    needed = tuple(method.model_copy(update={"optional": False}) for method in methods)
    with pytest.raises(ConfigError, match="open3d_ransac is not installed"):
        choices.chosen_methods(needed, CONFIGS / "leaderboard.yaml", Recent(20))
