"""Sparse symmetric equations: order of elimination, Cholesky factor, covariances."""
