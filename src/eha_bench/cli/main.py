"""The command `eha-bench`: what starts before anything else does."""

from __future__ import annotations

import gc
import os

from eha_bench.cli.console import errors_as_sentences, say_what_the_product_logs
from eha_bench.core.interruption import signals_noted_only


def main() -> None:
    """Entry point of the command: errors become sentences, results become exit statuses."""
    # starting makes many objects and hardly any garbage: looking for it took a tenth of the time
    gc.set_threshold(200_000)
    # pydantic would look through all installed packages for its own plug-ins, which none are
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    say_what_the_product_logs()
    with errors_as_sentences(), signals_noted_only():
        # here, where Ctrl-C is a sentence: putting the commands together takes half of the start
        from eha_bench.cli.app import command

        command()
