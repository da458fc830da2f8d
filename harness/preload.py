"""Imported once by the fork server: all that a worker needs, so that workers start at once.

The kernels are loaded too, or the first trial of each worker would count that as its own time.
"""

from contextlib import suppress

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot

import harness.clouds
import harness.execution
import harness.figures
from registration import METHODS, register
from registration.warm import corner_scan

for name in METHODS:
    with suppress(Exception):  # a method that fails here shall do so in a trial, where it is noted
        register(corner_scan(), corner_scan(), method=name)
