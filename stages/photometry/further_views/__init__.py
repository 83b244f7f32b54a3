"""Light and data of views that the light was not estimated from."""
