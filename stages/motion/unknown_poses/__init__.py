"""Structure from motion, step by step: photos, features, pairs, placement."""
