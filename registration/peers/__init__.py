"""Registrations of other libraries, to compare with: installed with the extra `peers`."""

from registration.peers.entries import PEERS, MissingPeerError, check_installed, require

__all__ = ["PEERS", "MissingPeerError", "check_installed", "require"]
