"""What codes of a picture mean: the sRGB curve, embedded ICC profiles."""
