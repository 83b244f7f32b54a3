"""Solvers on pixel graphs: operators, reweighted least squares, conjugate gradients, a primal-dual scheme."""
