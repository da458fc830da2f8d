"""The page that ends every run: built by the command, the same again, whole in a real browser."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from experiments.cli import main
from harness.config.random_schema import RandomPairsExperiment
from harness.config.reading import load_experiment
from harness.report.page import LARGEST_BYTES, Part, Shown, page_markup
from harness.report.pair_studies import pair_study
from harness.report.run_page import _listed
from harness.store import load

CONFIGS = Path(__file__).parents[2] / "configs"
BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
needs_browser = pytest.mark.skipif(
    (BROWSER is None or DRIVER is None) and "BROWSER_REQUIRED" not in os.environ,
    reason="no chromium and chromedriver here: apt-get install chromium chromium-driver",
)
MARKUP = "plates <b id=planted>& \"quotes\"</b><script>document.title='planted'</script>"
CONFIG = f"""\
title: 'Plates seen twice {MARKUP.replace("'", "''")}'
scene: {{name: separated_planes}}
sensor: {{name: jupiter}}
scan: {{profiles: 40, step_mm: 5.0}}
views:
  left: {{aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: -8}}
  right: {{aim_mm: [0, 0, 0], distance_mm: 700, yaw_deg: 8}}
pairs:
  '{MARKUP.replace("'", "''")}': {{source: left, target: right}}
methods:
  - {{name: thesis}}
  # It reads no patch from noisy scans: a failure to show.
  - {{name: thesis, preset: literal, label: literal, figures: false}}
  - {{name: gauss_sphere}}
