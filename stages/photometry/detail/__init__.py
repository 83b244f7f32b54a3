"""What of the photo's fine detail is albedo: octaves, noise, and what the shading may be wrong by."""
