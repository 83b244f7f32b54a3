"""Real objects with measured reflectance, ten photos from one place, each under a lamp of its own."""
