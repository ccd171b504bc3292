"""A crash of a target's or controller's code as a fault of the target."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from eha_bench.core.error_text import error_text
from eha_bench.core.errors import EhaBenchError, TargetFault


@contextmanager
def crashes_as_faults() -> Iterator[None]:
    """Turn what no code raises on purpose into a TargetFault; an EhaBenchError stays what it is.

    `sys.exit` in a plug-in is a crash, too: it would end the run with its own exit status.

    Raises:
        TargetFault: the code crashed.
    """
    try:
        yield
    except EhaBenchError:
        raise
    except (Exception, SystemExit) as error:
        raise TargetFault(error_text(error)) from error
