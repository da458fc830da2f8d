"""Imported once by the fork server: all that a trial needs, so that workers start at once.

The kernels are loaded too, or the first trial of each worker would count that as its own time.
"""

from contextlib import suppress

from harness import execution  # noqa: F401  # imported to be at hand
from harness.provenance import remember_code
from harness.report import records  # noqa: F401
from registration import METHODS, register
from registration.peers import PEERS
from registration.warm import corner_scan

remember_code()
for name in METHODS.keys() - PEERS.keys():
    with suppress(Exception):  # a method that fails here shall do so in a trial, where it is noted
        register(corner_scan(), corner_scan(), method=name)
