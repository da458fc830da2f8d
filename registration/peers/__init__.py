"""Registrations of other libraries, to compare with: installed with the extra `peers`."""

from registration.peers.entries import PEERS, MissingPeerError, require

__all__ = ["PEERS", "MissingPeerError", "require"]
