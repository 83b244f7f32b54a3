"""Textures of a mesh from maps of its views: charts, texels, what views show of them, what none shows."""
