"""How well a textured model shows what its views show; steps at the borders of its charts."""
