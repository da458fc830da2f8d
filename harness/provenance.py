"""Which code and which machine computed a result."""

from __future__ import annotations

import ast
import datetime
import hashlib
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable
from importlib import metadata, util
from pathlib import Path
from typing import Any, NamedTuple

from registration.peers import PEERS

ROOT = Path(__file__).resolve().parent.parent

# What a row's numbers depend on, beside the code: a new version computes the rows again.
LIBRARIES = ("mujoco", "numba", "numpy", "scipy")
CODE = ("registration", "scenes", "sensors")
CODE_OF_TRIALS = (
    "config/choices", "execution", "scoring/bound", "scoring/common_points", "scoring/diagnosis",
    "scoring/poses", "trials/random_pairs", "trials/specs", "trials/views",
)  # fmt: skip


_loaded: dict[Path, str] = {}  # digests of files as they were when this process imported them


class Sources(NamedTuple):
    """What a run's code is made of beside the project's own: see code_fingerprint."""

    methods: tuple[str, ...]
    data: tuple[str, ...]


def remember_code() -> None:
    """Note the code as it is now: a process that has imported it stays so when files change."""
    _loaded.update((path, _digest(path)) for path in _own_files())


def code_fingerprint(methods: Iterable[str], data: Iterable[Path | str] = ()) -> str:
    """A hash of the code that computes rows: rows of other code are computed again, not reused.

    methods: names as in the config; a function of the user's own counts with its module's file and
        those that it imports from the same place, a peer with the versions of its libraries.
    data: files that the methods read, as a calibration.
    """
    libraries = list(LIBRARIES)
    files = _own_files()
    files += [Path(file) for file in data]
    for name in methods:
        if name in PEERS:
            libraries += ["small_gicp", *PEERS[name].needs]
        module, colon, _ = name.partition(":")
        files += _with_imports(module) if colon else []
    digest = hashlib.sha256()
    for name in sorted(set(libraries)):
        digest.update(f"{name} {metadata.version(name)}\n".encode())
    for path in sorted(set(files)):
        digest.update(f"{path.name} {_loaded.get(path) or _digest(path)}\n".encode())
    return digest.hexdigest()[:16]


def _own_files() -> list[Path]:
    files = [path for folder in CODE for path in (ROOT / folder).rglob("*.py")]
    return files + [ROOT / "harness" / f"{name}.py" for name in CODE_OF_TRIALS]


def _with_imports(module: str) -> list[Path]:
    """The file of a user's module and of all that it imports, however far, from the same place.

    The place is the folder that its top package or module is found in; nothing is run but what
    finds a module, which imports the packages it lies in.
    """
    place = _found(module.partition(".")[0])
    first = _found(module)
    if place is None or first is None:
        return []
    root = place.parent.parent if place.name == "__init__.py" else place.parent
    files: dict[Path, None] = {}
    waiting = [module]
    known = set(waiting)
    while waiting:
        name = waiting.pop()
        file = _found(name)
        if file is None or not file.is_relative_to(root) or "site-packages" in file.parts:
            continue
        files[file] = None
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        named = _imported(file, package) | {name.rpartition(".")[0]}  # its package runs before it
        waiting += sorted(named - known - {""})
        known |= named
    return list(files)


def _imported(file: Path, package: str) -> set[str]:
    """Names that a file's import statements may mean, modules or not, wherever they stand."""
    names: set[str] = set()
    try:
        tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError):
        return names
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                try:
                    base = util.resolve_name("." * node.level + base, package)
                except ImportError:
                    continue
            names |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return names


def _found(module: str) -> Path | None:
    """The file of a module in Python, or None."""
    try:
        spec = util.find_spec(module)
    except (ImportError, AttributeError, ValueError):
        return None
    found = spec is not None and spec.origin is not None and spec.origin.endswith(".py")
    return Path(spec.origin) if found and spec is not None and spec.origin else None


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def note_run(folder: Path, code: str) -> None:
    """Write what computes results beside them, as run.json."""
    facts = json.dumps(run_facts(code), indent=2)
    (folder / "run.json").write_text(facts + "\n", encoding="utf-8")


def run_facts(code: str) -> dict[str, Any]:
    """What to note beside results: time, versions, commit, machine."""
    return {
        "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "code": code,
        "commit": _commit(),
        "python": sys.version.split()[0],
        "libraries": {name: metadata.version(name) for name in (*LIBRARIES, "pandas", "trimesh")},
        "machine": {
            "system": platform.platform(),
            "processor": _processor(),
            "cores": os.process_cpu_count() if hasattr(os, "process_cpu_count") else os.cpu_count(),
        },
    }


def _commit() -> str | None:
    """The commit of the working tree, "-dirty" when files differ from it, None outside of git."""
    command = [
        "git",
        "-C",
        str(ROOT),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=40",
        "--exclude=*",
    ]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())
