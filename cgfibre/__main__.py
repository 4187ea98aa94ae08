"""``python -m cgfibre``."""

from cgfibre.cli import main

main()
