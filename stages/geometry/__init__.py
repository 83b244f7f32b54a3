"""Rays, visibility, correspondences, lenses, surfaces: what only needs cameras, depths and meshes."""
