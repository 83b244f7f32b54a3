"""How light, normals and albedo make an image, and what an image says of them."""
