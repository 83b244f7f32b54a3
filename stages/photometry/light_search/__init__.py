"""Estimation of light from all directions, by pairs of pixels that are likely to have equal albedo."""
