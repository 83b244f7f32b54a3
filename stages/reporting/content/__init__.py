"""The report's content: pictures, figures and the surface, from the maps of all views."""
