"""Solvers of factor graphs on one interface; `registry` lists them."""
