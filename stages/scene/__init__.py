"""Cameras, the upright frame, data sets and messages: independent of file formats."""
