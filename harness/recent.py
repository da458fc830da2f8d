"""Results that were costly to make, kept as long as they are in use."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

T = TypeVar("T")


@dataclass
class Recent:
    """The last few results of costly steps, by key; of one process, as scans are large."""

    size: int
    entries: OrderedDict[str, Any] = field(default_factory=OrderedDict)

    def get(self, key: str, make: Callable[[], T]) -> T:
        """The kept result of this key, or a new one."""
        if key not in self.entries:
            self.entries[key] = make()
            if len(self.entries) > self.size:
                self.entries.popitem(last=False)
        self.entries.move_to_end(key)
        kept: T = self.entries[key]
        return kept
