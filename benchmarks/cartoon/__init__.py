"""The baseline of the paper's comparison: the cartoon of a single image."""