repeats: 2
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results folder of a small run with a failure in it and markup in its names."""
    folder = tmp_path_factory.mktemp("report")
    config = folder / "plates.yaml"
    config.write_text(CONFIG, encoding="utf-8")
    out = folder / "out"
    assert main([str(config), "--out", str(out), "--workers", "2"]) == 0
    return out


def test_the_page_holds_the_run(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = (results / "report.html").read_text(encoding="utf-8")
    assert len(page) < LARGEST_BYTES
    rows = load(results)
    failed = rows[rows["status"] != "ok"]
    assert len(failed)
    for identity in failed["id"]:
        assert f"plates.yaml --trial {identity}" in page  # the command that replays it
    for file in (results / "figures").glob("*.png"):
        assert file.name in page
    assert page.count("data:image/png;base64,") >= len(list((results / "figures").glob("*.png")))
    assert "<script>document.title" not in page
    assert "<b id=planted>" not in page


def test_the_page_is_built_again_the_same(results: Path) -> None:
    before = (results / "report.html").read_bytes()
    for file in [*(results / "pairs").iterdir(), results / "report.html"]:
        file.unlink()
    config = results.parent / "plates.yaml"
    assert main([str(config), "--out", str(results), "--report-only"]) == 0
    assert (results / "report.html").read_bytes() == before


@pytest.fixture(scope="module")
def browser() -> Iterator[webdriver.Chrome]:
    """Chromium without a screen, a profile or a network."""
    options = Options()
    assert BROWSER is not None
    options.binary_location = BROWSER
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        for argument in (
            "--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            "--disable-dev-shm-usage", "--enable-unsafe-swiftshader", "--use-gl=angle",
            "--use-angle=swiftshader", "--hide-scrollbars", f"--user-data-dir={profile}",
            "--host-resolver-rules=MAP * ~NOTFOUND",
        ):  # fmt: skip
            options.add_argument(argument)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        driver = webdriver.Chrome(options=options, service=Service(DRIVER))
        driver.set_page_load_timeout(60)
        try:
            yield driver
        finally:
            driver.quit()


def opened(browser: webdriver.Chrome, page: Path, width: int = 1400) -> None:
    """Open a page from disk at a width; what was logged before is dropped."""
    size = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get("about:blank")
    for kind in ("browser", "performance"):
        browser.get_log(kind)
    browser.get(page.as_uri())
    # On a busy machine the driver comes back before the page's scripts have run.
    loaded = "location.protocol === 'file:' && document.readyState === 'complete'"
    until(browser, loaded, f"{page.name} is not loaded")


def complaints(browser: webdriver.Chrome) -> list[str]:
    """What the console holds of errors, and every request that left the page."""
    found = [e["message"] for e in browser.get_log("browser") if e["level"] == "SEVERE"]
    for entry in browser.get_log("performance"):
        message: dict[str, Any] = json.loads(entry["message"])["message"]
        if message["method"] == "Network.requestWillBeSent":
            url = message["params"]["request"]["url"]
            if not url.startswith(("file:", "data:", "blob:")):
                found.append(f"asked for {url}")
    return found


def until(browser: webdriver.Chrome, script: str, what: str) -> None:
    WebDriverWait(browser, 90, 0.2).until(lambda b: b.execute_script(f"return {script}"), what)


def drawn(browser: webdriver.Chrome) -> list[int]:
    """How many points or corners each trace in the space has."""
    return browser.execute_script(
        "return (document.getElementById('space').data || []).map((t) => t.x.length)"
    )


@needs_browser
def test_a_reader_uses_the_page(results: Path, browser: webdriver.Chrome, tmp_path: Path) -> None:
    opened(browser, results / "report.html")
    assert browser.title.startswith("Plates seen twice plates <b id=planted>")
    assert browser.find_elements(By.ID, "planted") == []
    browser.execute_script("document.getElementById('pair').scrollIntoView()")
    until(browser, "!!document.querySelector('#space canvas')", "the pair is drawn")
    assert "gauss_sphere" in browser.find_element(By.ID, "told").text
    registered = drawn(browser)
    assert len(registered) == 2
    made = browser.find_element(By.CSS_SELECTOR, "#answer").text
    assert "plates.yaml" in made
    assert "numpy" in made

    # Layers are toggled with the keyboard alone.
    box = browser.find_element(By.CSS_SELECTOR, 'input[value="surfaces"]')
    box.send_keys(" ")
    until(browser, "document.getElementById('space').data.some((t) => t.type === 'mesh3d')",
          "the exact surfaces are shown")  # fmt: skip
    box.send_keys(" ")
    until(browser, "!document.getElementById('space').data.some((t) => t.type === 'mesh3d')",
          "the exact surfaces are hidden")  # fmt: skip
    browser.find_element(By.CSS_SELECTOR, 'input[value="distance"]').click()
    until(browser, "document.getElementById('space').data.some((t) => t.marker?.showscale)",
          "distances have a scale")  # fmt: skip

    # The slider leads from the raw profiles to the exact pose.
    slider = browser.find_element(By.ID, "stage")
    names = []
    browser.execute_script(
        "arguments[0].value = 0; arguments[0].dispatchEvent(new Event('input'))", slider
    )
    for _ in range(int(slider.get_attribute("max")) + 1):
        names.append(browser.find_element(By.ID, "stage-name").text.split(", ")[1])
        assert len(drawn(browser)) > 0
        slider.send_keys("\ue014")  # arrow right
    assert names[0] == "Raw profiles"
    assert names[-2:] == ["Registered", "Exact pose"]

    assert "Line segments" in names
    # The space is turned, approached and set back by keys alone.
    look = "document.getElementById('space')._fullLayout.scene._scene.getCamera().eye"
    space, home = browser.find_element(By.ID, "space"), browser.execute_script(f"return {look}")
    for key in ("\ue012", "\ue013", "+"):  # arrows left and up
        at = browser.execute_script(f"return {look}")
        space.send_keys(key)
        until(browser, f"JSON.stringify({look}) !== {json.dumps(json.dumps(at))}", f"{key} turns")
    size = {end: sum(v * v for v in eye.values()) for end, eye in (("home", home), ("at", at))}
    assert size["at"] == pytest.approx(size["home"])  # arrows turn and come no closer
    space.send_keys("0")
    until(browser, f"Math.abs({look}.x - ({home['x']})) < 1e-9", "back to the first look")
    assert browser.find_element(By.ID, "shifts").is_displayed()

    # The worst trial opens from its card among the failures.
    button = browser.find_element(By.CSS_SELECTOR, "#failures .card button[data-show]")
    browser.execute_script("arguments[0].click()", button)
    worst = button.get_attribute("data-show")
    until(browser, f"document.getElementById('trial').value === '{worst}'", "the worst trial")
    until(browser, "document.getElementById('told').textContent.includes('literal')", "is told")

    # Any trial is found by its id.
    identity = load(results)["id"].iloc[-1]
    browser.find_element(By.ID, "sought").send_keys(identity[:10])
    until(browser, "document.getElementById('found').tBodies[0].rows.length === 1", "one is found")
    assert identity in browser.find_element(By.ID, "found").text
    assert complaints(browser) == []


@needs_browser
def test_tables_are_sorted_and_copied(results: Path, browser: webdriver.Chrome) -> None:
    opened(browser, results / "report.html")

    def column(place: int) -> list[str]:
        return browser.execute_script(
            "return Array.from(document.querySelectorAll('#success tbody tr'),"
            f" (row) => row.cells[{place}].textContent)"
        )

    head = browser.find_element(By.CSS_SELECTOR, "#success th:nth-child(4) button")
    browser.execute_script("arguments[0].click()", head)
    upward = [int(text) for text in column(3)]
    assert upward == sorted(upward)
    assert len(set(upward)) > 1
    browser.execute_script("arguments[0].click()", head)
    assert [int(text) for text in column(3)] == sorted(upward, reverse=True)
    assert head.find_element(By.XPATH, "..").get_attribute("aria-sort") == "descending"

    browser.execute_script(
        "window.copied = null;"
        "Object.defineProperty(navigator, 'clipboard', {configurable: true, value:"
        " {writeText: async (text) => { window.copied = text; }}});"
        "document.querySelector('#success button[data-kind=\"csv\"]').click()"
    )
    until(browser, "window.copied", "the table is copied")
    csv = (results / "tables" / "success.csv").read_text(encoding="utf-8")
    assert browser.execute_script("return window.copied") == csv
    assert complaints(browser) == []


@needs_browser
def test_a_study_leads_from_its_points_to_their_trials(
    results: Path, browser: webdriver.Chrome, tmp_path: Path
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
    listed = _listed(rows, ["run-experiment", "x.yaml"])
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


@needs_browser
@pytest.mark.parametrize("width", [1400, 400])
def test_nothing_is_cut_off(
    results: Path, browser: webdriver.Chrome, width: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    opened(browser, results / "report.html", width)
    browser.execute_script("document.getElementById('pair').scrollIntoView()")
    until(browser, "!!document.querySelector('#space canvas')", "the pair is drawn")
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    time.sleep(1.0)  # the last frame, for the picture only
    shots = tmp_path_factory.getbasetemp() / "report_screenshots"
    shots.mkdir(exist_ok=True)
    assert browser.save_screenshot(str(shots / f"report_{width}.png"))
    assert complaints(browser) == []


@needs_browser
def test_the_page_is_read_without_scripts(results: Path, browser: webdriver.Chrome) -> None:
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        opened(browser, results / "report.html")
        text = browser.find_element(By.TAG_NAME, "body").text
        assert "Successes" in text
        assert "Stage at fault" in text
        assert "needs JavaScript" in text
        assert not browser.find_element(By.ID, "viewer").is_displayed()
        pictures = browser.find_elements(By.CSS_SELECTOR, ".card img, .picture img")
        assert len(pictures) > 5
    finally:
        browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
