"""Methods that a config chooses, and those that cannot run here."""

from __future__ import annotations

from typing import Any

import pytest
from shipped_configs import CONFIGS

from harness.config import choices
from harness.config.errors import ConfigError
from harness.config.reading import load_experiment
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
