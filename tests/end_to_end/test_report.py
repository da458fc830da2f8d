"""The page that ends every run: built by the command, the same again, whole in a real browser."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from pages import CONFIG, complaints, needs_browser, opened, until
from selenium import webdriver
from selenium.webdriver.common.by import By

from experiments.cli import main
from harness.report.page import LARGEST_BYTES
from harness.store import load


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


def drawn(browser: webdriver.Chrome) -> list[int]:
    """How many points or corners each trace in the space has."""
    return browser.execute_script(
        "return (document.getElementById('space').data || []).map((t) => t.x.length)"
    )


@needs_browser
def test_a_reader_uses_the_page(results: Path, browser: webdriver.Chrome) -> None:
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
