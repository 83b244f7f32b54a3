"""Photometry: the image model of light, normals and albedo, and its inversion."""
