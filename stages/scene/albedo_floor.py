"""The smallest true albedo that enters measures."""

from __future__ import annotations

# True albedo below this is printed but enters no ratio and no leak, and gives no true shading: there,
# interreflection from other parts exceeds the light that the surface reflects. The value is part of the
# definition of the measures of `stages/evaluation`: figures are comparable only under one value. It is the
# default of `render.albedo_floor`.
ALBEDO_FLOOR = 0.02
