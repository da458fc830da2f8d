"""The rows of an experiment: `load` gives those of a results folder as one table."""

from harness.store.rows import Row, RunState, Store, StoreError, load

__all__ = ["Row", "RunState", "Store", "StoreError", "load"]
