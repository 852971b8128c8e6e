"""`python -m robotctl`."""

from robotctl.cli.main import main

if __name__ == "__main__":
    main()
