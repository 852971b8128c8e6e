"""Inner loops in machine code, for any package that marks them with `@compiled`.

Each package has a cache of its own, and a library that is built from it ahead of time.
"""
