"""How albedo is judged: against a known truth, between views, against the photos."""
