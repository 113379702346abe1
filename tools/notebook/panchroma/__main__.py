"""Run the command line: `python -m panchroma` is `panchroma`."""

from .tools.cli import main

if __name__ == "__main__":
    main()
