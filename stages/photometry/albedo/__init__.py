"""The albedo under a known light: smooth where the light changes, with the photo's detail; its confidence."""
