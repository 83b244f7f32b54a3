"""A primal-dual scheme on the graph of pixels, coarse to fine, certified by its duality gap."""
