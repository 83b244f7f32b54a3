"""Two results side by side: pictures of the views that both have, what differs, and the page."""
