"""What surface mirrors, told by how views of it differ."""
