"""The `robotctl` command.

Public names:

- `main.main`, `commands.COMMANDS`: the program and its subcommands
"""
