"""`nightly.yaml`: where the summary of a history is sent, and when.

send: https://chat.example.org/hooks/knee-rig     # a webhook, or a command:
# send: mail -s "knee rig {status}" team@example.org
when: drifted                                     # or always
"""

from __future__ import annotations

import os
import shlex
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from eha_bench.core import yaml_file
from eha_bench.core.errors import InputError


class When(StrEnum):
    """After which nights a summary is sent."""

    DRIFTED = "drifted"
    ALWAYS = "always"


def _sendable(text: str) -> str:
    if not text.strip():
        raise ValueError("names neither a webhook nor a command")
    if not is_webhook(text) and not text.startswith("$"):
        if "://" in text.split(maxsplit=1)[0]:
            raise ValueError("is no webhook: its address begins with http:// or https://")
        try:
            shlex.split(text)
        except ValueError as error:
            raise ValueError(f"is no command ({error})") from error
    return text


class Nightly(BaseModel):
    """What follows a night."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    send: Annotated[str, AfterValidator(_sendable)] = Field(
        description="A webhook (http:// or https://, gets JSON with the summary as 'text'), or a "
        "command (gets the summary in Markdown on its standard input; {status} and {headline} in "
        "its words are replaced). $NAME is taken from the environment, for what is secret."
    )
    when: When = Field(
        default=When.DRIFTED, description="Send after nights that drifted, or always."
    )

    def destination(self) -> str:
        """Return where to send to, `$NAME` taken from the environment.

        Raises:
            InputError: the environment does not have it, or has no webhook and no command there.
        """
        if not self.send.startswith("$"):
            return self.send
        name = self.send[1:].strip("{}")
        found = os.environ.get(name, "")
        try:
            return _sendable(found)
        except ValueError as error:
            raise InputError(
                f"the environment's {name} {error}", hint=f"set {name}, or write it under 'send'"
            ) from error


def is_webhook(destination: str) -> bool:
    """Return whether something is a webhook, and not a command."""
    return destination.lower().startswith(("http://", "https://"))


def load_nightly(path: Path) -> Nightly:
    """Read a nightly.yaml.

    Raises:
        InputError: it is wrong, with file, line and key.
    """
    return yaml_file.load_model(Nightly, path, kind="nightly")
