"""The light of all views, found before the albedo, and the gains of the views."""
