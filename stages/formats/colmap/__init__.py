"""COLMAP's models and dense workspaces."""
