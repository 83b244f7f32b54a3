"""Foundations of the compiled loops: SIMD lanes, sliced sparse rows, threads, memory."""
