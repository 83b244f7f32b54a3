"""Outlines of a surface in the views: what lies beside them."""
