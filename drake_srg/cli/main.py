"""The command `drake-srg`."""

import os
import sys
from collections.abc import Sequence

from drake_srg.cli.output import Output
from drake_srg.cli.parser import CommandParser, make_parser
from drake_srg.cli.process import BAD_INPUT, SUCCESS
from drake_srg.common.exceptions import ScenarioError
from drake_srg.common.installing import advised


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    Args:
        arguments: The command line without the program's name; None: sys.argv's.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    CommandParser.json = "--json" in arguments
    options = make_parser().parse_args(arguments)
    output = Output(options.json, options.quiet, options.command)
    options.console = output
    try:
        code: int = options.run(options)
        sys.stdout.flush()  # here, where a broken pipe is handled, not at exit
    except ScenarioError as error:
        output.complain(str(error))
        return BAD_INPUT
    except ImportError as error:
        output.complain(advised(str(error)))
        return BAD_INPUT
    except KeyboardInterrupt:
        output.complain("stopped")
        return BAD_INPUT
    except BrokenPipeError:  # `| head` has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return SUCCESS
    return code
