"""Operators on masked pixels, reweighted least squares, conjugate gradients: nothing here knows of light."""
