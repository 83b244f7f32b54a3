"""Illumination of all views, estimated before the albedo, and the gains of the views."""
