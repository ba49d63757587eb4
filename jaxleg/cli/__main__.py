"""`python -m jaxleg.cli`."""

from jaxleg.cli import main

main()
