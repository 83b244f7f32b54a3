"""The paper's experiments on our bust: `python -m benchmarks.paper [--quick]`."""
