from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

from harness.provenance import code_fingerprint

METHOD = "own_package_of_tests.method:give_up"
PACKAGES = ("own_package_of_tests", "own_beside_of_tests")
FILES = {
    "own_package_of_tests/__init__.py": "",
    "own_package_of_tests/method.py": "import numpy\nfrom . import near\nfrom own_beside_of_tests "
    "import far\n\ndef give_up(*args):\n    return far.name\n",
    "own_package_of_tests/near.py": "def later():\n    from own_package_of_tests.inner "
    "import deep\n",
    "own_package_of_tests/inner/__init__.py": "",
    "own_package_of_tests/inner/deep.py": "from .. import method  # a circle\nname = 1\n",
    "own_package_of_tests/unused.py": "name = 2\n",
    "own_beside_of_tests/far.py": "name = 3\n",
}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    for name in [name for name in sys.modules if name.startswith(PACKAGES)]:
        monkeypatch.delitem(sys.modules, name)  # of another test's folder
    return tmp_path


@pytest.mark.parametrize("name", [name for name in FILES if "unused" not in name])
def test_own_methods_count_with_all_that_they_import(place: Path, name: str) -> None:
    before = code_fingerprint([METHOD])
    (place / name).write_text(FILES[name] + "# changed\n", encoding="utf-8")
    assert code_fingerprint([METHOD]) != before


def test_what_an_own_method_does_not_import_changes_nothing(place: Path) -> None:
    before = code_fingerprint([METHOD])
    (place / "own_package_of_tests" / "unused.py").write_text("name = 4\n", encoding="utf-8")
    assert code_fingerprint([METHOD]) == before
