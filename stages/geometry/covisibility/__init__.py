"""Which views, and which of their pixels, show the same surface."""
