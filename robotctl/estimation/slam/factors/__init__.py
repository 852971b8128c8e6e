"""The kinds of factors; `registry` lists them."""
