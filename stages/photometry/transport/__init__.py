"""What surface points see of the light, past what stands in its way and by way of other surface."""
