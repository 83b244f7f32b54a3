"""Absolute scale and white balance of the albedo, from cards and charts in photos."""
