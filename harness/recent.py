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
    latest: dict[str, tuple[tuple[Any, ...], Any]] = field(default_factory=dict)

    def get(self, key: str, make: Callable[[], T]) -> T:
        """The kept result of this key, or a new one."""
        if key not in self.entries:
            self.entries[key] = make()
            if len(self.entries) > self.size:
                self.entries.popitem(last=False)
        self.entries.move_to_end(key)
        kept: T = self.entries[key]
        return kept

    def same(self, name: str, parts: tuple[Any, ...], make: Callable[[], T]) -> T:
        """What was last made under a name, where it was made of the very same objects.

        It spares the key of what hardly ever changes from one time to the next.
        """
        before, made = self.latest.get(name, ((), None))
        if len(before) != len(parts) or any(a is not b for a, b in zip(before, parts, strict=True)):
            made = make()
            self.latest[name] = parts, made
        kept: T = made
        return kept
