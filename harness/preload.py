"""Imported once by the fork server: all that a worker needs, so that workers start at once."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot

import harness.clouds
import harness.execution
import harness.figures
