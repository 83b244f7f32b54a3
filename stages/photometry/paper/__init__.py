"""The paper's own light and albedo: nine harmonics per view, alternating least squares (Eq. 1 to 18)."""
