"""The albedo under a known light: the smooth one, the photo's detail, and how well it is known."""
