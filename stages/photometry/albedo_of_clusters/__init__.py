"""The albedo of clusters of the surface: coarse levels of all together, then each, in files."""
