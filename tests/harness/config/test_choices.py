"""Methods that a config chooses, and those that cannot run here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from shipped_configs import CONFIGS

from harness.config import choices
from harness.config.errors import ConfigError
from harness.config.reading import load_experiment
from harness.config.schema import MethodChoice
from harness.recent import Recent
from registration.peers import MissingPeerError


def test_optional_methods_are_left_out_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str, _: Any) -> None:
        raise MissingPeerError(f"{name} is not installed")

    monkeypatch.setattr(choices, "check_installed", missing)
    methods = load_experiment(CONFIGS / "leaderboard.yaml").methods
    kept, reasons = choices.installed_methods(methods, CONFIGS / "leaderboard.yaml")
    assert {method.name for method in kept} == {"gauss_sphere", "thesis"}
    assert len(kept) + len(reasons) == len(methods)
    assert "RANSAC is left out: open3d_ransac is not installed" in reasons
    needed = tuple(method.model_copy(update={"optional": False}) for method in methods)
    with pytest.raises(ConfigError, match="open3d_ransac is not installed"):
        choices.chosen_methods(needed, CONFIGS / "leaderboard.yaml", Recent(20))


def test_a_method_of_ones_own_that_does_not_load_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lacking.py").write_text("import nosuch\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match=r"methods\.0\.name: .*No module named 'nosuch'"):
        choices.chosen_method(
            MethodChoice(name="lacking:method"), ("methods", 0), tmp_path / "a.yaml"
        )


def test_a_file_that_is_no_calibration_is_told_when_the_config_is_checked(tmp_path: Path) -> None:
    (tmp_path / "c.json").write_text("{}", encoding="utf-8")
    choice = MethodChoice(name="gauss_sphere", params={"calibration": "c.json"})
    with pytest.raises(ConfigError, match=r"methods\.0\.params\.calibration: .*c\.json: .*"):
        choices.chosen_method(choice, ("methods", 0), tmp_path / "a.yaml")
