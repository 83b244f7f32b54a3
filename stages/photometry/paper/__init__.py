"""The paper's method: nine harmonics per view, alternating least squares (Eq. 1 to 18)."""
