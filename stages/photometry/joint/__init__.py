"""The fast descent of Eq. 2: levels, the problem that the primal-dual solver takes in, when it is done."""
