"""`nightly.yaml`: what follows a night.

send: https://chat.example.org/hooks/knee-rig     # a webhook, or a command:
# send: mail -s "knee rig {status}" team@example.org
when: drifted                                     # or always
diagnose:                                         # which cause is behind what drifts
  model: model.yaml
  suite: suite.yaml
"""

from __future__ import annotations

import os
import shlex
from enum import StrEnum
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

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
            raise ValueError("is not a webhook: its address begins with http:// or https://")
        try:
            shlex.split(text)
        except ValueError as error:
            raise ValueError(f"is not a command ({error})") from error
    if is_webhook(text) and not _is_address(text):
        raise ValueError("is not the address of a webhook: write http(s)://HOST[:PORT]/PATH")
    return text


def _is_address(text: str) -> bool:
    """Whether an address has a host, a port that is one, no user and nothing that HTTP forbids."""
    try:
        parts = urlsplit(text)
        return (
            bool(parts.hostname)
            and parts.port != 0
            and "@" not in parts.netloc
            and (text.isascii() and text.isprintable() and " " not in text)
        )
    except ValueError:
        return False


class Diagnose(BaseModel):
    """What of the machine is followed from night to night."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    model: str = Field(
        min_length=1,
        description="model.yaml of the machine; what it has under `calibrate` is estimated every "
        "night",
    )
    suite: str = Field(
        default="", description="suite.yaml whose acceptance limits a cause is followed to"
    )
    target: str = Field(
        default="",
        description="target.yaml of the simulator whose controllers the suite is simulated with; "
        "the suite's own, if left out",
    )
    inputs: list[str] = Field(
        default=["current_command"],
        min_length=1,
        description="measured signals that drive the model",
    )
    channels: str = Field(default="", description="channels.yaml of recordings made elsewhere")
    trials: list[str] = Field(
        default=[], description="trials whose recordings are used; all, if left out"
    )
    follow: list[str] = Field(
        default=[],
        description="effects and parameters that may wear, besides those under `calibrate`; every "
        "effect that the plant has a place for, if left out",
    )
    healthy_nights: int = Field(
        default=8, ge=8, le=1000, description="first nights, on which nothing wears yet"
    )


class Nightly(BaseModel):
    """What follows a night."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    send: Annotated[str, AfterValidator(_sendable)] | None = Field(
        default=None,
        description="A webhook (http:// or https://, gets JSON with the summary as 'text'), or a "
        "command (gets the summary in Markdown on its standard input; {status} and {headline} in "
        "its words are replaced). $NAME is taken from the environment, for what is secret.",
    )
    when: When = Field(
        default=When.DRIFTED, description="Send after nights that drifted, or always."
    )
    diagnose: Diagnose | None = Field(
        default=None, description="Which cause is behind what drifts, and how long it lasts."
    )

    @model_validator(mode="after")
    def _asks_for_something(self) -> Nightly:
        if self.send is None and self.diagnose is None:
            raise ValueError("neither 'send' nor 'diagnose' is there: nothing follows a night")
        return self

    def destination(self) -> str:
        """Return where to send to, `$NAME` taken from the environment; "" for nowhere.

        Raises:
            InputError: the environment does not have it, or has no webhook and no command there.
        """
        if self.send is None or not self.send.startswith("$"):
            return self.send or ""
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
