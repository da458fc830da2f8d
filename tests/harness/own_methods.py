"""Methods as a user would write them, for the tests of the runner."""

from __future__ import annotations

import os
from dataclasses import dataclass

from registration import RegistrationResult, Scan


@dataclass(frozen=True)
class GuessParams:
    reason: str = "did not try"


def give_up(target: Scan, source: Scan, params: GuessParams) -> RegistrationResult:
    return RegistrationResult(None, "failed", params.reason)


give_up.params_type = GuessParams  # type: ignore[attr-defined]  # how a function names its params


def note(target: Scan, source: Scan, params: dict[str, object]) -> RegistrationResult:
    return RegistrationResult(None, "failed", "did not try", notes=("a note", "and <another>"))


def crash(target: Scan, source: Scan, params: dict[str, object]) -> RegistrationResult:
    raise ZeroDivisionError("a bug\nwith a second line")


def die(target: Scan, source: Scan, params: dict[str, object]) -> RegistrationResult:
    os._exit(3)
