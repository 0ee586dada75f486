"""`python -m rangeeval` is the command line."""

from rangeeval.cli import main

main()
