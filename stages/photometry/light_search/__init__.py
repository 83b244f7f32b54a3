"""The search for light from all directions, by pairs of pixels that are likely to be of like albedo."""
