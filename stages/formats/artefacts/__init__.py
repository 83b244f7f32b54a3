"""Files that stages write for one another."""
