"""Evaluation of albedo: against known truth, between views, against the photos."""
