"""Meshes and point clouds on disk, read whole or refused."""
