"""Decomposition of many views in clusters: partition of the view graph, pinned values of other views."""
