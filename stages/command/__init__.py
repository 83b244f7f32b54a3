"""What the command line understands, and what it asks the machinery for."""
