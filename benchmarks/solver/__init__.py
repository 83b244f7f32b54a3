"""Energy against time of the decomposition's solvers: `python -m benchmarks.solver [--quick]`."""
