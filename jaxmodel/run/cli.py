"""``jaxmodel``: parse, run, and end with 0 (done), 1 (ran but failed) or 2 (bad input), always in one sentence."""

import shlex
import sys
from collections.abc import Sequence

from jaxmodel.errors import InputError, RunError
from jaxmodel.run import arguments
from jaxmodel.run.console import complain


def main(words: Sequence[str] | None = None) -> None:
    """Entry point of the command; ends the process with the exit code."""
    sys.exit(execute(list(sys.argv[1:] if words is None else words)))


def execute(words: list[str]) -> int:
    """Run one command and return its exit code; 130 after Ctrl-C."""
    try:
        command, changes = arguments.parse(words)
        _run(command, changes, words)
    except SystemExit as usage:
        return usage.code if isinstance(usage.code, int) else 2
    except InputError as error:
        complain(error)
        return 2
    except RunError as error:
        complain(error)
        return 1
    except KeyboardInterrupt as stopped:
        hint = str(stopped) or "nothing was left behind"
        sys.stderr.write(f"\njaxmodel: interrupted; {hint}.\n")
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except Exception as error:
        failure = RunError(f"{type(error).__name__}: {error} (JAXMODEL_DEBUG=1 shows where)")
        complain(failure.with_traceback(error.__traceback__))
        return 1
    return 0


def _run(command: arguments.AnyCommand, changes: list[tuple[str, str]], words: list[str]) -> None:
    """Import what the command needs, now that its words are understood."""
    if isinstance(command, arguments.Data):
        from jaxmodel.run import public_data

        return public_data.run(command.action)
    from jaxmodel.run.devices import quiet_compiler

    quiet_compiler()
    from jaxmodel.run import commands

    line = shlex.join(["jaxmodel", *words])
    match command:
        case arguments.Run():
            commands.run(command, changes, line)
        case arguments.Sweep():
            commands.sweep(command, line)
        case arguments.Register():
            commands.register(command, line)
        case arguments.Align():
            commands.align(command, line)
        case arguments.Calibrate():
            from jaxmodel.run.calibration.command import calibrate

            calibrate(command, line)
        case arguments.Mesh():
            from jaxmodel.run.meshing.command import mesh

            mesh(command, line)
        case arguments.Plan():
            from jaxmodel.run.planning.command import plan

            plan(command, line)
        case arguments.Report():
            commands.report(command)
