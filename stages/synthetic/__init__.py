"""Scenes whose truth is known: our own subjects or any mesh, their paint, their light; sensor noise apart."""
