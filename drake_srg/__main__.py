"""The command `drake-srg`, also as `python -m drake_srg`."""

import sys


def main() -> int:
    """Run the command, and return its exit code."""
    try:  # imports take half a second, in which Ctrl-C must not print a traceback
        from drake_srg.cli.main import main as run
    except KeyboardInterrupt:
        print("drake-srg: stopped", file=sys.stderr)
        return 130
    return run()


if __name__ == "__main__":
    sys.exit(main())
