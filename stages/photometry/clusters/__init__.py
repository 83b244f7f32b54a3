"""Decomposition of many views in clusters: partition of the view graph, halos of corresponding pixels."""
