"""Structure from motion: what COLMAP is told about the photos, and how its mappers are asked."""
