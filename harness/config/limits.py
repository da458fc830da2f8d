"""What a trial may take before it is given up."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from harness.config.strict import Strict


class Limits(Strict):
    """None is no limit; the numbers of the trials that end in time do not depend on them.

    trial_s: seconds a trial may take, its figures apart.
    worker_mb: memory a worker process may take on top of what it starts with.
    """

    trial_s: Annotated[float | None, Field(gt=0.0)] = None
    worker_mb: Annotated[int | None, Field(ge=1)] = None


NO_LIMITS = Limits()
