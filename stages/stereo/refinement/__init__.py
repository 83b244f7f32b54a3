"""Refinement of a surface until the photos of neighbouring views agree on it."""
