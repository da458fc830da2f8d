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
    words = {word for name in names for word in made[name].__code__.co_names}
    more = names | {name for name in made if name[0] in words}
    return names if more == names else with_named(more)


if __name__ == "__main__":
    kernels.compiled = kernels.inlined = telling  # type: ignore[assignment]
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
