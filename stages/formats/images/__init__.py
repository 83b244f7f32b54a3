"""Photos, masks and float images: the door where light becomes linear."""
