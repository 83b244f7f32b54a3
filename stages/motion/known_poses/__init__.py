"""Views whose cameras are known: points between them."""
