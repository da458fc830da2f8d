"""A scan as the fan of beams that measured it, its noise, and what to leave out."""
