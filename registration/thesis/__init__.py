"""The registration of chapters 4 and 5 of the thesis, its equations corrected."""
