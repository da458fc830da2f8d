"""The processes, here or elsewhere, that perform trials."""
