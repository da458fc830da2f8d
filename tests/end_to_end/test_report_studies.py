"""Studies on the page: from a point in a real browser to the trials behind it."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from pages import CONFIG, complaints, needs_browser, opened, until
from selenium import webdriver
from selenium.webdriver.common.by import By

from experiments.cli import main
from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import load_experiment
from harness.report.page import Part, Shown, page_markup
from harness.report.pair_studies import pair_study
from harness.report.run_page import listed_trials
from harness.store import load

CONFIGS = Path(__file__).parents[2] / "configs"


@needs_browser
def test_a_study_leads_from_its_points_to_their_trials(
    browser: webdriver.Chrome, tmp_path: Path
) -> None:
    config = tmp_path / "study.yaml"
    sweep = "sweep: {over: {scan.step_mm: [4, 5], scan.profiles: [36, 40]}}\n"
    text = CONFIG.replace("repeats: 2", "repeats: 1") + sweep
    config.write_text(text, encoding="utf-8")
    out = tmp_path / "out"
    assert main([str(config), "--out", str(out), "--workers", "2"]) == 0
    opened(browser, out / "report.html")
    browser.execute_script("document.getElementById('study').scrollIntoView()")
    until(browser, "document.querySelector('form.study').dataset.ready", "the study is drawn")
    plot = "document.querySelector('form.study .plot')"
    assert browser.execute_script(f"return {plot}.data.length") == 3  # methods
    for name, value in (("and", "1"), ("method", "thesis")):
        browser.execute_script(
            f"const s = document.querySelector('form.study').elements['{name}'];"
            f"s.value = '{value}'; s.dispatchEvent(new Event('change'))"
        )
    until(browser, f"{plot}.data[0].type === 'heatmap'", "a map over two keys")
    browser.execute_script(
        f"{plot}.emit('plotly_click', {{points: [{{curveNumber: 0, pointNumber: [1, 0]}}]}})"
    )
    shown = browser.find_element(By.CSS_SELECTOR, "form.study .behind tbody").text
    rows = load(out)
    chosen = (rows["sweep.scan.step_mm"] == 4) & (rows["sweep.scan.profiles"] == 40)
    (identity,) = rows.loc[chosen & (rows["method"] == "thesis"), "id"]
    assert shown.startswith(identity)
    # Without a mouse, a point is chosen from a list.
    browser.execute_script(
        "const s = document.querySelector('form.study').elements.point;"
        "s.value = '3'; s.dispatchEvent(new Event('change'))"
    )
    assert browser.find_element(By.CSS_SELECTOR, "form.study .behind").is_displayed()
    assert complaints(browser) == []
    # Without scripts a still stands in its place.
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        opened(browser, out / "report.html")
        still = browser.find_element(By.CSS_SELECTOR, "#study img")
        assert still.is_displayed()
        assert still.size["width"] > 300
    finally:
        browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


@needs_browser
@pytest.mark.parametrize("kind", ["overlap", "leaderboard"])
def test_a_study_of_random_pairs_leads_to_their_trials(
    browser: webdriver.Chrome, tmp_path: Path, kind: str
) -> None:
    rows = pd.DataFrame(
        [
            {
                "id": f"{method}{number:08d}", "pair": f"{'ab'[number % 2]} {number}",
                "method": method, "given": "", "repeat": 0, "status": "ok",
                "rotation_error_deg": 0.1, "translation_error_mm": 1.0, "ms_registration": 9.0,
                "overlap_target": 0.15 + 0.1 * (number // 2), "overlap_source": 0.9,
            }
            for number in range(14) for method in ("first", "second")
        ]
    )  # fmt: skip
    experiment = load_experiment(CONFIGS / f"{kind}.yaml")
    assert isinstance(experiment, RandomPairsExperiment)
    part = Part(name="x", title="x", study=pair_study(rows, experiment))
    page = tmp_path / "report.html"
    listed = listed_trials(rows, ["run-experiment", "x.yaml"])
    page.write_text(page_markup("x", [part], Shown(trials=listed)), encoding="utf-8")
    opened(browser, page)
    until(browser, "document.querySelector('form.study').dataset.ready", "the study is drawn")
    plot = "document.querySelector('form.study .plot')"
    curves = browser.execute_script(f"return {plot}.data.map((t) => [t.mode, [...t.x]])")
    if kind == "overlap":
        middles = [15, 25, 35, 45, 55, 65, 75]
        assert curves == [["lines+markers", middles]] * 2
        behind = ["second00000004", "second00000005"]
    else:
        assert curves == [["markers", ["first", "second"]]]
        behind = sorted(rows.loc[rows["method"] == "second", "id"])
    curve, point = (1, 2) if kind == "overlap" else (0, 1)
    where = f"{{curveNumber: {curve}, pointNumber: {point}}}"
    browser.execute_script(f"{plot}.emit('plotly_click', {{points: [{where}]}})")
    lines = browser.find_elements(By.CSS_SELECTOR, "form.study .behind tbody tr")
    assert sorted(line.text.split()[0] for line in lines) == behind
    browser.execute_script(
        "const s = document.querySelector('form.study').elements;"
        "s.method.value = s.method.options[s.method.options.length - 1].value;"
        "s.and.value = '1'; s.and.dispatchEvent(new Event('change'))"
    )
    until(browser, f"{plot}.data[0].type === 'heatmap'", "a map over the scenes")
    assert browser.execute_script(f"return [...{plot}.data[0].y]") == ["all", "a", "b"]
    assert complaints(browser) == []
