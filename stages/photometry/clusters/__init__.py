"""Decomposition of many pixels in clusters: parts of the surface, with a margin around each."""
