"""Suns and lamps: small sources of light, whose shadows have sharp edges."""
