"""Scenes whose truth is known: a procedural bust, its paint, its light; sensor noise apart."""
