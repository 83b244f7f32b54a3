"""The smallest true albedo that measures are taken of."""

from __future__ import annotations

# True albedo below this is printed but enters no ratio and no leak, and gives no true shading: light bounced
# from other parts outweighs what such a surface reflects itself. It is part of the definition of the measures
# of `stages/evaluation`: figures are comparable only under one value. `render.albedo_floor` begins with it.
ALBEDO_FLOOR = 0.02
