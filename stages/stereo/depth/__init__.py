"""Depth maps by plane sweep and PatchMatch."""
