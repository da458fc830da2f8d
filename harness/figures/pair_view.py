"""One registered pair as the figures and the clouds need it: the data, the answer and the truth."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.spatial.transform import RigidTransform

from harness.file_names import file_slug
from registration.result import RegistrationResult
from registration.scan import Scan


@dataclass(frozen=True)
class PairView:
    """A pair of scans, what a method made of them, and the exact pose to draw beside it.

    pair: the pair's name in the config, "6.4" for table 6.4 of the thesis.
    target_view, source_view: names of the views in the config.
    method: the method's label in the config.
    T_target_source_exact: from the viewing paths, mm; never seen by the method.
    overlap: exact share of the source's points that the target view sees too.
    """

    pair: str
    scene: str
    target_view: str
    source_view: str
    method: str
    repeat: int
    target: Scan
    source: Scan
    T_target_source_exact: RigidTransform
    overlap: float
    result: RegistrationResult

    @property
    def slug(self) -> str:
        """The pair and the method as the first part of a file name."""
        return file_slug(f"{self.pair}_{self.method}")
