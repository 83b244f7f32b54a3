"""Plane sweep, fusion, rays, visibility, overlap: what only needs cameras, depths and meshes."""
