"""Sequences whose entries are made when they are asked for, so that a million take no memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar, overload

T = TypeVar("T", covariant=True)


class Lazy(Sequence[T], Generic[T]):
    """So many entries, each made by its index; made anew each time it is asked for."""

    def __init__(self, length: int, make: Callable[[int], T]) -> None:
        self._length, self._make = length, make

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[T]:
        return map(self._make, range(self._length))

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[T]: ...
    def __getitem__(self, index: int | slice) -> T | Sequence[T]:
        chosen = range(self._length)[index]
        if isinstance(chosen, int):
            return self._make(chosen)
        make = self._make
        return Lazy(len(chosen), lambda place: make(chosen[place]))
