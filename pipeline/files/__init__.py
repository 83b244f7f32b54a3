"""Files: their kinds, atomic replacement, the workspace's boundary, JSON and YAML."""
