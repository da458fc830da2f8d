"""The rows of a results folder as one file for other programs."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import pandas as pd

from harness.store.file import StoreError
from harness.store.rows import load

ENDINGS = (".parquet", ".csv")


def export_rows(folder: Path, file: Path, identities: Collection[str]) -> tuple[int, int]:
    """Write the rows of these trials as store.load gives them, to .parquet or .csv.

    Units are in the names of the columns. The matrices are left out: poses are there as their six
    parameters. Returns how many rows there are, and how many different trials have none.
    Raises StoreError, also where no trial has a row.
    """
    if file.suffix not in ENDINGS:
        raise StoreError(f"{file} should end in {' or '.join(ENDINGS)}")
    rows = load(folder, arrays=False)
    rows = rows[rows["id"].isin(identities)]
    if rows.empty:
        raise StoreError(f"{folder} has no row of this configuration; run it first")
    try:
        if file.suffix == ".csv":
            rows.to_csv(file, index=False, lineterminator="\n")
        else:
            _plain(rows).to_parquet(file, index=False)
    except OSError as error:
        raise StoreError(f"{file} cannot be written ({error.strerror or error})") from None
    return len(rows), len(set(identities)) - rows["id"].nunique()


def _plain(rows: pd.DataFrame) -> pd.DataFrame:
    """The rows with every column of one type, which Parquet wants: mixed ones as text."""
    mixed = [
        name
        for name in rows.columns
        if rows[name].dtype == object and rows[name].map(type).nunique() > 1
    ]
    return rows.astype(dict.fromkeys(mixed, str))
