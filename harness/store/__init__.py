"""The rows of an experiment: `load` gives those of a results folder as one table."""

from harness.store.file import FILE_NAME, StoreError
from harness.store.row import Row, RowStatus
from harness.store.rows import RunState, Store, load

__all__ = ["FILE_NAME", "Row", "RowStatus", "RunState", "Store", "StoreError", "load"]
