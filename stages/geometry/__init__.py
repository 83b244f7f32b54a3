"""Rays, visibility, overlap, lenses, surfaces: what only needs cameras, depths and meshes."""
