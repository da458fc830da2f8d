"""Parameters of the peers; the defaults are what their own examples use, lengths apart."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class RefineParams:
    """The local registration of small_gicp that ends a peer's work.

    kind: "none", "point_to_plane" (PLANE_ICP) or "gicp".
    voxel_mm: edge of the cells in which points are averaged before.
    reach_mm: farthest that two points count as the same.
    neighbours: points that a normal or a covariance is taken from.
    """

    kind: Literal["none", "point_to_plane", "gicp"] = "none"
    voxel_mm: float = 5.0
    reach_mm: float = 30.0
    neighbours: int = 20
    max_iterations: int = 100

    def __post_init__(self) -> None:
        _positive(voxel_mm=self.voxel_mm, reach_mm=self.reach_mm)
        if self.neighbours < 4 or self.max_iterations < 1:
            raise ValueError(
                f"neighbours is {self.neighbours} and max_iterations is {self.max_iterations}; "
                "expected at least 4 and 1"
            )


@dataclass(frozen=True)
class RansacParams:
    """FPFH features matched by RANSAC, as in Open3D's tutorial on global registration.

    voxel_mm: edge of the cells; normals take points within 2, features within 5 cells, and an
        inlier lies within 1.5.
    edge_similarity: least ratio of the lengths of matched edges.
    threads: of Open3D and small_gicp; with one, the same seed gives the same answer.
    """

    voxel_mm: float = 10.0
    edge_similarity: float = 0.9
    max_iterations: int = 100_000
    confidence: float = 0.999
    seed: int = 0
    threads: int = 1
    refine: RefineParams = field(default_factory=RefineParams)

    def __post_init__(self) -> None:
        _positive(voxel_mm=self.voxel_mm, threads=self.threads, max_iterations=self.max_iterations)
        for name in ("edge_similarity", "confidence"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected above 0, 1 at most")


@dataclass(frozen=True)
class FgrParams:
    """FPFH features matched by fast global registration (Q.-Y. Zhou et al., ECCV 2016).

    voxel_mm: edge of the cells; normals take points within 2, features within 5 cells, and an
        inlier lies within 0.5, as in Open3D's tutorial.
    """

    voxel_mm: float = 10.0
    seed: int = 0
    threads: int = 1
    refine: RefineParams = field(default_factory=RefineParams)

    def __post_init__(self) -> None:
        _positive(voxel_mm=self.voxel_mm, threads=self.threads)


@dataclass(frozen=True)
class KissMatcherParams:
    """KISS-Matcher (H. Lim et al., 2024).

    voxel_mm: edge of the cells; all else that the library derives from it keeps its default.
    clamp_noise_bounds: whether the bounds on the noise are cut to 1 unit, the library's default.
        It is meant for metres; in mm, 1 is less than the noise.
    threads: of small_gicp; KISS-Matcher itself takes every core that its process may use.
    """

    voxel_mm: float = 10.0
    clamp_noise_bounds: bool = False
    threads: int = 1
    refine: RefineParams = field(default_factory=RefineParams)

    def __post_init__(self) -> None:
        _positive(voxel_mm=self.voxel_mm, threads=self.threads)


@dataclass(frozen=True)
class IcpParams:
    """small_gicp from the identity, or from where another method ends.

    start: a name of METHODS, run with its defaults, or "identity".
    """

    start: str = "identity"
    threads: int = 1
    refine: RefineParams = field(default_factory=lambda: RefineParams(kind="gicp", reach_mm=100.0))

    def __post_init__(self) -> None:
        _positive(threads=self.threads)
        if self.refine.kind == "none":
            raise ValueError("refine.kind is 'none'; expected 'gicp' or 'point_to_plane'")
        if self.start == "icp":
            raise ValueError("start is 'icp'; expected 'identity' or another method")


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < value < float("inf"):
            raise ValueError(f"{name} is {value}; expected a number above 0")
