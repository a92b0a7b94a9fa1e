"""What recordings can answer, before any training."""
