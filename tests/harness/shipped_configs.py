"""The configs of the repository, as tests of the harness read them."""

from __future__ import annotations

from pathlib import Path

from harness.config.reading import read_mapping

CONFIGS = Path(__file__).parents[2] / "configs"
# Those that make trials: an `experiment:` of its own, as precision.yaml, is read by its own code.
OF_TRIALS = [
    file for file in sorted(CONFIGS.glob("*.yaml")) if "experiment" not in read_mapping(file)
]
