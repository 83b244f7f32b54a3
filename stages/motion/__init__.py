"""Structure from motion by COLMAP: its database, features, matches and mappers."""
