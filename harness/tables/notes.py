"""What methods note of their answers, as tables show it beside the reasons."""

from __future__ import annotations

import pandas as pd


def with_notes(frame: pd.DataFrame, rows: pd.DataFrame) -> pd.DataFrame:
    """A table with a line for each of the rows, and their notes at its end where there are any.

    rows: as store.load gives them.
    """
    if not len(rows) or (rows["notes"] == "").all():
        return frame
    return frame.assign(Notes=rows["notes"].str.replace("\n", "; ").to_numpy())
