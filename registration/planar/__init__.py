"""Registration of single profiles in their common laser plane (section 4.2)."""
