"""The craft."""
