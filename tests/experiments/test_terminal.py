from __future__ import annotations

import io

import pandas as pd
import pytest
from rich.console import Console

from experiments.terminal import SHOWN_ROWS, show_tables
from harness.table_files import Table


@pytest.mark.parametrize("in_full", [False, True])
def test_only_lists_are_cut_and_say_so(in_full: bool) -> None:
    names = [f"row{i:02d}" for i in range(SHOWN_ROWS + 2)]
    page = io.StringIO()
    table = Table("t", "Title", "Caption.", pd.DataFrame({"Name": names}), in_full=in_full)
    show_tables(Console(file=page, width=160), [table])
    shown = [name for name in names if name in page.getvalue()]
    assert shown == (names if in_full else names[:SHOWN_ROWS])
    cut = f"The first {SHOWN_ROWS} of {SHOWN_ROWS + 2}." in " ".join(page.getvalue().split())
    assert cut != in_full
