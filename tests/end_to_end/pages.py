"""What tests of the page share: a config with markup in its names, and a page in a real browser."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.support.ui import WebDriverWait

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
