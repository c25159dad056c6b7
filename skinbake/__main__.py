"""`python -m skinbake`."""

from skinbake.cli import main

main()
