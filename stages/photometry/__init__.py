"""How light, normals and albedo make an image: harmonics, the energy, its alternating minimisation."""
