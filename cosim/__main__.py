"""`python -m cosim`: the program `cosim`."""

from cosim.interrupts import exit_on_request

exit_on_request()  # before the imports below, which take the longer

from cosim.cli import main  # noqa: E402

if __name__ == "__main__":
    main()
