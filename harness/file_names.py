"""How names of a config become parts of file names."""

from __future__ import annotations


def file_slug(name: str) -> str:
    """A name as part of a file name: anything but letters, digits, dot and dash as underscore."""
    kept = (c if c.isascii() and (c.isalnum() or c in ".-") else "_" for c in name)
    return "_".join(part for part in "".join(kept).split("_") if part)
