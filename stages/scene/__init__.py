"""Cameras, views, colour, and the readers and writers of every file format."""
