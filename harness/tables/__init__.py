"""What the rows say, as tables."""
