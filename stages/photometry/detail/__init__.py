"""The albedo's detail: octaves of the residual, noise, and the shading's uncertainty in a Wiener filter."""
