"""Cameras as other programs write them: NeRF, Bundler, Meshroom, Metashape, plain matrices."""
