from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from registration import METHODS, RegistrationResult, Scan, register
from registration.methods import UnknownMethodError, find_method
from registration.warm import corner_scan


@dataclass(frozen=True)
class OwnParams:
    excuse: str = "not today"


def own_method(target: Scan, source: Scan, params: OwnParams) -> RegistrationResult:
    return RegistrationResult(None, "failed", params.excuse)


own_method.params_type = OwnParams


def no_result(target: Scan, source: Scan, params: dict) -> str:
    return "ok"


SCAN = Scan.from_points([[[0.0, 0.0, 500.0]]], step_mm=5.0)


def test_a_function_of_ones_own_needs_no_edit() -> None:
    name = f"{__name__}:own_method"
    assert find_method(name).params_type is OwnParams
    assert register(SCAN, SCAN, name).reason == "not today"
    assert register(SCAN, SCAN, name, OwnParams("busy")).reason == "busy"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("thesiss", "unknown method 'thesiss'; known are .*thesis"),
        ("no_such_package:f", "'no_such_package:f' cannot be loaded: No module named"),
        (f"{__name__}:gone", f"'{__name__}:gone' cannot be loaded"),
        (":f", "':f' cannot be loaded: Empty module name"),
        ("broken_method:f", "'broken_method:f' cannot be loaded: .* was never closed"),
        (".a:b", "'.a:b' cannot be loaded"),
        (f"{__name__}:SCAN", f"'{__name__}:SCAN' is of type Scan; expected a function"),
    ],
)
def test_an_unknown_method_is_named_with_what_would_have_worked(
    name: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_method.py").write_text("def f(\n = 1", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UnknownMethodError, match=message):
        register(SCAN, SCAN, name)


def test_what_a_function_of_ones_own_returns_is_asked_for() -> None:
    with pytest.raises(TypeError, match=r":no_result' returned str; expected RegistrationResult"):
        register(SCAN, SCAN, f"{__name__}:no_result")


@pytest.mark.parametrize("name", METHODS)
def test_every_method_has_parameters_with_defaults(name: str) -> None:
    method = find_method(name)
    assert method is METHODS[name]
    assert isinstance(method.params_type(), method.params_type)


def test_what_warms_the_kernels_up_goes_through_every_stage_of_the_thesis() -> None:
    result = register(corner_scan(), corner_scan(), "thesis")
    assert result.status == "ok"


def test_arrays_that_are_no_scans_are_named() -> None:
    scan = Scan.from_points(np.full((5, 8, 3), np.nan), step_mm=5.0)
    with pytest.raises(TypeError, match="source is of type ndarray; expected Scan"):
        register(scan, scan.points_mm)


def test_parameters_of_another_type_are_named() -> None:
    scan = Scan.from_points(np.full((5, 8, 3), np.nan), step_mm=5.0)
    with pytest.raises(TypeError, match="of type dict; expected GaussSphereParams of registration"):
        register(scan, scan, params={"calibration": ""})
