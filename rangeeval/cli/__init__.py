"""The command line: options in, one library call, exit status. Nothing here that a Python user would miss.

`COMMANDS` lists the commands, each in a module of its own. Heavy packages are imported by the command that needs them,
so that `--help` answers at once.
"""

from __future__ import annotations

import os
import sys

import click

from rangeeval import __version__
from rangeeval.cli.lazy import LazyGroup
from rangeeval.errors import RangeevalError, one_line

COMMANDS: dict[str, str] = {
    "report": "rangeeval.cli.report:report",
    "inspect": "rangeeval.cli.inspect:inspect",
    "ingest": "rangeeval.cli.archive:ingest",
    "verify": "rangeeval.cli.archive:verify",
    "accuracy": "rangeeval.cli.accuracy:accuracy",
    "attitude": "rangeeval.cli.attitude:attitude",
    "rcs": "rangeeval.cli.rcs:rcs",
    "bearing": "rangeeval.cli.bearing:bearing",
    "replay": "rangeeval.cli.replay:replay",
    "truth": "rangeeval.cli.truth:truth",
    "check": "rangeeval.cli.check:check",
    "compare": "rangeeval.cli.compare:compare",
    "evaluate": "rangeeval.cli.evaluate:evaluate",
    "catalog": "rangeeval.cli.catalog:catalog",
    "simulate": "rangeeval.cli.simulate:simulate",
}


@click.group(
    cls=LazyGroup, table=COMMANDS, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(__version__, prog_name="rangeeval")
def cli() -> None:
    """Post-trial analysis of radar test-range logs: how accurate the radar was, bin by bin, and how sure that is.

    TRIAL is a folder of log files (with or without a trial.toml), single log files, or an archive. Logs are
    recognised by their content. `rangeeval report TRIAL -o DIR` does the whole job.
    """


def main() -> None:
    """The entry point: one clear line and exit status 1 for whatever the input or the machine made impossible."""
    try:
        cli(standalone_mode=True)
    except RangeevalError as error:
        _fail(str(error))
    except BrokenPipeError:  # the reader (`| head`) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        _fail(f"{error.filename or 'file'}: {error.strerror or error}")
    except MemoryError:
        _fail("not enough memory")
    except Exception as error:
        if os.environ.get("RANGEEVAL_DEBUG"):
            raise
        _fail(f"internal error, please report it: {type(error).__name__}: {error} (RANGEEVAL_DEBUG=1 shows where)")


def _fail(line: str) -> None:
    click.echo(f"rangeeval: {one_line(line, 1000)}", err=True)
    sys.exit(1)
