"""Solid textures: brightness and colour at points of space, before a contrast and a paint are chosen."""
