"""`python -m residual_mpc`, which is the command `residual-mpc`."""

from residual_mpc.cli.main import main

if __name__ == "__main__":
    main()
