"""Smaller meshes in place of large ones."""
