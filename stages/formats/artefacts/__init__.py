"""What the stages leave for one another."""
