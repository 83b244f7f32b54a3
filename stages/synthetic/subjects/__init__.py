"""What stands before the cameras: a bust, a relief, a courtyard, any mesh."""
