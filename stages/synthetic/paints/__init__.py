"""Albedo at surface points: parts, stripes, textures like the world's."""
