"""How dark a surface may be for its true albedo to say something."""

from __future__ import annotations

# True albedo below this is printed but enters no ratio and no leak, and gives no true shading: light bounced
# from other parts outweighs what such a surface reflects itself.
ALBEDO_FLOOR = 0.02
