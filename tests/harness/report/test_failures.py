"""The failures of a run, and the stage that is at fault."""

from __future__ import annotations

import pandas as pd

from harness.report.failures import failures_table


def test_the_stage_at_fault_is_that_of_the_own_point_of_a_sweep() -> None:
    rows = pd.DataFrame(
        [
            {
                "id": f"{given}{point}", "pair": "p", "method": "m", "given": given, "repeat": 0,
                "status": "ok", "stage": "", "reason": "", "notes": "",
                "rotation_error_deg": error, "translation_error_mm": error,
                "sweep.point": point, "sweep.varied": "", "sweep.scan.step_mm": 4.0 + point,
            }
            for point in range(2)
            for given, error in (("", 40.0), ("rotation", 1.0 if point == 0 else 40.0))
        ]
    )  # fmt: skip
    faults = failures_table(rows).frame.set_index("Trial")["Stage at fault"]
    assert faults["0"] == "rotation"
    assert faults["1"] == "more than one stage"
