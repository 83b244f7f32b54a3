"""Specular reflection, estimated from differences between views."""
