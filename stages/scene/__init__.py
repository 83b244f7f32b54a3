"""Cameras, directions, data sets, words: what needs no file format."""
