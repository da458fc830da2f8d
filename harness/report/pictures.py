"""The figures of a run inside the page, within a budget of bytes."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from harness.report.markup import details, escaped

# What each figure of a pair shows, and the figures of the thesis that show the same.
SUBJECTS = {
    "measurements": ("Raw measurements", "6.4, 6.12 to 6.14, 6.24 to 6.26"),
    "filtering": ("Filtering", "5.2"),
    "segments": ("Line segments", "5.3"),
    "patches": ("Patches", "6.5, 6.6, 6.15 to 6.17, 6.27 to 6.29"),
    "gauss_spheres": ("Modified Gauss spheres", "6.7, 6.18 to 6.20"),
    "shifts": ("Occurrence of shifts", "6.8"),
    "superposition": ("Superposition", "6.9, 6.21, 6.22"),
    "superposed": ("All views superposed", "6.23, 6.30"),
    "arm": ("The arm before the scene", "3.1, 6.10, 6.11"),
}
OF_A_PAIR = re.compile(r"(?P<slug>.+)_\d_(?P<kind>[a-z_]+)$")


class Picture(NamedTuple):
    """An image as it goes into the page."""

    file: Path
    kind: str
    data: bytes


def load_pictures(files: Sequence[Path], budget_bytes: int) -> list[Picture]:
    """The pictures, as they are where they fit, else as WebP, else smaller until they do."""
    pictures = [Picture(file, "png", file.read_bytes()) for file in files]
    for quality, share in ((80, 1.0), (60, 0.75), (40, 0.5)):
        if sum(len(picture.data) for picture in pictures) <= budget_bytes:
            break
        pictures = [Picture(file, "webp", _as_webp(file, quality, share)) for file in files]
    return pictures


def _as_webp(file: Path, quality: int, share: float) -> bytes:
    with Image.open(file) as image:
        page = image.convert("RGB")
        if share < 1.0:
            page = page.resize((round(share * page.width), round(share * page.height)))
        data = io.BytesIO()
        page.save(data, format="WEBP", quality=quality, method=2)
        return data.getvalue()


def pictures_markup(pictures: Sequence[Picture]) -> str:
    """All pictures, those of one pair and method together."""
    groups: dict[str, list[Picture]] = {}
    for picture in pictures:
        found = OF_A_PAIR.match(picture.file.stem)
        groups.setdefault(found["slug"] if found else "", []).append(picture)
    parts = []
    whole = groups.pop("", [])
    if whole:
        parts.append("".join(picture_markup(picture) for picture in whole))
    for place, (slug, group) in enumerate(groups.items()):
        heading = f"{slug.replace('_', ' ', 1).replace('_', ' ')}: {len(group)} figures"
        inside = "".join(picture_markup(picture) for picture in group)
        parts.append(details(heading, inside, opened=place == 0 and not whole))
    return "\n".join(parts)


def picture_markup(picture: Picture, identity: str = "") -> str:
    """One picture with what it shows; its text stands in the picture itself."""
    caption = _caption(picture.file.stem)
    mark = f' id="{escaped(identity)}"' if identity else ""
    source = f"data:image/{picture.kind};base64,{base64.b64encode(picture.data).decode('ascii')}"
    with Image.open(io.BytesIO(picture.data)) as image:
        size = f'width="{image.width}" height="{image.height}"'  # its place is kept until it loads
    return (
        f'<figure class="picture"{mark}><img loading="lazy" {size} alt="{escaped(caption)}" '
        f'src="{source}"><figcaption>{escaped(caption)} <span class="file">'
        f"{escaped(picture.file.name)}</span></figcaption></figure>"
    )


def _caption(stem: str) -> str:
    numbered = re.match(r"figure_(\d+)[._](\d+)", stem)
    if numbered:
        return f"Figure {numbered[1]}.{int(numbered[2])} of the thesis, as measured here."
    found = OF_A_PAIR.match(stem)
    kind = found["kind"] if found else stem.rpartition("_")[2]
    if kind not in SUBJECTS:
        return stem.replace("_", " ").capitalize() + "."
    subject, numbers = SUBJECTS[kind]
    return f"{subject}, as figures {numbers} of the thesis."
