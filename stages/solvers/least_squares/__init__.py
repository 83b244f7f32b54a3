"""Operators on masked pixels, reweighted least squares, conjugate gradients."""
