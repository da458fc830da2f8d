"""Prints the kernels that set-up does not compile, and how many it does; run by test_warm.

With NUMBA_DISABLE_JIT=1, as plain Python, where each kernel tells that it was called. numba
compiles those that a compiled one names with it, whether they are called or not.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
import runpy
import sys
from collections.abc import Callable

import registration
from registration import kernels

Name = tuple[str, str]  # of the function, and of its module
made: dict[Name, Callable] = {}
called: set[Name] = set()


def telling(function: Callable) -> Callable:
    name = function.__name__, function.__module__
    made[name] = function

    @functools.wraps(function)
    def kernel(*args: object) -> object:
        called.add(name)
        return function(*args)

    return kernel


def with_named(names: set[Name]) -> set[Name]:
    """These kernels, those that they name, and so on."""
    more = set(names)
    for function in map(made.__getitem__, names):
        # As it is known there: kernels of two modules may have the same name.
        there = [function.__globals__.get(word) for word in function.__code__.co_names]
        known = ((getattr(it, "__name__", ""), getattr(it, "__module__", "")) for it in there)
        more |= made.keys() & set(known)
    return names if more == names else with_named(more)


if __name__ == "__main__":
    vars(kernels).update(compiled=telling, inlined=telling)
    for module in [name for name in sys.modules if name.startswith("registration.")]:
        if module != kernels.__name__:
            del sys.modules[module]
    for found in pkgutil.walk_packages(registration.__path__, "registration."):
        if ".peers" not in found.name and found.name != kernels.__name__:
            importlib.import_module(found.name)
    runpy.run_path(sys.modules["registration.warm"].__file__ or "", run_name="__main__")
    compiled = with_named(called)
    print(*sorted(f"{module}.{function}" for function, module in made.keys() - compiled))
    print(len(compiled))
