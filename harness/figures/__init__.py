"""What pairs and experiments look like."""
